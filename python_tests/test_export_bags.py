"""Exported recordings, read back with rosbags and with Foxglove's own reader."""

from pathlib import Path

import numpy as np
import pytest
from flights import join_tracks, track_at, truth_at, write_result
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from ruamel.yaml import YAML
from unlidar.cli import main
from unlidar.frames_io import write_pcd
from unlidar.truth import Tracks, read_tracks

TIMES = np.arange(0, 6, 0.1)
KINDS = {"ros1": "out.bag", "ros2 file": "out.mcap", "ros2 folder": "out_bag"}


@pytest.fixture
def result(tmp_path) -> Path:
    """Two tracks with their own sigmas, and the returns taken as target."""
    rng = np.random.default_rng(2)
    tracks = join_tracks(track_at(TIMES[:20]), track_at(TIMES, [12.0, -3, 2], 4.0))
    tracks = Tracks(
        tracks.time_s, tracks.track_id, tracks.xyz_m, rng.uniform(0.01, 1, (len(tracks), 3))
    )
    folder = write_result(tmp_path / "flight", truth_at(TIMES), tracks)
    write_pcd(folder / "target_returns.pcd", rng.normal(0, 5, (33, 3)))
    return folder


def write(result: Path, kind: str, *options: str) -> Path:
    out = result.parent / KINDS[kind]
    form = ["--format", "mcap"] if kind == "ros2 folder" else []
    assert main(["export", str(result), str(out), *form, *options]) == 0
    return out


def messages(path: Path) -> dict[str, list[tuple[int, object]]]:
    found: dict[str, list[tuple[int, object]]] = {}
    with AnyReader([path]) as reader:
        for connection, stamp_ns, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            found.setdefault(connection.topic, []).append((stamp_ns, message))
    return found


def stamp_ns(header) -> int:
    return header.stamp.sec * 1_000_000_000 + header.stamp.nanosec


def xyz(vector) -> list[float]:
    return [vector.x, vector.y, vector.z]


@pytest.mark.parametrize("kind", KINDS)
def test_every_row_comes_back_with_its_numbers(kind, result):
    found = messages(write(result, kind, "--frame-id", "station"))
    tracks = read_tracks(result / "traj.csv")
    for track in (0, 4):
        rows = tracks.track_id == track
        odometry = found[f"/unlidar/track_{track}/odometry"]
        stamps = tracks.stamp_ns[rows].tolist()
        assert [log for log, _ in odometry] == stamps
        assert [stamp_ns(m.header) for _, m in odometry] == stamps
        assert {m.header.frame_id for _, m in odometry} == {"station"}
        assert {m.child_frame_id for _, m in odometry} == {f"track_{track}"}
        assert [xyz(m.pose.pose.position) for _, m in odometry] == tracks.xyz_m[rows].tolist()
        assert [xyz(m.twist.twist.linear) for _, m in odometry] == (
            tracks.velocity_mps[rows].tolist()
        )
        for (_, m), sigma in zip(odometry, tracks.sigma_m[rows], strict=True):
            covariance = m.pose.covariance.reshape(6, 6)
            assert np.array_equal(covariance[:3, :3], np.diag(sigma**2))
            assert (np.diag(covariance)[3:] > 1).all()  # the attitude is not known
            assert np.array_equal(covariance, covariance.T)

        ((log, path),) = found[f"/unlidar/track_{track}/path"]
        assert log == stamp_ns(path.header) == stamps[0]
        assert path.header.frame_id == "station"
        assert [stamp_ns(p.header) for p in path.poses] == stamps
        assert {p.header.frame_id for p in path.poses} == {"station"}
        assert [xyz(p.pose.position) for p in path.poses] == tracks.xyz_m[rows].tolist()
        assert all(p.pose.orientation.w == 1.0 for p in path.poses)


