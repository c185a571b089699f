"""/tf_static: where LiDARs stand goes to station.yaml, and the truth into their common frame."""

import json
from typing import Any

import numpy as np
import pytest
import unlidar
from bags import BEGIN_NS, Message, Types, plain_cloud, random_points, write_bag
from hypothesis import given
from hypothesis import strategies as st
from ruamel.yaml import YAML
from scipy.spatial.transform import Rotation
from unlidar.cli import main
from unlidar.conversion import Options, convert
from unlidar.conversion.transforms import StaticTransforms
from unlidar.errors import InputError
from unlidar.station import Pose, read_station, station_options, write_station

TF = "tf2_msgs/msg/TFMessage"
TURNED = (0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5))  # by 90 degrees to the left
ON_ITS_BACK = (0.0, -np.sqrt(0.5), 0.0, np.sqrt(0.5))  # x up
STRAIGHT = (0.0, 0.0, 0.0, 1.0)
PATH = [(1.0, 2.0, 3.0 + i) for i in range(4)]

Transform = tuple[str, str, tuple, tuple]  # parent, child, translation, rotation x y z w


def static(*transforms: Transform, topic: str = "/tf_static", at_ns: int = BEGIN_NS) -> Message:
    def fill(t: Types) -> Any:
        return t.make(
            "tf2_msgs/TFMessage",
            [
                t.make(
                    "geometry_msgs/TransformStamped",
                    header=t.header(at_ns, parent),
                    child_frame_id=child,
                    transform=t.make(
                        "geometry_msgs/Transform",
                        t.make("geometry_msgs/Vector3", *map(float, translation)),
                        t.make("geometry_msgs/Quaternion", *map(float, rotation)),
                    ),
                )
                for parent, child, translation, rotation in transforms
            ],
        )

    return Message(topic, TF, at_ns, fill)


def flight(frame_id: str, topic: str) -> list[Message]:
    return [
        plain_cloud(topic, BEGIN_NS + i * 10**8, random_points(i), frame_id=frame_id)
        for i in range(4)
    ]


def truth(frame_id: str, topic: str = "/vicon/drone") -> list[Message]:
    def fill(t: Types, i: int) -> Any:
        point = t.make("geometry_msgs/Point", *PATH[i])
        header = t.header(BEGIN_NS + i * 10**8, frame_id)
        return t.make("geometry_msgs/PointStamped", header, point)

    return [
        Message(
            topic,
            "geometry_msgs/msg/PointStamped",
            BEGIN_NS + i * 10**8,
            lambda t, i=i: fill(t, i),
        )
        for i in range(len(PATH))
    ]


STATION = (
    ("map", "base", (100.0, 0, 2), TURNED),
    ("base", "left", (0, 0.5, 0), STRAIGHT),
    ("base", "right", (0, -0.5, 0.25), ON_ITS_BACK),
)
# By hand: base turns x to y and stands at (100, 0, 2).
LEFT_M, RIGHT_M = (99.5, 0.0, 2.0), (100.5, 0.0, 2.25)


def read_truth(out) -> np.ndarray:
    return np.loadtxt(out / "ground_truth.csv", delimiter=",", skiprows=1)[:, 1:]


@pytest.mark.parametrize("form", ["ros1", "db3-folder", "mcap-file"])
def test_extrinsics_of_two_lidars_go_to_station_yaml(form, tmp_path):
    late = static(*STATION, at_ns=BEGIN_NS + 10**9)  # a bag need not begin with it
    bag = write_bag(tmp_path, form, [*flight("left", "/a"), *flight("/right", "/b"), late])
    report = convert(bag, tmp_path / "out")
    poses = read_station(tmp_path / "out")
    assert list(poses) == ["a", "b"]
    assert poses["a"].translation_m == pytest.approx(LEFT_M)
    assert poses["b"].translation_m == pytest.approx(RIGHT_M)
    # Up is forward to a sensor on its back; the base looks along y.
    turned = Rotation.from_quat(poses["b"].rotation)
    np.testing.assert_allclose(turned.apply([1, 0, 0]), (0, 0, 1), atol=1e-12)
    np.testing.assert_allclose(turned.apply([0, 0, -1]), (0, 1, 0), atol=1e-12)
    assert report["common_frame"] == "map"
    assert any("'map'" in note and "station.yaml" in note for note in report["notes"])
    plain = YAML(typ="safe", pure=True).load((tmp_path / "out/station.yaml").read_text())
    assert set(plain["sensors"]["a"]) == {"translation_m", "rotation", "time_offset_s"}


