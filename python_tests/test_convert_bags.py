"""Bags of every format and message, compared with what was written into them point by point."""

import csv
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bags import (
    BEGIN_NS,
    FORMATS,
    Layout,
    Message,
    Types,
    empty_scan,
    livox_cloud,
    plain_cloud,
    point_cloud,
    random_points,
    read_xyz,
    returns_of,
    text,
    write_bag,
)
from unlidar.cli import main
from unlidar.conversion import Options, convert
from unlidar.frames_io import read_pcd
from unlidar.geodesy import Origin, to_geodetic

TWO_VERSIONS = ("ros1", "mcap-folder")
CLOUDS = [random_points(seed) for seed in range(4)]
STEP_NS = 100_000_000


def stamp_of(index: int) -> int:
    return BEGIN_NS + index * STEP_NS


def name_of(stamp_ns: int) -> str:
    return f"{stamp_ns // 10**9}.{stamp_ns % 10**9:09d}.pcd"


def flight(topic: str = "/points") -> list[Message]:
    return [plain_cloud(topic, stamp_of(i), xyz) for i, xyz in enumerate(CLOUDS)]


def truth_rows(out: Path) -> list[list[str]]:
    return list(csv.reader((out / "ground_truth.csv").open()))[1:]


def header_message(topic: str, name: str, index: int, fill: Any) -> Message:
    """A message `package/Name` of a header and what `fill(types)` gives by field."""
    stamp_ns = stamp_of(index) + 5

    def make(t: Types) -> Any:
        return t.make(name, header=t.header(stamp_ns), **fill(t))

    return Message(topic, name.replace("/", "/msg/"), stamp_ns, make)


@pytest.mark.parametrize("form", FORMATS)
def test_every_return_arrives_from_every_format_under_its_exact_stamp(form, tmp_path):
    bag = write_bag(tmp_path, form, [text("/chatter", BEGIN_NS), *flight()])
    report = convert(bag, tmp_path / "out")
    assert report["frames"] == {"points": len(CLOUDS)}
    assert report["complete"] is True
    assert [n for n in report["notes"] if "flight.db3-wal: " not in n] == []
    assert bool(report["notes"]) == ("wal" in form)
    names = sorted(path.name for path in (tmp_path / "out/points").iterdir())
    assert names == [name_of(stamp_of(i)) for i in range(len(CLOUDS))]
    for name, xyz in zip(names, CLOUDS, strict=True):
        np.testing.assert_array_equal(
            read_xyz(tmp_path / "out/points" / name), xyz[returns_of(xyz)]
        )


XYZ = {
    "dense": Layout(),
    "padded": Layout((("x", "f4", 16), ("y", "f4", 4), ("z", "f4", 25)), 32),
    "double": Layout((("z", "f8", 3), ("x", "f8", 11), ("y", "f8", 20)), 37),
    "mixed": Layout((("x", "f8", 0), ("y", "f4", 8), ("z", "i2", 12), ("ring", "u2", 14)), 16),
    "integers": Layout((("x", "i4", 0), ("y", "i2", 4), ("z", "u1", 6)), 7),
    "small": Layout((("x", "i1", 0), ("y", "u2", 1), ("z", "u4", 3)), 8),
    "upper case": Layout((("X", "f4", 0), ("Y", "f4", 4), ("Z", "f4", 8)), 12),
    "big endian": Layout((("x", "f4", 0), ("y", "f8", 4), ("z", "i2", 12)), 16, big_endian=True),
    "organised": Layout(height=5),
    "organised, rows padded": Layout(height=5, padding=13),
}


