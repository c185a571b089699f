"""`unlidar.read`: the frames of a recording without files are those that a conversion writes."""

from __future__ import annotations

import shutil
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
import unlidar
from bags import BEGIN_NS, plain_cloud, random_points, write_bag
from live_program import write_two_sensors
from livox_sensor import Packet, protocol2, sweep
from pcap_files import udp_frame, write_pcap
from synthetic import make_flight, read_traj, seconds, track
from unlidar import capture, reading
from unlidar.frames_io import find_sensors, list_frames, read_pcd

KINDS = (
    "bags/ros1_pointcloud2.bag",
    "captures/mrpt_sample_velodyne_hdl32.pcap",
    "captures/OS-1-32-G_v2.1.1_1024x10.pcap",
)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("two")
    write_two_sensors(folder, make_flight(frames=30))
    return folder


def converted(recording: Path, out: Path, **how) -> list[unlidar.Frame]:
    """The frames that a conversion writes, in order of time."""
    unlidar.convert(recording, out, **how)
    frames = []
    for name, folder in find_sensors(out).items():
        for file in list_frames(folder):
            columns = read_pcd(file.path)
            xyz = np.stack([columns[axis] for axis in "xyz"], axis=1)
            frames.append(unlidar.Frame(name, file.stamp_ns, xyz, columns.get("offset_time")))
    return sorted(frames, key=lambda frame: (frame.stamp_ns, frame.sensor))


def assert_same(found: list[unlidar.Frame], expected: list[unlidar.Frame]) -> None:
    assert [f[:2] for f in found] == [f[:2] for f in expected]
    for one, other in zip(found, expected, strict=True):
        assert one.xyz.dtype == np.float32
        np.testing.assert_array_equal(one.xyz, other.xyz)
        assert (one.offsets_ns is None) == (other.offsets_ns is None)
        if one.offsets_ns is not None:
            assert one.offsets_ns.dtype == np.int64
            np.testing.assert_array_equal(one.offsets_ns, other.offsets_ns)


def test_sensors_come_in_order_of_time(recording: Path, tmp_path: Path) -> None:
    frames = list(unlidar.read(recording))
    assert [frame.sensor for frame in frames] == ["left", "right"] * 30
    assert_same(frames, converted(recording, tmp_path / "out"))


def test_track_takes_the_poses_of_the_recording_unless_a_config_has_its_own(
    recording: Path, tmp_path: Path
) -> None:
    """Its rows are those of the program whose first sensor is the recording's, not the earlier."""
    placed = tmp_path / "placed"
    shutil.copytree(recording, placed)
    poses = "sensors:\n  upper: {translation_m: [3, 0, 0]}\n  right: {translation_m: [3, 0, 0]}\n"
    (placed / "station.yaml").write_text(poses)
    own = tmp_path / "own.yaml"
    own.write_text(poses.replace("[3, 0, 0]", "[0, 5, 0]"))
    (placed / "left").rename(placed / "upper")
    folders = [f"{name}={placed / name}" for name in ("right", "upper")]
    for config, settings in ((None, None), (own, None), (own, {"robust.min_plots": 6})):
        chosen = config or placed / "station.yaml"
        options = [f"{key}={value}" for key, value in (settings or {}).items()]
        sets = [part for option in options for part in ("--set", option)]
        track(folders, tmp_path / "traj.csv", "--config", chosen, *sets)
        (found,) = unlidar.track(unlidar.read(placed), config, settings)
        expected = read_traj(tmp_path / "traj.csv")
        assert len(found.rows) > 5
        assert [seconds(int(at_ns)) for at_ns in found.rows["timestamp_ns"]] == expected.stamps
        xyz = np.stack([found.rows[axis] for axis in "xyz"], axis=1)
        np.testing.assert_allclose(xyz, expected.position_m, atol=1e-6)
    assert unlidar.read(recording).settings == {}
    settings = unlidar.read(placed, sensors=["upper"]).settings
    assert settings["sensors.upper.translation_m"] == (3.0, 0.0, 0.0)
    unlidar.Engine(settings=settings).close()


def test_track_takes_the_stamps_of_mmaud_for_the_ends_of_frames_as_run_does(
    shared: Path, tmp_path: Path
) -> None:
    """Unless a configuration or a setting says otherwise; its conversion is known for MMAUD's."""
    sequence = shared / "data/mmaud/val/seq0001"
    expected = read_traj(unlidar.run(sequence, tmp_path / "out", report=False).trajectory)
    converted(sequence, tmp_path / "frames")
    for recording in (sequence, tmp_path / "frames"):
        (found,) = unlidar.track(unlidar.read(recording))
        xyz = np.stack([found.rows[axis] for axis in "xyz"], axis=1)
        np.testing.assert_allclose(xyz, expected.position_m, atol=1e-6)
    own = tmp_path / "own.yaml"
    own.write_text("robust:\n  min_plots: 6\n")
    begins = {"input.stamp": "begin"}
    for config, settings in ((own, None), (None, begins), (own, begins)):
        (found,) = unlidar.track(unlidar.read(sequence), config, settings)
        off_m = np.abs(found.rows["x"][:50] - expected.position_m[:50, 0])
        assert off_m.max() > 0.01, (config, settings)


def test_frames_are_read_once(recording: Path) -> None:
    frames = unlidar.read(recording)
    assert len(list(islice(frames, 10))) == 10
    assert len(list(frames)) == 50
    for again in (list, unlidar.track):
        with pytest.raises(unlidar.UsageError, match="have been read"):
            again(frames)
    assert next(frames, None) is None