def test_run_tracks_with_the_extrinsics(tmp_path, program, monkeypatch):
    monkeypatch.setenv("UNLIDAR_TRACK", str(program))
    bag = write_bag(
        tmp_path, "ros1", [static(*STATION), *flight("left", "/a"), *flight("right", "/b")]
    )
    assert main(["run", str(bag), "--out", str(tmp_path / "out")]) == 0
    config = json.loads((tmp_path / "out/summary.json").read_text())["config"]
    poses = read_station(tmp_path / "out/frames")
    for name, pose in poses.items():
        known = config["sensors"][name]
        assert known["translation_m"] == pytest.approx(pose.translation_m)
        assert known["rotation"] == pytest.approx(pose.rotation)
    mine = tmp_path / "mine.yaml"
    mine.write_text("sensors: {a: {translation_m: [7, 0, 0]}, b: {}}\n")
    frames = tmp_path / "out/frames"
    assert main(["run", str(frames), "--out", str(tmp_path / "own"), "--config", str(mine)]) == 0
    config = json.loads((tmp_path / "own/summary.json").read_text())["config"]
    assert config["sensors"]["a"]["translation_m"] == [7, 0, 0]
    assert config["sensors"]["b"]["translation_m"] == [0, 0, 0]


def test_the_extrinsics_come_along_when_frames_are_converted_again(tmp_path):
    bag = write_bag(
        tmp_path, "ros1", [static(*STATION), *flight("left", "/a"), *flight("right", "/b")]
    )
    convert(bag, tmp_path / "out")
    convert(tmp_path / "out", tmp_path / "again", ["b"])
    assert read_station(tmp_path / "again") == {"b": read_station(tmp_path / "out")["b"]}


@pytest.mark.parametrize(
    ("frame", "expected"),
    [
        ("map", PATH[0]),
        ("base", (100.0 - 2.0, 1.0, 5.0)),
        ("left", (100.0 - 2.5, 1.0, 5.0)),
        ("/right", (100.0 - 1.5, -3.0, 3.25)),
    ],
)
def test_truth_is_turned_into_the_common_frame(frame, expected, tmp_path):
    bag = write_bag(tmp_path, "ros1", [static(*STATION), *flight("left", "/a"), *truth(frame)])
    report = convert(bag, tmp_path / "out")
    np.testing.assert_allclose(read_truth(tmp_path / "out")[0], expected, atol=1e-9)
    assert not any("relates" in note for note in report["notes"])


def test_what_nothing_relates_is_said_and_taken_as_it_is(tmp_path):
    messages = [
        static(*STATION),
        *flight("left", "/a"),
        *flight("elsewhere", "/b"),
        *truth("world"),
    ]
    report = convert(write_bag(tmp_path, "ros1", messages), tmp_path / "out")
    np.testing.assert_array_equal(read_truth(tmp_path / "out"), PATH)
    assert read_station(tmp_path / "out")["b"] == Pose()
    said = [note for note in report["notes"] if "relates" in note]
    assert len(said) == 2
    assert "'elsewhere' of LiDARs to 'map'" in said[0]
    assert "'world' of the truth to 'map'" in said[1]


def test_without_tf_static_frames_that_differ_are_said_and_equal_ones_are_not(tmp_path):
    bag = write_bag(tmp_path, "ros1", [*flight("x", "/a"), *truth("x"), *flight("x", "/b")])
    assert not any("relates" in note for note in convert(bag, tmp_path / "same")["notes"])
    assert not (tmp_path / "same/station.yaml").exists()
    bag = write_bag(tmp_path, "ros1", [*flight("x", "/a"), *truth("w")], "other")
    said = [n for n in convert(bag, tmp_path / "out")["notes"] if "relates" in n]
    assert said == [
        "no /tf_static relates 'w' of the truth to 'x': taken to be the same place",
    ]