@pytest.mark.parametrize("form", TWO_VERSIONS)
@pytest.mark.parametrize("layout", XYZ.values(), ids=XYZ)
def test_points_are_found_wherever_and_however_they_lie(form, layout, tmp_path):
    rng = np.random.default_rng(3)
    columns = {}
    for name, kind, _ in layout.fields:
        values = rng.integers(0 if kind[0] == "u" else -100, 100, 40)
        columns[name] = (values + (0.3 if kind[0] == "f" else 0)).astype(kind)
    for name in columns:  # a ray without a return
        columns[name][4] = 0
    floating = next((n for n, kind, _ in layout.fields if kind[0] == "f"), None)
    if floating:
        columns[floating][9] = math.nan
    bag = write_bag(tmp_path, form, [point_cloud("/p", BEGIN_NS, columns, layout, BEGIN_NS)])
    convert(bag, tmp_path / "out")
    lower = {name.lower(): column for name, column in columns.items()}
    xyz = np.stack([lower[axis].astype("f4") for axis in "xyz"], axis=1)
    written = read_xyz(tmp_path / "out/p" / name_of(BEGIN_NS))
    np.testing.assert_array_equal(written, xyz[returns_of(xyz)])


def test_a_cloud_without_points_is_a_frame_without_returns(tmp_path):
    bag = write_bag(tmp_path, "ros1", [*flight(), plain_cloud("/points", 5, np.zeros((0, 3)))])
    report = convert(bag, tmp_path / "out")
    assert report["frames"]["points"] == len(CLOUDS) + 1
    assert len(read_xyz(tmp_path / "out/points" / name_of(5))) == 0


OFFSETS_NS = np.arange(40) * 2_500_000
# field, its type, its values, and how far they may be off by rounding
TIMES = {
    "t in ns": ("t", "u4", OFFSETS_NS, 0),
    "time in s": ("time", "f4", OFFSETS_NS / 1e9, 4),
    "time before the stamp": ("time", "f4", -OFFSETS_NS / 1e9, 4),
    "timestamp as Unix s": ("timestamp", "f8", (BEGIN_NS + OFFSETS_NS) / 1e9, 250),
    "timestamp as Unix ns": ("timestamp", "f8", (BEGIN_NS + OFFSETS_NS).astype("f8"), 130),
    "offset_time": ("offset_time", "u4", OFFSETS_NS, 0),
}


@pytest.mark.parametrize("stamp", ["header", "log"])
@pytest.mark.parametrize(("field", "kind", "values", "off_ns"), TIMES.values(), ids=TIMES)
def test_times_of_points_become_offsets_from_their_header(
    stamp, field, kind, values, off_ns, tmp_path
):
    layout = Layout((*Layout().fields, (field, kind, 12)), 20)
    columns = dict(zip("xyz", CLOUDS[0].T, strict=True)) | {field: values}
    message = point_cloud("/p", BEGIN_NS, columns, layout, BEGIN_NS + 9 * 10**9)
    bag = write_bag(tmp_path, "mcap-folder", [message])
    convert(bag, tmp_path / "out", options=Options(stamp=stamp))
    fields = read_pcd(next((tmp_path / "out/p").iterdir()))
    expected = (OFFSETS_NS if values[-1] > 0 else -OFFSETS_NS)[returns_of(CLOUDS[0])]
    assert fields["offset_time"].dtype == ("<i4" if values[-1] < 0 else "<u4")
    assert np.abs(fields["offset_time"].astype(int) - expected).max() <= off_ns


def test_times_of_points_by_another_clock_are_left_out_and_said(tmp_path, capsys):
    layout = Layout((*Layout().fields, ("timestamp", "f8", 12)), 20)
    columns = dict(zip("xyz", CLOUDS[0].T, strict=True)) | {"timestamp": np.full(40, 5000.0)}
    bag = write_bag(tmp_path, "ros1", [point_cloud("/p", BEGIN_NS, columns, layout, BEGIN_NS)])
    assert main(["convert", str(bag), str(tmp_path / "out")]) == 0
    assert "point times of 1 messages" in capsys.readouterr().err
    assert set(read_pcd(next((tmp_path / "out/p").iterdir()))) == {"x", "y", "z"}


def livox_columns(seed: int) -> dict[str, np.ndarray]:
    xyz = random_points(seed)
    rng = np.random.default_rng(seed)
    offsets = np.sort(rng.integers(0, 10**8, len(xyz)))
    columns = {"offset_time": offsets, "tag": rng.integers(0, 256, len(xyz))}
    return dict(zip("xyz", xyz.T, strict=True)) | columns