def test_frames_that_ended_with_an_error_are_read_no_second_time(
    recording: Path, tmp_path: Path
) -> None:
    broken = Path(shutil.copytree(recording, tmp_path / "broken"))
    bad = list_frames(find_sensors(broken)["right"])[5].path
    bad.write_text("no PCD")
    frames = unlidar.read(broken)
    with pytest.raises(unlidar.InputError, match=bad.name):
        list(frames)
    with pytest.raises(unlidar.UsageError, match="have been read"):
        list(frames)


@pytest.mark.parametrize(
    "how",
    [
        {"sensors": ["right"]},
        {"options": unlidar.ConvertOptions(start_s=0.5)},
        {"options": unlidar.ConvertOptions(start_s=0.2, duration_s=0.35)},
        {"options": unlidar.ConvertOptions(merge=3)},
    ],
)
def test_options_are_those_of_convert(how, recording: Path, tmp_path: Path) -> None:
    frames = list(unlidar.read(recording, **how))
    assert 0 < len(frames) < 60
    assert_same(frames, converted(recording, tmp_path / "out", **how))


@pytest.mark.parametrize("name", KINDS)
def test_recordings_of_other_kinds_are_read(name: str, shared: Path, tmp_path: Path) -> None:
    path = shared / "data/formats" / name
    frames = list(unlidar.read(path))
    assert [frame.stamp_ns for frame in frames] == sorted(frame.stamp_ns for frame in frames)
    assert_same(frames, converted(path, tmp_path / "out"))


def test_of_a_damaged_bag_the_beginning_is_given(tmp_path: Path, caplog) -> None:
    """Of its two topics one comes late, as a recorder mixes them."""
    late_ns = {"/a": 0, "/b": 300_000_000}
    messages = [
        plain_cloud(topic, log_ns - late_ns[topic], random_points(seed, 4000), log_ns)
        for seed, log_ns in enumerate(range(BEGIN_NS, BEGIN_NS + 12 * 10**8, 10**8))
        for topic in late_ns
    ]
    bag = write_bag(tmp_path, "ros1", messages)
    whole = list(unlidar.read(bag))
    assert len(whole) == 24
    bag.write_bytes(bag.read_bytes()[: int(bag.stat().st_size * 0.7)])
    frames = list(unlidar.read(bag))
    assert 12 <= len(frames) < 24
    assert_same(frames, converted(bag, tmp_path / "out"))
    assert any("the part before it is given" in message for message in caplog.messages)


def datagrams(sensor: int, packets: list[Packet], late_ns: int = 0) -> list[tuple[int, bytes]]:
    """What a sensor sends, with the times at which it is captured."""
    source = f"192.168.1.{sensor}"
    return [(p.stamp_ns + late_ns, udp_frame(protocol2(p), source)) for p in packets]


@pytest.fixture(scope="module")
def packets() -> list[Packet]:
    return sweep(make_flight(frames=20))


def test_a_capture_is_read_as_often_of_three_sensors_as_of_one(
    packets: list[Packet], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent = sorted(part for sensor in (12, 13, 14) for part in datagrams(sensor, packets))
    file = write_pcap(tmp_path / "three.pcap", sent)
    read = []
    datagrams_of = capture._datagrams_of

    def counted(path: Path):
        for datagram in datagrams_of(path):
            read.append(datagram.sensor)
            yield datagram

    monkeypatch.setattr(capture, "_datagrams_of", counted)
    alone = list(unlidar.read(file, sensors=["192-168-1-13"]))
    once = len(read)
    frames = list(unlidar.read(file))
    assert len(read) == 2 * once
    assert once < 2.1 * len(sent)  # for the sensors, and for the frames
    assert len(frames) == 3 * len(alone) == 60
    monkeypatch.undo()
    assert_same(frames, converted(file, tmp_path / "out"))


def test_frames_that_wait_for_those_of_another_sensor_are_bounded(
    packets: list[Packet], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One sensor's packets come 5 s late, another's end early: the order is that of the stamps."""
    sent = sorted(
        [
            *datagrams(12, packets),
            *datagrams(13, packets, late_ns=5_000_000_000),
            *datagrams(14, packets[: len(packets) // 4]),
        ]
    )
    file = write_pcap(tmp_path / "late.pcap", sent)
    names = ["192-168-1-12", "192-168-1-13", "192-168-1-14"]
    expected = converted(file, tmp_path / "out")
    assert len(expected) == 45
    held, read_on = [], reading._Reading._read_on

    def counted(one: reading._Reading, sensor: str) -> bool:
        found = read_on(one, sensor)
        held.append(sum(map(len, one._held.values())))
        return found

    monkeypatch.setattr(reading._Reading, "_read_on", counted)
    monkeypatch.setattr(reading, "_size", lambda frame: 1)
    for bound in (100, 10, 2, 0):
        held.clear()
        monkeypatch.setattr(reading, "_MOST_HELD", bound)
        assert_same(list(unlidar.read(file, sensors=names)), expected)
        assert max(held) <= bound + 3


def test_errors_come_at_once(recording: Path, tmp_path: Path) -> None:
    with pytest.raises(unlidar.InputError, match="does not exist"):
        unlidar.read(tmp_path / "absent.bag")
    with pytest.raises(unlidar.UsageError, match="has no sensor 'roof', it holds left, right"):
        unlidar.read(recording, sensors=["roof"])
    with pytest.raises(unlidar.UsageError, match="list of names"):
        unlidar.read(recording, sensors="left")
    with pytest.raises(unlidar.InputError, match="no frame lies in the time asked for"):
        list(unlidar.read(recording, options=unlidar.ConvertOptions(start_s=1000)))