def test_transforms_that_are_none_are_left_out_and_said(tmp_path):
    nothing = (0.0, 0.0, 0.0, 0.0)
    broken = (
        ("map", "left", (1, 2, 3), nothing),
        ("map", "nan", (np.nan, 0, 0), STRAIGHT),
        ("self", "self", (0, 0, 0), STRAIGHT),
    )
    bag = write_bag(tmp_path, "ros1", [static(*broken), *flight("left", "/a")])
    report = convert(bag, tmp_path / "out")
    assert any("'left', 'nan', 'self'" in note for note in report["notes"])
    assert not (tmp_path / "out/station.yaml").exists()


def test_moving_transforms_are_no_extrinsics(tmp_path):
    bag = write_bag(tmp_path, "ros1", [static(*STATION, topic="/tf"), *flight("left", "/a")])
    convert(bag, tmp_path / "out")
    assert not (tmp_path / "out/station.yaml").exists()


def test_a_frame_as_far_off_as_the_centre_of_the_earth_is_not_the_common_one(tmp_path):
    earth = ("earth", "map", (4e6, 3e6, 4e6), STRAIGHT)
    bag = write_bag(tmp_path, "ros1", [static(earth, *STATION), *flight("left", "/a")])
    assert convert(bag, tmp_path / "out")["common_frame"] == "map"


NUMBER = st.floats(-50, 50)
QUATERNION = st.tuples(NUMBER, NUMBER, NUMBER, NUMBER).filter(lambda q: np.linalg.norm(q) > 0.2)


VECTOR = st.tuples(NUMBER, NUMBER, NUMBER)
EDGE = st.tuples(st.integers(0, 6), st.integers(0, 6), QUATERNION, VECTOR)