@pytest.mark.parametrize("package", ["livox_ros_driver", "livox_ros_driver2"])
@pytest.mark.parametrize("form", ["ros1", "mcap-folder", "db3-without-definitions"])
def test_livox_messages_keep_tags_and_the_time_of_every_return(package, form, tmp_path):
    clouds = [livox_columns(seed) for seed in range(3)]
    messages = [
        livox_cloud("/livox/lidar", stamp_of(i), package, columns)
        for i, columns in enumerate(clouds)
    ]
    empty = {name: column[:0] for name, column in clouds[0].items()}
    messages.append(livox_cloud("/livox/lidar", stamp_of(3), package, empty))
    convert(write_bag(tmp_path, form, messages), tmp_path / "out")
    folder = tmp_path / "out/livox_lidar"
    assert len(read_xyz(folder / name_of(stamp_of(3)))) == 0
    for i, columns in enumerate(clouds):
        fields = read_pcd(folder / name_of(stamp_of(i)))
        kept = returns_of(np.stack([columns[axis] for axis in "xyz"], axis=1))
        assert 0 < kept.sum() < len(kept)
        for name, column in fields.items():
            np.testing.assert_array_equal(column, columns[name][kept])
        assert fields["offset_time"].dtype == "<u4"
        assert fields["tag"].dtype == "u1"


def test_merged_messages_make_one_frame_with_the_time_of_each_point(tmp_path):
    clouds = [livox_columns(seed) for seed in range(5)]
    messages = [
        livox_cloud("/l", stamp_of(i), "livox_ros_driver2", columns)
        for i, columns in enumerate(clouds)
    ]
    bag = write_bag(tmp_path, "ros1", messages + flight("/plain"))
    report = convert(bag, tmp_path / "out", options=Options(merge=3))
    assert report["frames"] == {"l": 2, "plain": 2}
    for first, last in ((0, 3), (3, 5)):
        fields = read_pcd(tmp_path / "out/l" / name_of(stamp_of(first)))
        parts = clouds[first:last]
        kept = [returns_of(np.stack([c[axis] for axis in "xyz"], axis=1)) for c in parts]
        for name in ("x", "y", "z", "tag"):
            expected = np.concatenate([c[name][k] for c, k in zip(parts, kept, strict=True)])
            np.testing.assert_array_equal(fields[name], expected)
        times = [
            c["offset_time"][k] + i * STEP_NS
            for i, (c, k) in enumerate(zip(parts, kept, strict=True))
        ]
        np.testing.assert_array_equal(fields["offset_time"], np.concatenate(times))
    plain = read_pcd(tmp_path / "out/plain" / name_of(stamp_of(0)))
    counts = [returns_of(xyz).sum() for xyz in CLOUDS[:3]]
    np.testing.assert_array_equal(
        plain["offset_time"], np.repeat([0, STEP_NS, 2 * STEP_NS], counts)
    )


def point(t: Types, name: str, xyz: tuple) -> Any:
    return t.make(f"geometry_msgs/{name}", *(float(v) for v in xyz))


def pose(t: Types, xyz: tuple) -> Any:
    return t.make("geometry_msgs/Pose", point(t, "Point", xyz), unturned(t))


def unturned(t: Types) -> Any:
    return t.make("geometry_msgs/Quaternion", 0.0, 0.0, 0.0, 1.0)


def pose_with_covariance(t: Types, xyz: tuple) -> Any:
    return t.make("geometry_msgs/PoseWithCovariance", pose(t, xyz), np.zeros(36))


def odometry(t: Types, xyz: tuple) -> dict:
    still = t.make(
        "geometry_msgs/Twist", point(t, "Vector3", (0,) * 3), point(t, "Vector3", (0,) * 3)
    )
    return {
        "child_frame_id": "drone",
        "pose": pose_with_covariance(t, xyz),
        "twist": t.make("geometry_msgs/TwistWithCovariance", still, np.zeros(36)),
    }


