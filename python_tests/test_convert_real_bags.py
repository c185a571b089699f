"""The real recordings of ../shared: what the converter makes of each, point by point."""

import tarfile
from pathlib import Path

import numpy as np
import pytest
from bags import read_xyz, returns_of
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from unlidar.cli import main

BAGS = "data/formats/bags"


def unpack_below(archive: tarfile.TarFile, folder: Path) -> None:
    """The regular files of an archive; Python 3.11.2 has no filter that keeps them in a folder."""
    for member in filter(tarfile.TarInfo.isfile, archive):
        path = (folder / member.name).resolve()
        assert path.is_relative_to(folder.resolve()), member.name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(archive.extractfile(member).read())


@pytest.fixture(scope="module")
def depth_camera(shared, tmp_path_factory) -> Path:
    """The ROS 2 recording of a depth camera, unpacked."""
    folder = tmp_path_factory.mktemp("depth_camera")
    with tarfile.open(shared / BAGS / "ros2_pointcloud2_mcap.tar.xz") as archive:
        unpack_below(archive, folder)
    return next(path for path in folder.iterdir() if path.is_dir())


def clouds_of(bag: Path) -> list[tuple[str, int, np.ndarray]]:
    """(name by header stamp, log time, x y z) of every PointCloud2, read without the converter."""
    found = []
    store = get_typestore(Stores.ROS2_HUMBLE)
    with AnyReader([bag], default_typestore=store) as reader:
        for connection, log_ns, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            stamp = message.header.stamp
            at = {field.name: field.offset for field in message.fields}
            rows = np.asarray(message.data).reshape(-1, message.point_step)
            xyz = [rows[:, at[a] : at[a] + 4].copy().view("<f4")[:, 0] for a in "xyz"]
            name = f"{stamp.sec}.{stamp.nanosec:09d}.pcd"
            found.append((name, log_ns, np.stack(xyz, axis=1)))
    return found


def check_all_points(bag: Path, folder: Path, every: int) -> None:
    clouds = clouds_of(bag)
    assert sorted(path.name for path in folder.iterdir()) == sorted(name for name, _, _ in clouds)
    for name, _, xyz in clouds[::every]:
        np.testing.assert_array_equal(read_xyz(folder / name), xyz[returns_of(xyz)])


def test_a_ros_1_bag_of_a_spinning_lidar_arrives_whole(shared, tmp_path, capsys):
    bag = shared / BAGS / "ros1_pointcloud2.bag"
    assert main(["convert", str(bag), str(tmp_path / "out")]) == 0
    said = capsys.readouterr()
    assert "124914" in said.out
    assert "header stamps and log times differ" in said.err
    check_all_points(bag, tmp_path / "out/pointcloud2", every=1)


def test_a_ros_2_mcap_arrives_whole_and_its_two_clocks_are_reported(depth_camera, tmp_path, capsys):
    assert main(["convert", str(depth_camera), str(tmp_path / "out")]) == 0
    assert "--stamp log" in capsys.readouterr().err
    check_all_points(depth_camera, tmp_path / "out/point_cloud", every=40)


def test_single_file_log_stamps_window_and_merge_of_a_ros_2_mcap(depth_camera, tmp_path):
    file = next(depth_camera.glob("*.mcap"))
    options = ["--stamp", "log", "--start", "2", "--duration", "1.5", "--merge", "4"]
    assert main(["convert", str(file), str(tmp_path / "out"), *options]) == 0
    clouds = clouds_of(file)
    begin_ns = clouds[0][1] + 2 * 10**9
    inside = [cloud for cloud in clouds if begin_ns <= cloud[1] < begin_ns + 1_500_000_000]
    groups = [inside[i : i + 4] for i in range(0, len(inside), 4)]
    names = [f"{g[0][1] // 10**9}.{g[0][1] % 10**9:09d}.pcd" for g in groups]
    assert sorted(path.name for path in (tmp_path / "out/point_cloud").iterdir()) == names
    first = np.concatenate([xyz[returns_of(xyz)] for _, _, xyz in groups[0]])
    np.testing.assert_array_equal(read_xyz(tmp_path / "out/point_cloud" / names[0]), first)


@pytest.mark.parametrize(
    ("bag", "holds"),
    [
        ("ros1_no_cloud.bag", "/data (std_msgs/Float64)"),
        ("ros2_no_cloud_mcap", "/topic (std_msgs/String)"),
        ("ros2_no_cloud_mcap/talker.mcap", "/topic (std_msgs/String)"),
        ("ros2_empty_db3", "/rosout (rcl_interfaces/Log, no messages)"),
        ("ros2_empty_db3/empty_bag_0.db3", "/rosout (rcl_interfaces/Log, no messages)"),
    ],
)
def test_a_bag_without_clouds_is_refused_with_what_it_holds(bag, holds, shared, tmp_path, fails):
    line = fails(4, "convert", shared / BAGS / bag, tmp_path / "out")
    assert "no topic with clouds" in line
    assert holds in line
    assert not (tmp_path / "out").exists()
    assert main(["convert", str(shared / BAGS / bag), "--list"]) == 0


def test_a_real_bag_goes_through_run(shared, tmp_path, program, monkeypatch):
    monkeypatch.setenv("UNLIDAR_TRACK", str(program))
    bag = shared / BAGS / "ros1_pointcloud2.bag"
    assert main(["run", str(bag), "--out", str(tmp_path / "out")]) == 0
    assert (tmp_path / "out/traj.csv").is_file()