@given(st.lists(EDGE, max_size=8), VECTOR)
def test_any_forest_of_frames_is_related_as_matrices_say(edges, point):
    def made(of: tuple) -> Any:
        store = Types("ros2")
        return static((str(of[0]), str(of[1]), of[3], of[2])).fill(store)

    transforms = StaticTransforms()
    above: dict[int, tuple[int, np.ndarray]] = {}
    for parent, child, quaternion, translation in edges:
        transforms.add(made((parent, child, quaternion, translation)))
        if parent != child:
            matrix = np.eye(4)
            matrix[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
            matrix[:3, 3] = translation
            above[child] = (parent, matrix)

    def root_of(frame: int) -> tuple[int, np.ndarray] | None:
        way, seen = np.eye(4), {frame}
        while frame in above:
            frame, matrix = above[frame]
            way = matrix @ way
            if frame in seen:
                return None  # a circle: any answer is as good
            seen.add(frame)
        return frame, way

    for a in range(7):
        for b in range(7):
            roots = root_of(a), root_of(b)
            if None in roots:
                transforms.placement(str(a), str(b))  # comes to an end
                continue
            found = transforms.placement(str(a), str(b))
            assert (found is not None) == (roots[0][0] == roots[1][0])
            if found is not None:
                expected = np.linalg.inv(roots[1][1]) @ roots[0][1] @ np.array([*point, 1.0])
                np.testing.assert_allclose(found.apply(np.array(point)), expected[:3], atol=1e-7)
    common = transforms.common_frame(map(str, range(7)))
    assert (common is None) == (not above)


def test_station_yaml_is_read_as_it_was_written_and_named_where_it_is_wrong(tmp_path):
    poses = {"a": Pose((1e-7, -2.5, 3.0), TURNED, 0.125), "b-2": Pose()}
    write_station(tmp_path, poses, "two\nlines\x1b")
    assert read_station(tmp_path) == poses
    assert station_options(poses, ["b-2"]) == []
    assert len(station_options(poses, ["a", "b-2"])) == 12
    for text, said in (
        ("sensors: {a: {translation_m: [1, 2]}}", "sensors.a.translation_m"),
        ("sensors: {a: {translation_m: [1, 2, .nan]}}", "sensors.a.translation_m.2: 'nan'"),
        ("sensors: {a: {place: 1}}", "sensors.a.place"),
        ("sensors: 3", "sensors"),
        ("[", "YAML"),
        ("- 1", "YAML"),
    ):
        (tmp_path / "station.yaml").write_text(text)
        with pytest.raises(InputError, match=r"station\.yaml") as error:
            read_station(tmp_path)
        assert said in str(error.value)
        assert "\n" not in str(error.value)


def test_lidars_that_a_station_does_not_place_are_noted(tmp_path, monkeypatch):
    """A name with a mistake would stand at the origin without a word."""
    folder, notes = tmp_path / "seq", []
    monkeypatch.setattr("unlidar.station.note", notes.append)
    for name in ("left", "right"):
        (folder / name).mkdir(parents=True)
        np.save(folder / name / "1.5.npy", np.ones((4, 3)))
    for names, is_noted in ((("left", "right"), False), (("left", "rihgt"), True), ((), False)):
        write_station(folder, {name: Pose((1.0, 2.0, 3.0)) for name in names}, "by hand")
        notes.clear()
        unlidar.read(folder)
        said = "right: taken to stand at the origin, poses are known of left, rihgt"
        assert notes == ([said] if is_noted else [])


def test_truth_is_taken_only_where_its_name_says_so_or_it_was_chosen(tmp_path, capsys):
    clicked = truth("lidar", "/clicked_point")
    bag = write_bag(tmp_path, "ros1", [*flight("lidar", "/a"), *clicked])
    assert main(["convert", str(bag), str(tmp_path / "out")]) == 0
    assert "no truth: no name of /clicked_point says that it is" in capsys.readouterr().err
    assert not (tmp_path / "out/ground_truth.csv").exists()
    chosen = ["convert", str(bag), str(tmp_path / "chosen"), "--truth", "/clicked_point"]
    assert main(chosen) == 0
    assert "truth is /clicked_point (as asked for)" in capsys.readouterr().err
    np.testing.assert_array_equal(read_truth(tmp_path / "chosen"), PATH)


TRUTH_NAMES = ("/ground_truth", "/groundtruth/pose", "/drone/GroundTruth", "/gt", "/uav_gt/pose",
               "/vicon/drone/drone", "/vrpn_client_node/uav/pose", "/mocap_node/pose",
               "/optitrack/uav", "/leica/point", "/prism", "/rtk/fix", "/gt1",
               "/totalStation/point")  # fmt: skip
OTHER_NAMES = ("/clicked_point", "/odom", "/gtsam/path", "/target/height", "/goal_pose", "/fix",
               "/initialpose", "/uav1/pose", "/rtkit", "/artkeeper")  # fmt: skip


@pytest.mark.parametrize("name", (*TRUTH_NAMES, *OTHER_NAMES))
def test_names_of_truth_are_known(name, tmp_path):
    messages = [*flight("lidar", "/a"), *truth("lidar", name), *truth("lidar", "/pose")]
    report = convert(write_bag(tmp_path, "ros1", messages), tmp_path / "out")
    assert report["truth_topics"] == ([name] if name in TRUTH_NAMES else [])
    (note,) = [note for note in report["notes"] if "truth" in note]
    assert name in note
    assert "/pose" in note


def test_a_truth_that_cannot_be_taken_is_refused_before_anything_is_written(tmp_path, fails):
    bag = write_bag(tmp_path, "ros1", [*flight("lidar", "/a"), static(*STATION)])
    assert "has no topic '/b'" in fails(2, "convert", bag, tmp_path / "out", "--truth", "/b")
    assert "no position" in fails(4, "convert", bag, tmp_path / "out", "--truth", "/tf_static")
    assert "no position" in fails(4, "convert", bag, tmp_path / "out", "--truth", "/a")
    assert not (tmp_path / "out").exists()
    assert convert(bag, tmp_path / "out", options=Options())["truth_rows"] is None