def transform(t: Types, xyz: tuple) -> dict:
    moved = t.make("geometry_msgs/Transform", point(t, "Vector3", xyz), unturned(t))
    return {"child_frame_id": "drone", "transform": moved}


TRUTHS = {
    "geometry_msgs/PointStamped": lambda t, p: {"point": point(t, "Point", p)},
    "geometry_msgs/PoseStamped": lambda t, p: {"pose": pose(t, p)},
    "geometry_msgs/PoseWithCovarianceStamped": lambda t, p: {"pose": pose_with_covariance(t, p)},
    "geometry_msgs/TransformStamped": transform,
    "nav_msgs/Odometry": odometry,
}
PATH = [(1.0 / 3.0 + i, -2.0 * i, 7.0) for i in range(4)]


def truth_messages(topic: str, name: str, path: list[tuple]) -> list[Message]:
    return [
        header_message(topic, name, i, lambda t, p=p: TRUTHS[name](t, p))
        for i, p in enumerate(path)
    ]


@pytest.mark.parametrize("form", TWO_VERSIONS)
@pytest.mark.parametrize("name", TRUTHS)
def test_truth_of_every_type_arrives_with_every_digit(name, form, tmp_path):
    bag = write_bag(tmp_path, form, flight() + truth_messages("/truth", name, PATH))
    assert convert(bag, tmp_path / "out")["truth_rows"] == 4
    stamps = [name_of(stamp_of(i) + 5).removesuffix(".pcd") for i in range(4)]
    expected = [[s, *map(repr, p)] for s, p in zip(stamps, PATH, strict=True)]
    assert truth_rows(tmp_path / "out") == expected


def fixes(places: np.ndarray, status: int = 0) -> list[Message]:
    def fill(t: Types, place: np.ndarray) -> dict:
        return {
            "status": t.make("sensor_msgs/NavSatStatus", status=status, service=1),
            "latitude": float(place[0]),
            "longitude": float(place[1]),
            "altitude": float(place[2]),
            "position_covariance": np.zeros(9),
            "position_covariance_type": 0,
        }

    return [
        header_message("/fix", "sensor_msgs/NavSatFix", i, lambda t, p=p: fill(t, p))
        for i, p in enumerate(places)
    ]


@pytest.mark.parametrize("form", TWO_VERSIONS)
def test_fixes_become_east_north_up_of_an_origin_that_is_said(form, tmp_path, capsys):
    origin = Origin(-33.86, 151.21, 25.0)
    enu = np.array([(0.0, 0.0, 0.0), (100.0, 0.0, 5.0), (0.0, -250.0, 60.0), (-30.0, 40.0, -3.0)])
    bag = write_bag(tmp_path, form, flight() + fixes(to_geodetic(origin, enu)))
    assert main(["convert", str(bag), str(tmp_path / "out"), "--truth", "/fix"]) == 0
    assert "the first fix" in capsys.readouterr().err
    rows = np.array([[float(v) for v in row[1:]] for row in truth_rows(tmp_path / "out")])
    np.testing.assert_allclose(rows, enu, atol=1e-6)
    said = json.loads((tmp_path / "out/conversion.json").read_text())["origin"]
    np.testing.assert_allclose([float(v) for v in said.split(",")], [-33.86, 151.21, 25.0])
    given = f"--origin={said}"
    again = ["convert", str(bag), str(tmp_path / "again"), given, "--truth", "/fix"]
    assert main(again) == 0
    assert "as given" in capsys.readouterr().err
    assert truth_rows(tmp_path / "again") == truth_rows(tmp_path / "out")


def test_messages_without_a_fix_are_left_out_and_counted(tmp_path):
    bag = write_bag(tmp_path, "ros1", flight() + fixes(np.ones((3, 3)), status=-1))
    report = convert(bag, tmp_path / "out", options=Options(truths=("/fix",)))
    assert report["truth_rows"] == 0
    assert not (tmp_path / "out/ground_truth.csv").exists()
    assert any("3 truth messages without a position" in note for note in report["notes"])


