"""Bags of LiDARs that move: /tf and odometry become poses of their carriers."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import unlidar
from bags import BEGIN_NS, Message, Types, plain_cloud, random_points, read_xyz, write_bag
from scipy.spatial.transform import Rotation
from test_convert_station import STRAIGHT, TURNED, static, truth
from test_poses import read_tum
from unlidar.cli import main
from unlidar.conversion import Options, convert, list_streams
from unlidar.poses import Poses
from unlidar.station import Pose, read_station

STEP_NS = 50_000_000
TIMES = 12  # poses, over 0.55 s
FORMATS = ("ros1", "db3-folder", "mcap-file", "ros1-lz4")
ODOMETRY, POSE = "nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseStamped"
# The LiDAR is ahead on the base, on its side.
MOUNTED = ("base", "lidar", (0.5, 0.0, 0.25), TURNED)
Way = Callable[[float], tuple[np.ndarray, Rotation]]


def drives(time_s: float) -> tuple[np.ndarray, Rotation]:
    """10 m/s, 30 degrees a second."""
    turned = Rotation.from_rotvec([0.0, 0.0, np.radians(30) * time_s])
    return np.array([3.0 + 10 * time_s, -2.0, 0.5 * time_s]), turned


def nods(time_s: float) -> tuple[np.ndarray, Rotation]:
    return np.array([0.0, 0.0, 1.0]), Rotation.from_rotvec([0.0, 0.3 * time_s, 0.0])


def rests(_: float) -> tuple[np.ndarray, Rotation]:
    return np.array([3.0, -2.0, 0.0]), Rotation.identity()


def times(step_ns: int = STEP_NS) -> list[int]:
    return [BEGIN_NS + i * step_ns for i in range(TIMES * STEP_NS // step_ns)]


def transforms(parent: str, child: str, way: Way, step_ns: int = STEP_NS) -> list[Message]:
    """As a driver of a robot sends them, here to /tf."""
    messages = []
    for at_ns in times(step_ns):
        position, rotation = way((at_ns - BEGIN_NS) * 1e-9)
        edge = (parent, child, tuple(position), tuple(rotation.as_quat()))
        messages.append(static(edge, topic="/tf", at_ns=at_ns))
    return messages


def odometry(
    topic: str, frame: str, child: str, way: Way, msgtype: str = ODOMETRY
) -> list[Message]:
    def fill(t: Types, at_ns: int) -> Any:
        position, rotation = way((at_ns - BEGIN_NS) * 1e-9)
        pose = t.make(
            "geometry_msgs/Pose",
            t.make("geometry_msgs/Point", *map(float, position)),
            t.make("geometry_msgs/Quaternion", *map(float, rotation.as_quat())),
        )
        header = t.header(at_ns, frame)
        if msgtype == POSE:
            return t.make("geometry_msgs/PoseStamped", header, pose)
        nothing = t.make("geometry_msgs/Vector3", 0.0, 0.0, 0.0)
        return t.make(
            "nav_msgs/Odometry",
            header=header,
            child_frame_id=child,
            pose=t.make("geometry_msgs/PoseWithCovariance", pose, np.zeros(36)),
            twist=t.make(
                "geometry_msgs/TwistWithCovariance",
                t.make("geometry_msgs/Twist", nothing, nothing),
                np.zeros(36),
            ),
        )

    return [Message(topic, msgtype, at, lambda t, at=at: fill(t, at)) for at in times()]


def clouds(frame_id: str = "lidar", topic: str = "/points") -> list[Message]:
    return [
        plain_cloud(topic, BEGIN_NS + i * 10**8, random_points(i), frame_id=frame_id)
        for i in range(5)
    ]


def world_m(out, sensor: str, poses: Poses, stamp_ns: int) -> np.ndarray:
    """The returns of a frame, by what the conversion left."""
    xyz = read_xyz(out / sensor / f"{stamp_ns // 10**9}.{stamp_ns % 10**9:09d}.pcd")
    station = read_station(out).get(sensor, Pose())
    on_carrier = Rotation.from_quat(station.rotation).apply(xyz) + station.translation_m
    position, rotation = poses.at(np.array([stamp_ns]))
    return rotation[0].apply(on_carrier) + position[0]


def expected_m(xyz: np.ndarray, *steps: tuple[np.ndarray, Rotation]) -> np.ndarray:
    for position, rotation in steps:
        xyz = rotation.apply(xyz) + position
    return xyz


MOUNT = np.array(MOUNTED[2]), Rotation.from_quat(MOUNTED[3])


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("by", ["tf", "odometry"])
def test_returns_arrive_in_the_world_by_mounting_and_poses(by, form, tmp_path, capsys):
    moving = transforms("odom", "base", drives)
    if by == "odometry":
        moving = odometry("/odom", "odom", "base", drives)
    bag = write_bag(tmp_path, form, [static(MOUNTED), *clouds(), *moving])
    out = tmp_path / "out"
    assert main(["convert", str(bag), str(out)]) == 0
    topic = {"tf": "/tf", "odometry": "/odom"}[by]
    assert f"their poses in 'odom' are taken from {topic}" in capsys.readouterr().err
    poses = read_tum(out / "poses.tum")
    assert poses.stamp_ns.tolist() == times()
    for i, stamp_ns in enumerate(range(BEGIN_NS, BEGIN_NS + 5 * 10**8, 10**8)):
        xyz = read_xyz(out / "points" / f"{stamp_ns // 10**9}.{stamp_ns % 10**9:09d}.pcd")
        assert len(xyz) > 20
        found = world_m(out, "points", poses, stamp_ns)
        np.testing.assert_allclose(found, expected_m(xyz, MOUNT, drives(i * 0.1)), atol=1e-6)


def test_transforms_that_move_each_other_are_put_together_up_to_the_uppermost(tmp_path):
    """A gimbal on a car in a map that is corrected more seldom than the car moves."""
    messages = [
        static(
            ("head", "lidar", MOUNTED[2], MOUNTED[3]), ("earth", "map", (4e6, 3e6, 4e6), STRAIGHT)
        ),
        *clouds(),
        *transforms("map", "odom", rests, 4 * STEP_NS),
        *transforms("odom", "base", drives),
        *transforms("base", "head", nods, STEP_NS // 5),
    ]
    report = convert(write_bag(tmp_path, "ros1", messages), tmp_path / "out")
    assert report["common_frame"] == "map"
    poses = read_tum(tmp_path / "out/poses.tum")
    assert poses.stamp_ns.tolist() == times(STEP_NS // 5)
    xyz = read_xyz(next(iter(sorted((tmp_path / "out/points").iterdir()))))
    found = world_m(tmp_path / "out", "points", poses, BEGIN_NS)
    np.testing.assert_allclose(
        found, expected_m(xyz, MOUNT, nods(0), drives(0), rests(0)), atol=1e-6
    )
    late_ns = BEGIN_NS + 4 * 10**8
    xyz = read_xyz(sorted((tmp_path / "out/points").iterdir())[4])
    found = world_m(tmp_path / "out", "points", poses, late_ns)
    steps = MOUNT, nods(0.4), drives(0.4), rests(0.4)
    np.testing.assert_allclose(found, expected_m(xyz, *steps), atol=1e-6)


@pytest.mark.parametrize("times_sent", [1, TIMES])
def test_a_mounting_that_is_sent_as_a_transform_again_and_again_is_one(times_sent, tmp_path):
    """As ROS 1 does: its static transforms are of /tf, too."""
    mounted = [static(MOUNTED, topic="/tf", at_ns=at) for at in times()[:times_sent]]
    messages = [*mounted, *clouds(), *transforms("odom", "base", drives)]
    convert(write_bag(tmp_path, "ros1", messages), tmp_path / "out")
    poses, late_ns = read_tum(tmp_path / "out/poses.tum"), BEGIN_NS + 4 * 10**8
    xyz = read_xyz(sorted((tmp_path / "out/points").iterdir())[4])
    found = world_m(tmp_path / "out", "points", poses, late_ns)
    np.testing.assert_allclose(found, expected_m(xyz, MOUNT, drives(0.4)), atol=1e-6)


def test_a_part_of_a_bag_has_the_poses_about_it(tmp_path):
    long = [
        Message(m.topic, m.msgtype, m.log_ns + i * 10**9, m.fill)
        for i in range(10)
        for m in transforms("odom", "base", drives)
    ]
    bag = write_bag(tmp_path, "mcap-file", [*clouds("base"), *long])
    options = Options(stamp="log", start_s=0.1, duration_s=0.25)
    convert(bag, tmp_path / "out", options=options)
    poses = read_tum(tmp_path / "out/poses.tum")
    frames = sorted((tmp_path / "out/points").iterdir())
    assert len(frames) == 3
    assert poses.stamp_ns[0] == BEGIN_NS
    assert 10**9 < poses.stamp_ns[-1] - BEGIN_NS < 3 * 10**9


@pytest.mark.parametrize("frame", ["odom", "base", "lidar"])
def test_truth_is_turned_into_the_world_at_its_own_time(frame, tmp_path):
    messages = [
        static(MOUNTED),
        *clouds(),
        *transforms("odom", "base", drives),
        *truth(frame),
    ]
    report = convert(write_bag(tmp_path, "ros1", messages), tmp_path / "out")
    assert not any("relates" in note for note in report["notes"])
    rows = np.loadtxt(tmp_path / "out/ground_truth.csv", delimiter=",", skiprows=1)[:, 1:]
    steps = {"odom": 0, "base": 1, "lidar": 2}[frame]
    for i, row in enumerate(rows):
        own = np.array([1.0, 2.0, 3.0 + i])
        way = [MOUNT, drives(i * 0.1)][2 - steps :]
        np.testing.assert_allclose(row, expected_m(own, *way), atol=1e-6)


def test_what_does_not_move_the_lidar_gives_no_poses(tmp_path):
    still = [static(MOUNTED), *clouds(), *transforms("odom", "base", rests)]
    other = transforms("odom", "drone", drives)  # of something else
    for i, messages in enumerate((still, [*still, *other])):
        out = tmp_path / f"out{i}"
        report = convert(write_bag(tmp_path, "ros1", messages, f"bag{i}"), out)
        assert not list(out.glob("*.tum"))
        assert report["poses_topic"] is None
        # As if /tf were not there.
        assert report["common_frame"] == "base"
        assert read_station(out)["points"].translation_m == MOUNTED[2]


def test_transforms_go_before_odometry_and_another_can_be_named(tmp_path, capsys, fails):
    messages = [
        static(MOUNTED),
        *clouds(),
        *transforms("odom", "base", drives),
        *odometry("/wheels", "wheels", "base", lambda t: (drives(t)[0] * 1.1, drives(t)[1])),
        *odometry("/pose", "world", "", nods, POSE),
    ]
    bag = write_bag(tmp_path, "db3-folder", messages)

    def converted(*options: str) -> tuple[dict, str]:
        out = tmp_path / "out"
        capsys.readouterr()
        assert main(["convert", str(bag), str(out), "--force", *options]) == 0
        files = {path.name: read_tum(path) for path in out.glob("*.tum")}
        return files, capsys.readouterr().err

    files, said = converted()
    assert "from /tf" in said
    np.testing.assert_allclose(files["poses.tum"].position_m[0], drives(0)[0])
    files, said = converted("--poses-topic", "/wheels")
    assert "in 'wheels' are taken from /wheels (as asked for)" in said
    np.testing.assert_allclose(files["poses.tum"].position_m[0], drives(0)[0] * 1.1)
    files, said = converted("--poses-topic", "/pose")
    assert "in 'world' are taken from /pose (as asked for)" in said
    np.testing.assert_allclose(files["poses.tum"].position_m[0], nods(0)[0])
    files, said = converted("--poses-topic", "none")
    assert files == {}
    said = fails(2, "convert", bag, tmp_path / "x", "--poses-topic", "/nothing")
    assert "has no topic '/nothing'" in said
    assert "tells of no pose" in fails(
        4, "convert", bag, tmp_path / "x", "--poses-topic", "/points"
    )


def test_odometry_of_something_else_is_not_taken_but_said(tmp_path):
    messages = [static(MOUNTED), *clouds(), *odometry("/odom", "odom", "body", drives)]
    bag = write_bag(tmp_path, "ros1", messages)
    report = convert(bag, tmp_path / "out")
    assert not list((tmp_path / "out").glob("*.tum"))
    assert any("/odom" in note and "--poses-topic" in note for note in report["notes"])
    # Asked for it bears all LiDARs, with their place on it.
    report = convert(bag, tmp_path / "asked", options=Options(poses_topic="/odom"))
    poses = read_tum(tmp_path / "asked/poses.tum")
    np.testing.assert_allclose(poses.position_m[0], drives(0)[0])
    assert read_station(tmp_path / "asked")["points"].translation_m == MOUNTED[2]


def test_a_lidar_at_rest_and_one_that_moves_have_poses_of_their_own(tmp_path):
    messages = [
        static(MOUNTED, ("odom", "mast", (0.0, 9.0, 2.0), STRAIGHT)),
        *clouds(),
        *clouds("mast", "/fixed"),
        *transforms("odom", "base", drives),
    ]
    bag = write_bag(tmp_path, "mcap-file", messages)
    out = tmp_path / "out"
    convert(bag, out)
    assert [path.name for path in out.glob("*.tum")] == ["poses_points.tum"]
    assert read_station(out)["fixed"].translation_m == (0.0, 9.0, 2.0)
    assert read_station(out)["points"].translation_m == MOUNTED[2]
    # Frames that are converted again keep their poses.
    convert(out, tmp_path / "again", ["points"])
    again = read_tum(tmp_path / "again/poses.tum")
    assert again.equals(read_tum(out / "poses_points.tum"))


def test_the_list_says_what_tells_how_a_lidar_moves(tmp_path):
    messages = [*clouds(), *transforms("odom", "base", drives)]
    messages += odometry("/odom", "odom", "base", drives)
    _, streams = list_streams(write_bag(tmp_path, "ros1", messages))
    becomes = {stream.name: stream.becomes for stream in streams}
    assert becomes["/tf"] == "poses where it moves a LiDAR"
    assert becomes["/odom"].startswith("poses where it moves a LiDAR")


def test_stamps_of_the_recorder_count_where_they_are_those_of_the_frames(tmp_path):
    late_ns = 3 * 10**9
    messages = [
        Message(m.topic, m.msgtype, m.log_ns + late_ns, m.fill)
        for m in [*clouds("base"), *transforms("odom", "base", drives)]
    ]
    bag = write_bag(tmp_path, "ros1", messages)
    convert(bag, tmp_path / "header")
    convert(bag, tmp_path / "log", options=Options(stamp="log"))
    by_header, by_log = (read_tum(tmp_path / name / "poses.tum") for name in ("header", "log"))
    assert np.array_equal(by_log.stamp_ns, by_header.stamp_ns + late_ns)


def test_who_reads_frames_in_python_is_told_that_their_lidar_moves(tmp_path, caplog):
    for way, told in ((drives, 1), (rests, 0)):
        messages = [static(MOUNTED), *clouds(), *transforms("odom", "base", way)]
        caplog.clear()
        frames = list(unlidar.read(write_bag(tmp_path, "ros1", messages, way.__name__)))
        assert len(frames) == 5
        assert sum("its LiDARs move" in line for line in caplog.messages) == told
