"""Captured packets of Livox LiDARs: `unlidar convert` and `unlidar play`."""

from __future__ import annotations

import json
import shutil
import signal
import socket
import struct
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import unlidar
from livox_sensor import (
    BEGIN_NS,
    CARTESIAN_CM,
    CARTESIAN_MM,
    RAY_NS,
    RAYS,
    SPHERICAL,
    Listening,
    Packet,
    accelerations2,
    protocol1,
    protocol2,
    spherical,
    sweep,
    write_as_frames,
)
from pcap_files import udp_frame, write_pcap, write_pcapng
from scipy.spatial.transform import Rotation
from synthetic import make_flight, track
from unlidar import livox
from unlidar.cli import main
from unlidar.frames_io import list_frames, read_pcd
from unlidar.point_times import OFFSET_FIELD
from unlidar.station import read_station


@pytest.fixture(scope="module")
def packets() -> list[Packet]:
    return sweep(make_flight())


@pytest.fixture(scope="module")
def capture(packets: list[Packet], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Every second packet of two LiDARs, accelerations and other traffic."""
    frames = []
    for k, packet in enumerate(packets):
        source, payload = ("192.168.1.12", protocol2(packet, counter=k // 2))
        if k % 2:
            source, payload = "192.168.1.13", protocol1(packet)
        sent_ns = packet.stamp_ns + RAYS * RAY_NS
        frames.append((sent_ns, udp_frame(payload, source)))
        if k % 10 == 0:
            frames.append((sent_ns, udp_frame(accelerations2(k), source, 56400, 56401)))
            frames.append((sent_ns, udp_frame(b"\xaa" + bytes(30), source, 56200, 56201)))
            frames.append((sent_ns, b"\xff" * 60))
    return write_pcap(tmp_path_factory.mktemp("capture") / "station.pcap", frames)


# --- convert ------------------------------------------------------------------------------------


def test_a_capture_becomes_the_frames_of_its_points(
    capture: Path, packets: list[Packet], tmp_path: Path, capsys
) -> None:
    assert main(["convert", str(capture), str(tmp_path / "out")]) == 0
    assert "192-168-1-12 60 frames" in capsys.readouterr().out
    for part, name in enumerate(("192-168-1-12", "192-168-1-13")):
        expected = write_as_frames(tmp_path / name, packets[part::2])
        got = list_frames(tmp_path / "out" / name)
        assert len(got) == 60
        for one, other in zip(got, list_frames(expected), strict=True):
            assert one.stamp_ns == other.stamp_ns
            a, b = read_pcd(one.path), read_pcd(other.path)
            returns = (b["x"] != 0) | (b["y"] != 0) | (b["z"] != 0)
            for axis in "xyz":
                np.testing.assert_array_equal(a[axis], b[axis][returns])
            if part == 0:  # packets of the other protocol do not say how long they take
                np.testing.assert_array_equal(a[OFFSET_FIELD], b["t"][returns])


def test_a_converted_capture_gives_the_rows_of_its_packets(
    packets: list[Packet], tmp_path: Path
) -> None:
    """Two readers of the protocol, one in C++ and one in Python."""
    for number, make in enumerate((protocol2, lambda p: protocol2(p, SPHERICAL), protocol1)):
        sent = [make(packet) for packet in packets]
        folder = tmp_path / str(number)
        folder.mkdir()
        frames = [
            (p.stamp_ns, udp_frame(d, "127.0.0.1")) for p, d in zip(packets, sent, strict=True)
        ]
        file = write_pcap(folder / "a.pcap", frames)
        assert main(["convert", str(file), str(folder / "out")]) == 0
        track([f"127-0-0-1={folder / 'out' / '127-0-0-1'}"], folder / "a.csv")
        endless = ("--set", "live.delay_s=.inf", "--set", "live.window_s=.inf")
        with Listening("--out", folder / "b.csv", *endless) as live:
            live.receive(sent)
            code, _, said = live.end(signal.SIGTERM)
        assert code == 0, said
        a, b = (np.genfromtxt(folder / n, delimiter=",", skip_header=1) for n in ("a.csv", "b.csv"))
        assert len(a) > 20
        np.testing.assert_allclose(a, b, atol=1e-3)


def test_list_and_a_part_of_a_capture(capture: Path, tmp_path: Path, capsys) -> None:
    assert main(["convert", str(capture), "--list"]) == 0
    assert "Livox packets" in (listed := capsys.readouterr().out)
    assert "192-168-1-13" in listed
    out = tmp_path / "out"
    part = ["--sensors", "192-168-1-13", "--start", "2", "--duration", "1"]
    assert main(["convert", str(capture), str(out), *part]) == 0
    assert [p.name for p in out.iterdir() if p.is_dir()] == ["192-168-1-13"]
    assert len(list_frames(out / "192-168-1-13")) == 10


def test_captures_of_every_kind_give_the_same(packets: list[Packet], tmp_path: Path) -> None:
    """pcapng; packets as `tcpdump -i any` has them, of a tunnel, and of a loopback."""
    frames = [(p.stamp_ns, udp_frame(protocol2(p), "10.0.0.9")) for p in packets[:60]]
    ips = [(time_ns, frame[14:]) for time_ns, frame in frames]
    cooked = [(t, b"\0\0\0\1\0\6" + bytes(8) + b"\x08\0" + ip) for t, ip in ips]
    cooked2 = [(t, b"\x08\0" + bytes(18) + ip) for t, ip in ips]
    null = [(t, b"\2\0\0\0" + ip) for t, ip in ips]
    files = [
        write_pcap(tmp_path / "plain.pcap", frames),
        write_pcapng(tmp_path / "blocks.pcapng", frames),
        write_pcap(tmp_path / "cooked.pcap", cooked, 113),
        write_pcap(tmp_path / "cooked2.pcap", cooked2, 276),
        write_pcap(tmp_path / "null.pcap", null, 0),
        write_pcap(tmp_path / "raw.pcap", ips, 101),
    ]
    contents = []
    for file in files:
        assert main(["convert", str(file), str(tmp_path / file.stem)]) == 0, file
        folder = tmp_path / file.stem / "10-0-0-9"
        contents.append({p.name: p.read_bytes() for p in folder.iterdir()})
    assert len(contents[0]) == 3
    assert all(content == contents[0] for content in contents)


def test_what_comes_twice_or_late_is_left_out_and_said(
    packets: list[Packet], tmp_path: Path
) -> None:
    sent = [(p.stamp_ns, protocol2(p)) for p in packets[:200]]
    sent += [sent[-1], sent[0]]
    file = write_pcap(tmp_path / "a.pcap", [(t, udp_frame(d, "10.0.0.9")) for t, d in sent])
    assert main(["convert", str(file), str(tmp_path / "out")]) == 0
    notes = json.loads((tmp_path / "out" / "conversion.json").read_text())["notes"]
    assert notes == ["10-0-0-9: left out 1 packets that came twice, 1 packets that came too late"]


def test_a_sensor_without_synchronisation_has_the_time_of_the_capture(
    packets: list[Packet], tmp_path: Path
) -> None:
    frames = []
    for packet in packets[:100]:
        payload = protocol2(packet, time_type=0, stamp_ns=packet.stamp_ns - BEGIN_NS + 5)
        frames.append((packet.stamp_ns + 7_000_000_000, udp_frame(payload, "10.0.0.9")))
    file = write_pcap(tmp_path / "a.pcap", frames)
    assert main(["convert", str(file), str(tmp_path / "out")]) == 0
    first = list_frames(tmp_path / "out" / "10-0-0-9")[0]
    assert abs(first.stamp_ns - BEGIN_NS - 7_000_000_000) < 110_000_000


@pytest.mark.parametrize("drift_ppm", [-150, 0, 150])
def test_the_clock_of_such_a_sensor_is_followed(
    drift_ppm: int, packets: list[Packet], tmp_path: Path
) -> None:
    """As live. Packets come 40 ms apart, 1 to 3 ms late; a minute of drift is 9 ms."""
    rng = np.random.default_rng(1)
    of_ns = BEGIN_NS + 40_000_000 * np.arange(1500)
    frames = []
    for sent_ns, late_ns in zip(of_ns.tolist(), rng.integers(1e6, 3e6, 1500).tolist(), strict=True):
        since_ns = round((sent_ns - BEGIN_NS) * (1 + drift_ppm * 1e-6))
        full = replace(packets[0], units=np.full((RAYS, 3), 1000))
        payload = protocol2(full, time_type=0, stamp_ns=since_ns + 5, counter=len(frames))
        frames.append((sent_ns + late_ns, udp_frame(payload, "10.0.0.9")))
    found = list(unlidar.read(write_pcap(tmp_path / "a.pcap", frames)))
    first_ns = np.array([frame.stamp_ns + int(frame.offsets_ns[0]) for frame in found])
    nearest = np.rint((first_ns - BEGIN_NS) / 40e6).astype(int)
    late_ms = (first_ns - of_ns[nearest]) * 1e-6
    assert len(found) > 500
    assert late_ms.min() > 0.5 and late_ms.max() < 3.5


OTHER = struct.pack("<IIII", 1, 0, 4, 4) + b"wlan"  # a packet


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"", "is cut off at byte 0, after packet 0"),
        (b"rubbish" * 20, "not a readable capture"),
        (b"\xd4\xc3\xb2\xa1\2\0\4\0" + bytes(12) + b"\1\0\0\0", "holds no points of a Livox LiDAR"),
        (b"\xd4\xc3\xb2\xa1\2\0\4\0" + bytes(12) + b"\x69\0\0\0" + OTHER, "of kind 105, "),
    ],
)
def test_a_file_that_is_none_is_an_input_error(
    content: bytes, expected: str, tmp_path: Path, fails
) -> None:
    file = tmp_path / "x.pcap"
    file.write_bytes(content)
    assert expected in fails(4, "convert", file, tmp_path / "out")
    assert expected in fails(4, "play", file, "--to", "127.0.0.1:9")
    assert not (tmp_path / "out").exists()


def test_options_of_bags_are_refused(capture: Path, tmp_path: Path, fails) -> None:
    said = fails(2, "convert", capture, tmp_path / "out", "--topic", "/a")
    assert "holds packets, --topic is for bags" in said
    said = fails(2, "convert", capture, tmp_path / "out", "--origin", "47,8,400")
    assert "holds packets, --origin is for bags" in said


def test_a_capture_that_was_cut_off_keeps_what_came_before(
    capture: Path, tmp_path: Path, fails
) -> None:
    file, size = tmp_path / "cut.pcap", capture.stat().st_size // 2
    file.write_bytes(capture.read_bytes()[:size])
    said = fails(4, "convert", file, tmp_path / "out")
    assert f"{file}: is cut off at byte {size:,}, after packet " in said
    assert len(list_frames(tmp_path / "out" / "192-168-1-12")) >= 29
    series = tmp_path / "series"  # of a recorder that was killed and started again
    series.mkdir()
    for number, source in enumerate((file, capture), 1):
        shutil.copy(source, series / f"packets_{number}_20240126T201500Z.pcap")
    assert main(["convert", str(series), str(tmp_path / "both")]) == 0
    assert len(list_frames(tmp_path / "both" / "192-168-1-12")) >= 59
    last = Path(shutil.copy(file, series / "packets_3_20240126T201500Z.pcap"))
    assert f"{last}: is cut off at byte" in fails(4, "convert", series, tmp_path / "cut")


# --- the maker's viewer -------------------------------------------------------------------------

SERIALS = [b"47MDK9DF710030", b"47MDK9DF710195"]
# Roll, pitch and yaw in degrees, then metres; the second LiDAR looks up and stands 2 m off.
POSES = [(0.0,) * 6, (0.0, -90.0, 90.0, 2.0, 0.5, -1.0)]


def accelerations1() -> bytes:
    return struct.pack("<BBBxIBBQ6f", 5, 1, 1, 0, 1, 6, BEGIN_NS, 0, 0, 0, 0, 0, 1)


def viewer_file(
    version: tuple[int, int],
    packets: list[Packet],
    serials: list[bytes],
    poses: list[tuple[float, ...]] = POSES,
    uses_poses: bool = True,
) -> bytes:
    """As the makers' viewers write them: blocks of 50 ms, packets of the LiDARs in turn."""
    data = b"livox_tech".ljust(16, b"\0") + bytes([*version, 0, 0])
    data += struct.pack("<I", 0xAC0EA767)
    data += struct.pack("<B" if version == (1, 0) else "<xxxxB", len(serials))
    for k, (serial, pose) in enumerate(zip(serials, poses, strict=False)):
        if version == (1, 0):
            data += struct.pack("<16s16sBB6f", serial, b"", k, 1, *pose)
        elif version == (1, 1):
            data += struct.pack("<16s16sBBB6f", serial, b"", k, 3, uses_poses, *pose)
        else:
            data += struct.pack("<16s16sIBBB6f", serial, b"", 1000 + k, 9, 9, uses_poses, *pose)
    for index in range(0, len(packets), 10):
        block = b""
        for p in packets[index : index + 10]:
            lidar = p.number % len(serials)
            if version[0] == 1:
                block += bytes([lidar]) + protocol1(p)
                if version == (1, 1) and p.number % 7 == 0:
                    block += bytes([lidar]) + accelerations1()
                continue
            points = protocol2(p)[36:]
            head = (0, 1000 + lidar, 8, 1, p.stamp_ns, p.number % 65536, 1, len(points), 0)
            block += struct.pack("<BIBBQHBIB4x", *head) + points
        count = struct.pack("<Q", 10) if version == (1, 0) else b""
        after = len(data) + 24 + len(count) + len(block)
        is_last = version[0] == 2 and index + 10 >= len(packets)
        data += struct.pack("<QQQ", len(data), 0 if is_last else after, index // 10)
        data += count + block
    return data


VERSIONS = pytest.mark.parametrize(
    ("version", "name"), [((1, 0), "a.lvx"), ((1, 1), "a.lvx"), ((2, 0), "a.lvx2")]
)


@VERSIONS
def test_a_file_of_the_viewer_becomes_the_frames_of_its_points(
    version: tuple[int, int], name: str, packets: list[Packet], tmp_path: Path
) -> None:
    file = tmp_path / name
    file.write_bytes(viewer_file(version, packets, SERIALS))
    assert main(["convert", str(file), str(tmp_path / "out")]) == 0
    for part, serial in enumerate(s.decode() for s in SERIALS):
        expected = list_frames(write_as_frames(tmp_path / serial, packets[part::2]))
        got = list_frames(tmp_path / "out" / serial)
        assert [f.stamp_ns for f in got] == [f.stamp_ns for f in expected]
        for one, other in zip(got, expected, strict=True):
            a, b = read_pcd(one.path), read_pcd(other.path)
            returns = (b["x"] != 0) | (b["y"] != 0) | (b["z"] != 0)
            for axis in "xyz":
                np.testing.assert_array_equal(a[axis], b[axis][returns])
            # A packet is taken to last until the next one of its LiDAR begins.
            late_ns = a[OFFSET_FIELD].astype(float) - b["t"][returns]
            assert (late_ns >= -1).all() and (late_ns < RAYS * RAY_NS).all()


@VERSIONS
def test_poses_of_the_viewer_place_the_lidars(
    version: tuple[int, int], name: str, packets: list[Packet], tmp_path: Path
) -> None:
    file, out = tmp_path / name, tmp_path / "out"
    file.write_bytes(viewer_file(version, packets[:40], SERIALS))
    assert main(["convert", str(file), str(out)]) == 0
    pose = read_station(out)[SERIALS[1].decode()]
    assert pose.translation_m == (2.0, 0.5, -1.0)
    # Pitched by -90 degrees its x axis points up, turned by 90 then its z axis along -y.
    turned = Rotation.from_quat(pose.rotation).apply(np.eye(3))
    np.testing.assert_allclose(turned, [[0, 0, 1], [-1, 0, 0], [0, -1, 0]], atol=1e-6)
    if version == (1, 0):
        return
    file.write_bytes(viewer_file(version, packets[:40], SERIALS, uses_poses=False))
    assert main(["convert", str(file), str(out), "--force"]) == 0
    assert not (out / "station.yaml").exists()
    notes = json.loads((out / "conversion.json").read_text())["notes"]
    assert notes == ["47MDK9DF710195: its pose is switched off in the file, and not taken"]


@VERSIONS
def test_a_broken_file_of_the_viewer_keeps_what_came_before(
    version: tuple[int, int], name: str, packets: list[Packet], tmp_path: Path, fails
) -> None:
    whole = viewer_file(version, packets[:400], SERIALS[:1])
    for size in (0, 10, 28, 80, len(whole) // 2, len(whole) - 1):
        file, out = tmp_path / f"{size}{name}", tmp_path / f"out{size}"
        file.write_bytes(whole[:size])
        said = fails(4, "convert", file, out)
        assert f"{size}{name}: " in said
        assert out.exists() == (size > 100)
    file.write_bytes(b"x" + whole[1:])
    assert "begins with" in fails(4, "convert", file, tmp_path / "no")
    file.write_bytes(whole[:16] + b"\3" + whole[17:])
    assert "begins with 'livox_tech', version 3." in fails(4, "convert", file, tmp_path / "no")
    pose = (0.0, 0.0, float("nan"), 0.0, 0.0, 0.0)
    file.write_bytes(viewer_file(version, packets[:40], SERIALS[:1], [pose]))
    assert "expected finite numbers" in fails(4, "convert", file, tmp_path / "no")


@VERSIONS
def test_no_damage_of_a_viewers_file_gives_more_than_one_line(
    version: tuple[int, int], name: str, packets: list[Packet], tmp_path: Path, capsys
) -> None:
    whole = viewer_file(version, packets[:60], SERIALS)
    rng = np.random.default_rng(5)
    for _ in range(40):
        damaged = bytearray(whole)
        for at in rng.integers(0, min(len(whole), 400), 3):
            damaged[at] = rng.integers(256)
        file = tmp_path / name
        file.write_bytes(damaged)
        code = main(["convert", str(file), str(tmp_path / "out"), "--force"])
        said = capsys.readouterr().err.splitlines()
        assert code in (0, 4), said
        assert code == 0 or len([line for line in said if "error" in line]) == 1


# --- the reader ---------------------------------------------------------------------------------


def test_every_other_length_or_bit_is_refused(packets: list[Packet]) -> None:
    for good in (protocol2(packets[0], CARTESIAN_CM), protocol1(packets[0])):
        assert livox.parse(good) is not None
        for size in (*range(40), len(good) - 1):
            assert livox.parse(good[:size]) is None
        assert livox.parse(good + b"\0") is None
    good = protocol2(packets[0])
    for at in range(24, len(good), 97):
        assert livox.parse(good[:at] + bytes([good[at] ^ 4]) + good[at + 1 :]) is None
    assert livox.parse(good[:24] + bytes(4) + good[28:]) is not None  # not given


def test_tags_and_angles(packets: list[Packet]) -> None:
    packet = packets[40]
    tags = [0x02, 0x08, 0x01, *[0x10] * 93]
    found = livox.parse(protocol2(packet, CARTESIAN_MM, tags=tags)).points()
    assert (found.noise, len(found.xyz_m), found.ray[0]) == (2, 94, 2)
    assert (spherical(packet.units, 1e-3)[:, 1:] <= [18000, 36000]).all()
    angles = livox.parse(protocol2(packet, SPHERICAL)).points()
    far = np.linalg.norm(packet.xyz_m, axis=1)
    assert (np.linalg.norm(angles.xyz_m - packet.xyz_m, axis=1) <= 2e-4 * far + 1e-3).all()


# --- play ---------------------------------------------------------------------------------------


def test_a_capture_played_to_the_program_gives_the_rows_of_its_packets(
    capture: Path, packets: list[Packet], tmp_path: Path, capsys
) -> None:
    rows = []
    for kind in ("played", "sent"):
        out, summary = tmp_path / f"{kind}.csv", tmp_path / f"{kind}.json"
        with Listening("--out", out, "--summary", summary) as live:
            if kind == "played":
                to = f"127.0.0.1:{live.port}"
                assert main(["play", str(capture), "--rate", "inf", "--to", to]) == 0
            else:
                for k in range(0, len(packets), 2):  # as in the capture
                    part = packets[k : k + 2]
                    live.receive(map(protocol2, part[::2]), "127.168.1.12")
                    live.receive(map(protocol1, part[1::2]), "127.168.1.13")
            code, _, said = live.end(signal.SIGTERM)
        assert code == 0, said
        inputs = json.loads(summary.read_text())["inputs"]
        inputs.sort(key=lambda one: one["name"])  # they come in the order of their first frames
        assert [one["name"] for one in inputs] == ["127-168-1-12", "127-168-1-13"]
        assert sum(one["packets"]["used"] for one in inputs) == len(packets)
        rows.append(out.read_bytes())
    assert rows[0] == rows[1]
    assert rows[0].count(b"\n") > 20
    assert f"played {len(packets)} packets in " in capsys.readouterr().err


def test_a_rate_is_kept(packets: list[Packet], tmp_path: Path) -> None:
    frames = [(p.stamp_ns, udp_frame(protocol2(p), "10.1.2.3")) for p in packets[:200]]
    file = write_pcap(tmp_path / "a.pcap", frames)
    span_s = (frames[-1][0] - frames[0][0]) * 1e-9
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taker:
        taker.bind(("127.0.0.1", 0))
        begin = time.monotonic()
        to = f"127.0.0.1:{taker.getsockname()[1]}"
        assert main(["play", str(file), "--rate", "2", "--to", to]) == 0
        assert time.monotonic() - begin >= span_s / 2 - 0.01
        payload, (source, _) = taker.recvfrom(4096)
    assert payload == protocol2(packets[0])
    assert source == "127.1.2.3"


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (("--to", "192.0.2.1:56301"), "is not this computer, expected 127.0.0.1, or --anywhere"),
        (("--to", "example.org:56301"), "expected an IPv4 address"),
        (("--to", "127.0.0.1"), "expected HOST:PORT"),
        (("--to", "127.0.0.1:70000"), "expected HOST:PORT"),
        ((), "expected HOST:PORT"),
        (("--into", "x"), "--into: is for frames"),
        (("--repeat", "2", "--to", "127.0.0.1:5"), "--repeat: is for frames"),
    ],
)
def test_what_a_capture_cannot_be_played_to(
    options: tuple[str, ...], expected: str, capture: Path, fails
) -> None:
    assert expected in fails(2, "play", capture, *options)


def test_anywhere_is_for_captures(tmp_path: Path, fails) -> None:
    (tmp_path / "a").mkdir()
    assert "--anywhere: is for captures" in fails(2, "play", tmp_path, "--anywhere")


# --- simulate -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A flight with the packets of its LiDARs; frames have times of their points."""
    folder = tmp_path_factory.mktemp("simulated")
    (folder / "scenario.yaml").write_text(
        "duration_s: 1.5\npoint_times: true\nsensors:\n  mid360: {model: mid360}\n"
        "  avia: {model: avia, start_s: 0.013}\n"
        "drones: [{flight: {box_m: [[-4, -4, 4], [4, 4, 8]]}}]\n"
    )
    command = ["simulate", str(folder / "scenario.yaml"), str(folder / "flight")]
    assert main([*command, "--packets", str(folder / "flight.pcap")]) == 0
    return folder


def test_simulated_packets_hold_every_return_at_its_place_and_time(
    simulated: Path, tmp_path: Path
) -> None:
    """The reader, which was tested by packets of its own, has the oracle's part."""
    assert main(["convert", str(simulated / "flight.pcap"), str(tmp_path / "out")]) == 0
    for sensor, address in (("avia", "192-168-1-112"), ("mid360", "192-168-1-113")):
        drawn = returns_of(simulated / "flight" / sensor, "t")
        sent = returns_of(tmp_path / "out" / address, OFFSET_FIELD)
        assert len(drawn) - RAYS < len(sent) <= len(drawn)  # of the last packet half is missing
        np.testing.assert_allclose(sent[:, :3], drawn[: len(sent), :3], atol=0.6e-3)
        # Protocol 1 does not say how long a packet takes; a shot's rays are one behind the other.
        np.testing.assert_allclose(sent[:, 3], drawn[: len(sent), 3], atol=0.5e-3)


def returns_of(folder: Path, times: str) -> np.ndarray:
    """(N, 4) place in metres and time in seconds of all frames of the scenario."""
    frames = list_frames(folder)
    begin_ns = 1_700_000_000 * 10**9
    return np.concatenate(
        [
            np.stack(
                [*(points[axis] for axis in "xyz"), (f.stamp_ns - begin_ns + points[times]) * 1e-9],
                axis=1,
            )
            for f in frames
            for points in [read_pcd(f.path)]
        ]
    )


def test_a_flight_is_tracked_by_its_simulated_packets(simulated: Path, tmp_path: Path) -> None:
    with Listening("--out", tmp_path / "traj.csv", "--summary", tmp_path / "s.json") as live:
        main(
            [
                "play",
                str(simulated / "flight.pcap"),
                "--to",
                f"127.0.0.1:{live.port}",
                "--rate",
                "inf",
            ]
        )
        code, _, said = live.end(signal.SIGTERM)
    assert code == 0, said
    told = json.loads((tmp_path / "s.json").read_text())["inputs"]
    assert {one["name"] for one in told} == {"127-168-1-112", "127-168-1-113"}
    assert all(one["packets"]["used"] > 3000 and one["packets"]["lost"] == 0 for one in told)


def test_a_scenario_without_a_livox_lidar_sends_no_packets(tmp_path: Path, fails) -> None:
    (tmp_path / "a.yaml").write_text("duration_s: 0.1\nsensors: {top: {model: spinning32}}\n")
    command = ("simulate", tmp_path / "a.yaml", tmp_path / "out", "--packets", tmp_path / "a.pcap")
    assert "one of mid360, avia" in fails(2, *command)
    assert not (tmp_path / "a.pcap").exists()
    assert not (tmp_path / "out").exists()