@pytest.mark.parametrize("kind", KINDS)
def test_the_target_returns_come_back_bit_by_bit(kind, result):
    ((_, cloud),) = messages(write(result, kind))["/unlidar/target_returns"]
    assert cloud.header.frame_id == "map"
    assert [(f.name, f.offset, f.datatype, f.count) for f in cloud.fields] == [
        ("x", 0, 7, 1), ("y", 4, 7, 1), ("z", 8, 7, 1),
    ]  # fmt: skip
    assert (cloud.width, cloud.height, cloud.point_step, cloud.row_step) == (33, 1, 12, 396)
    written = (result / "target_returns.pcd").read_bytes()[-396:]
    assert cloud.data.tobytes() == written


@pytest.mark.parametrize("kind", KINDS)
def test_other_returns_or_none_can_go_along(kind, result, tmp_path):
    write_pcd(tmp_path / "other.pcd", np.ones((2, 3)))
    ((_, cloud),) = messages(write(result, kind, "--points", str(tmp_path / "other.pcd")))[
        "/unlidar/target_returns"
    ]
    assert cloud.width == 2
    (result / "target_returns.pcd").unlink()
    if kind != "ros2 folder":  # which is not replaced
        assert "/unlidar/target_returns" not in messages(write(result, kind))


@pytest.mark.parametrize("kind", ["ros2 file", "ros2 folder"])
def test_foxgloves_reader_sees_the_same_messages(kind, result):
    out = write(result, kind)
    path = out if out.is_file() else out / "out_bag.mcap"
    tracks = read_tracks(result / "traj.csv")
    seen: dict[str, list] = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for schema, channel, record, message in reader.iter_decoded_messages():
            seen.setdefault(channel.topic, []).append((schema.name, record.log_time, message))
    assert {entries[0][0] for entries in seen.values()} == {
        "nav_msgs/msg/Path", "nav_msgs/msg/Odometry", "sensor_msgs/msg/PointCloud2",
    }  # fmt: skip
    odometry = seen["/unlidar/track_4/odometry"]
    rows = tracks.track_id == 4
    assert [log for _, log, _ in odometry] == tracks.stamp_ns[rows].tolist()
    assert [xyz(m.pose.pose.position) for *_, m in odometry] == tracks.xyz_m[rows].tolist()


def test_what_holds_for_the_whole_flight_is_kept_for_late_subscribers(result):
    bag = write(result, "ros1")
    with AnyReader([bag]) as reader:
        latched = {c.topic: c.ext.latching for c in reader.connections}
    folder = write(result, "ros2 folder")
    metadata = YAML(typ="safe").load(folder / "metadata.yaml")["rosbag2_bagfile_information"]
    assert metadata["storage_identifier"] == "mcap"
    assert metadata["relative_file_paths"] == ["out_bag.mcap"]
    assert (folder / "out_bag.mcap").is_file()
    for entry in metadata["topics_with_message_count"]:
        topic, qos = (
            entry["topic_metadata"]["name"],
            entry["topic_metadata"]["offered_qos_profiles"],
        )
        kept = topic.endswith(("path", "target_returns"))
        assert latched[topic] == kept
        assert ([q["durability"] for q in qos] == ["transient_local"]) == kept, qos


def test_messages_lie_in_order_of_time(result):
    with write(result, "ros2 file").open("rb") as file:
        records = make_reader(file).iter_messages(log_time_order=False)
        stamps = [record.log_time for _, _, record in records]
    assert stamps == sorted(stamps)
    assert len(stamps) == 20 + 60 + 2 + 1


def test_a_folder_with_anything_in_it_is_not_replaced(result, fails):
    out = result.parent / "kept"
    out.mkdir()
    (out / "note.txt").write_text("mine")
    assert "exists already" in fails(5, "export", result, out, "--format", "mcap")
    assert [p.name for p in out.iterdir()] == ["note.txt"]


def test_a_stamp_that_no_header_holds_is_refused(tmp_path, fails):
    late = tmp_path / "traj.csv"
    late.write_text("timestamp,track_id,x,y,z\n5000000000,0,1,2,3\n")
    for name in ("a.bag", "a.mcap"):
        assert "5000000000" in fails(4, "export", late, tmp_path / name)
        assert not (tmp_path / name).exists()
    late.write_text("timestamp,track_id,x,y,z\n-1,0,1,2,3\n")
    assert "-1" in fails(4, "export", late, tmp_path / "a.bag")