def test_topics_of_mmaud_get_the_names_of_its_folders(tmp_path):
    messages = [
        *flight("/livox_mid360/lidar"),
        *flight("/livox_avia/lidar"),
        *flight("/radar_enhanced_pcl"),
        *truth_messages("/drone/odometry", "nav_msgs/Odometry", [(0, 0, 0)]),
        *truth_messages("/leica/point/relative", "geometry_msgs/PointStamped", PATH),
    ]
    bag = write_bag(tmp_path, "ros1", messages)
    report = convert(bag, tmp_path / "out")
    assert set(report["frames"]) == {"lidar_360", "livox_avia"}
    assert [row[1:] for row in truth_rows(tmp_path / "out")] == [list(map(repr, p)) for p in PATH]
    assert any("/drone/odometry" in note for note in report["notes"])
    radar = convert(bag, tmp_path / "radar", ["radar_enhanced_pcl"])
    assert radar["frames"] == {"radar_enhanced_pcl": 4}


def test_named_topics_are_taken_and_each_named_truth_is_a_target(tmp_path):
    other = [(9.0, 9.0, float(i)) for i in range(3)]
    messages = [
        *flight("/a/points"),
        *flight("/a_points"),
        *truth_messages("/t1", "geometry_msgs/PoseStamped", PATH),
        *truth_messages("/t2", "nav_msgs/Odometry", other),
    ]
    bag = write_bag(tmp_path, "mcap-file", messages)
    assert set(convert(bag, tmp_path / "all")["frames"]) == {"a_points", "a_points_2"}
    arguments = ["convert", str(bag), str(tmp_path / "out"), "--topic", "/a_points"]
    assert main([*arguments, "--topic", "/t2", "--topic", "/t1"]) == 0
    assert [d.name for d in (tmp_path / "out").iterdir() if d.is_dir()] == ["a_points_2"]
    rows = truth_rows(tmp_path / "out")
    assert [row[1:4] for row in rows if row[4] == "0"] == [list(map(repr, p)) for p in other]
    assert [row[1:4] for row in rows if row[4] == "1"] == [list(map(repr, p)) for p in PATH]


def test_topics_that_give_no_frames_are_refused_with_a_reason(tmp_path, fails):
    bag = write_bag(tmp_path, "ros1", [*flight(), empty_scan("/scan", 5), text("/words", 5)])
    out = tmp_path / "out"
    assert "one plane" in fails(4, "convert", bag, out, "--topic", "/scan")
    assert "neither" in fails(4, "convert", bag, out, "--topic", "/words")
    line = fails(2, "convert", bag, out, "--topic", "/nothing")
    assert "/nothing" in line
    assert "/points" in line
    only = write_bag(tmp_path / "only", "mcap-folder", [empty_scan("/scan", 5)])
    assert "one plane" in fails(4, "convert", only, out)
    assert not out.exists()


def test_list_says_what_becomes_of_every_topic_and_writes_nothing(tmp_path, capsys, fails):
    messages = [*flight(), empty_scan("/scan", 5), text("/words", 5)]
    messages += truth_messages("/t1", "geometry_msgs/PoseStamped", PATH)
    bag = write_bag(tmp_path, "db3-folder", messages)
    before = sorted(tmp_path.rglob("*"))
    assert main(["convert", str(bag), "--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    for topic, count, becomes in (
        ("/points", "4", "frames of points"),
        ("/t1", "4", "ground_truth.csv"),
        ("/scan", "1", "refused"),
        ("/words", "1", ""),
    ):
        line = next(line for line in lines if topic in line)
        assert count in line.split()
        assert becomes in line
    assert sorted(tmp_path.rglob("*")) == before
    assert "OUT" in fails(2, "convert", bag)


@pytest.mark.parametrize("form", ["ros1", "db3-folder", "mcap-folder"])
def test_start_and_duration_cut_frames_and_truth_by_log_time(form, tmp_path, fails):
    truth = truth_messages("/t/truth", "geometry_msgs/PoseStamped", PATH)
    bag = write_bag(tmp_path, form, flight() + truth)
    window = ("--start", "0.1", "--duration", "0.2")
    assert main(["convert", str(bag), str(tmp_path / "out"), *window]) == 0
    # The bag begins with the truth, 5 ns after the header of the first cloud; clouds are logged
    # 2 ms after their headers.
    names = sorted(path.name for path in (tmp_path / "out/points").iterdir())
    assert names == [name_of(stamp_of(i)) for i in (1, 2)]
    assert [row[1] for row in truth_rows(tmp_path / "out")] == [repr(p[0]) for p in PATH[1:3]]
    assert "time asked for" in fails(4, "convert", bag, tmp_path / "none", "--start", "100")
    for wrong in (("--start", "-1"), ("--duration", "0"), ("--merge", "0"), ("--origin", "91,0,0")):
        fails(2, "convert", bag, tmp_path / "none", *wrong)


def test_stamps_that_differ_from_log_times_are_said_and_either_can_be_taken(tmp_path, capsys):
    behind_ns = 3600 * 10**9
    messages = [
        plain_cloud("/p", stamp_of(i), xyz, stamp_of(i) + behind_ns) for i, xyz in enumerate(CLOUDS)
    ]
    bag = write_bag(tmp_path, "ros1", messages)
    assert main(["convert", str(bag), str(tmp_path / "header")]) == 0
    said = capsys.readouterr().err
    assert "3600.000" in said
    assert "--stamp log" in said
    assert (tmp_path / "header/p" / name_of(stamp_of(0))).is_file()
    assert main(["convert", str(bag), str(tmp_path / "log"), "--stamp", "log"]) == 0
    assert "--stamp header" in capsys.readouterr().err
    assert (tmp_path / "log/p" / name_of(stamp_of(0) + behind_ns)).is_file()


def test_headers_without_a_stamp_get_the_log_time_and_it_is_said(tmp_path):
    messages = [plain_cloud("/p", 0, xyz, stamp_of(i)) for i, xyz in enumerate(CLOUDS)]
    report = convert(write_bag(tmp_path, "ros1", messages), tmp_path / "out")
    assert (tmp_path / "out/p" / name_of(stamp_of(2))).is_file()
    assert any("4 of 4 headers have no stamp" in note for note in report["notes"])


def test_truth_of_another_clock_is_said(tmp_path):
    truth = [Message(m.topic, m.msgtype, m.log_ns, m.fill) for m in fixes(np.ones((2, 3)))]
    late = [
        plain_cloud("/p", stamp_of(i) + 10**12, xyz, stamp_of(i)) for i, xyz in enumerate(CLOUDS)
    ]
    bag = write_bag(tmp_path, "ros1", late + truth)
    report = convert(bag, tmp_path / "out", options=Options(truths=("/fix",)))
    assert any("no frame lies within the time of the truth" in note for note in report["notes"])


def test_a_split_recording_in_one_folder_is_one_recording(tmp_path, fails):
    folder = tmp_path / "split"
    for i, half in enumerate((flight()[:2], flight()[2:])):
        write_bag(folder, "ros1", half, f"flight_2024-01-26-09-53-4{i}_{i}")
    assert convert(folder, tmp_path / "out")["frames"] == {"points": 4}
    write_bag(folder, "ros1", flight(), "another")
    fails(4, "convert", folder, tmp_path / "none")


def test_a_folder_of_ros_2_without_metadata_is_read_by_its_files(tmp_path):
    bag = write_bag(tmp_path, "mcap-folder", flight())
    (bag / "metadata.yaml").unlink()
    assert convert(bag, tmp_path / "out")["frames"] == {"points": 4}


def test_options_for_bags_are_refused_for_folders_of_files(tmp_path, fails):
    (tmp_path / "seq").mkdir()
    np.save(tmp_path / "seq/1.5.npy", np.ones((3, 3)))
    fails(2, "convert", tmp_path / "seq", tmp_path / "out", "--topic", "/a")
    fails(2, "convert", tmp_path / "seq", tmp_path / "out", "--truth", "/a")
    fails(2, "convert", tmp_path / "seq", tmp_path / "out", "--stamp", "log")
