"""Captured packets of Ouster LiDARs, written from the maker's manual of the OS1."""

from __future__ import annotations

import json
import struct
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from pcap_files import fragments, no_damage_gives_more_than_one_line, udp_frame, write_pcap
from unlidar.cli import main
from unlidar.frames_io import list_frames, read_pcd

pytest.importorskip("ouster.sdk.core", reason="not installed: ouster-sdk")

BEGIN_NS = 1_706_300_000_000_000_000
TURN_NS = 100_000_000
COLUMNS, OF_A_PACKET = 512, 16
PACKETS = COLUMNS // OF_A_PACKET  # of a turn
PACKET_NS = TURN_NS // PACKETS
# Of 16 beams: degrees up and to the side, as each sensor's metadata has its own.
UP_DEG = np.linspace(16.6, -16.6, 16)
ASIDE_DEG = np.tile([4.2, 1.4, -1.4, -4.2], 4)
ORIGIN_MM, HEIGHT_MM = 15.806, 36.18  # of the beams from the axis, of the axis' origin
SERIAL = 992_231_000_123
RESOLUTION_M = 1e-6 * 50  # of float32; ranges are whole millimetres in the packets

LEGACY, SINGLE, DUAL, LOW = (
    "LEGACY",
    "RNG19_RFL8_SIG16_NIR16",
    "RNG19_RFL8_SIG16_NIR16_DUAL",
    "RNG15_RFL8_NIR8",
)


def metadata(profile: str, serial: int = SERIAL) -> dict:
    """The part of http://SENSOR/api/v1/sensor/metadata that is needed."""
    identity = np.eye(4).ravel().tolist()
    return {
        "calibration_status": {},
        "imu_intrinsics": {"imu_to_sensor_transform": identity},
        "beam_intrinsics": {
            "beam_altitude_angles": UP_DEG.tolist(),
            "beam_azimuth_angles": ASIDE_DEG.tolist(),
            "lidar_origin_to_beam_origin_mm": ORIGIN_MM,
        },
        "config_params": {
            "lidar_mode": "512x10",
            "udp_port_lidar": 7502,
            "udp_port_imu": 7503,
            "udp_profile_lidar": profile,
        },
        "lidar_data_format": {
            "column_window": [0, COLUMNS - 1],
            "columns_per_frame": COLUMNS,
            "columns_per_packet": OF_A_PACKET,
            "pixel_shift_by_row": [12, 4, -4, -12] * 4,
            "pixels_per_column": 16,
            "udp_profile_lidar": profile,
            "udp_profile_imu": "LEGACY",
        },
        "lidar_intrinsics": {
            "lidar_to_sensor_transform": [
                *(-1, 0, 0, 0),
                *(0, -1, 0, 0),
                *(0, 0, 1, HEIGHT_MM),
                *(0, 0, 0, 1),
            ]
        },
        "sensor_info": {
            "prod_line": "OS-1-16",
            "prod_sn": str(serial),
            "image_rev": "ousteros-image-prod-aries-v2.5.3+20230907",
            "initialization_id": 7,
        },
    }


def ranges_mm(turn: int, column: int, second: bool) -> NDArray[np.int64]:
    """A room that is not round, in steps of 8 mm, which all layouts tell; some see nothing."""
    beam = np.arange(16)
    away = 8_000 + 3_000 * np.sin(2 * np.pi * 3 * column / COLUMNS) + 104 * beam + 1_000 * turn
    gone = (column * 7 + beam * 3 + second) % (5 if second else 11) == 0
    return np.where(gone, 0, 8 * np.rint(away / 8) + 1_600 * second).astype(np.int64)


def positions_m(away_mm: NDArray[np.int64], column: int) -> NDArray[np.float64]:
    """The manual's formula, and its way from the LiDAR's frame to the sensor's."""
    encoder = 2 * np.pi * (1 - column / COLUMNS)
    side, up = -np.radians(ASIDE_DEG), np.radians(UP_DEG)
    beam = away_mm - ORIGIN_MM
    x = beam * np.cos(encoder + side) * np.cos(up) + ORIGIN_MM * np.cos(encoder)
    y = beam * np.sin(encoder + side) * np.cos(up) + ORIGIN_MM * np.sin(encoder)
    z = beam * np.sin(up)
    return np.stack([-x, -y, z + HEIGHT_MM], axis=1)[away_mm > 0] * 1e-3


def pixel(profile: str, first_mm: int, second_mm: int) -> bytes:
    if profile == LOW:
        return struct.pack("<HBB", first_mm // 8, 40, 5)
    if profile == DUAL:
        return struct.pack("<IIHHHH", first_mm | 40 << 24, second_mm | 30 << 24, 90, 80, 5, 0)
    return struct.pack("<IBBHHH", first_mm, 40, 0, 90, 5, 0)


def column_ns(turn: int, column: int) -> int:
    return BEGIN_NS + turn * TURN_NS + column * TURN_NS // COLUMNS


def packet(profile: str, number: int, serial: int = SERIAL) -> bytes:
    turn, at = divmod(number, PACKETS)
    legacy = profile == LEGACY
    data = b""
    if not legacy:
        identity = (7).to_bytes(3, "little") + serial.to_bytes(5, "little")
        data += struct.pack("<HH", 1, turn) + identity + bytes(20)
    for column in range(at * OF_A_PACKET, (at + 1) * OF_A_PACKET):
        data += struct.pack("<QH", column_ns(turn, column), column)
        data += struct.pack("<HI", turn, column * 90112 // COLUMNS) if legacy else b"\1\0"
        returns = zip(ranges_mm(turn, column, False), ranges_mm(turn, column, True), strict=True)
        data += b"".join(pixel(profile, int(a), int(b)) for a, b in returns)
        data += b"\xff\xff\xff\xff" if legacy else b""
    return data if legacy else data + bytes(32)


def write_capture(
    path: Path,
    numbers: range,
    profile: str = SINGLE,
    late_ns: int = 1_000_000,
    sensors: dict[str, int] | None = None,
) -> Path:
    frames, count = [], 0
    for number in numbers:
        sent_ns = BEGIN_NS + (number + 1) * PACKET_NS + late_ns
        for source, serial in (sensors or {"192.168.1.9": SERIAL}).items():
            count += 1
            data = packet(profile, number, serial)
            pieces = fragments(udp_frame(data, source, 7502, 7502), count)
            if number % 3 == 0:  # a network may deliver them in any order
                pieces.reverse()
            frames += [(sent_ns, piece) for piece in pieces]
            frames.append((sent_ns, udp_frame(bytes(48), source, 7503, 7503)))  # accelerations
    return write_pcap(path, frames)


def write_metadata(path: Path, profile: str = SINGLE, serial: int = SERIAL) -> None:
    path.write_text(json.dumps(metadata(profile, serial)))


@pytest.mark.parametrize("profile", [LEGACY, SINGLE, DUAL, LOW])
def test_a_capture_becomes_frames_of_a_turn(profile: str, tmp_path: Path) -> None:
    numbers = range(PACKETS // 2, 4 * PACKETS + 5)  # begins and ends within a turn
    file = write_capture(tmp_path / "a.pcap", numbers, profile)
    write_metadata(tmp_path / "a.json", profile)
    assert main(["convert", str(file), str(tmp_path / "out")]) == 0
    frames = list_frames(tmp_path / "out/192-168-1-9")
    assert len(frames) == 5
    expected: list[tuple[int, NDArray[np.float64]]] = []
    for turn, column in (divmod(k, COLUMNS) for k in range(256, 4 * COLUMNS + 80)):
        for second in (False, True)[: 1 + (profile == DUAL)]:
            points_m = positions_m(ranges_mm(turn, column, second), column)
            expected += [(column_ns(turn, column), point) for point in points_m]
    got = []
    for frame in frames:
        rows = read_pcd(frame.path)
        assert rows["offset_time"].min() >= 0 and rows["offset_time"].max() < TURN_NS
        xyz_m = np.stack([rows[axis] for axis in "xyz"], axis=1)
        times_ns = frame.stamp_ns + rows["offset_time"].astype(np.int64)
        got += list(zip(times_ns.tolist(), xyz_m, strict=True))

    def in_order(points: list) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        times, xyz_m = np.array([t for t, _ in points]), np.array([p for _, p in points], float)
        order = np.lexsort((*np.round(xyz_m.T, 3), times))
        return times[order], xyz_m[order]

    assert len(got) == len(expected)
    (got_ns, got_m), (expected_ns, expected_m) = in_order(got), in_order(expected)
    np.testing.assert_array_equal(got_ns, expected_ns)
    np.testing.assert_allclose(got_m, expected_m, atol=RESOLUTION_M)
    # A sensor and a computer that agree have nothing to be told.
    assert json.loads((tmp_path / "out/conversion.json").read_text())["notes"] == []


def test_two_sensors_have_the_metadata_of_their_serial_numbers(tmp_path: Path, capsys) -> None:
    sensors = {"192.168.1.9": SERIAL, "192.168.1.10": SERIAL + 1}
    file = write_capture(tmp_path / "a.pcap", range(3 * PACKETS), sensors=sensors)
    write_metadata(tmp_path / "a_0.json", serial=SERIAL + 1)
    write_metadata(tmp_path / "a_1.json", serial=SERIAL)
    write_metadata(tmp_path / "b.json", LOW)
    assert main(["convert", str(file), "--list"]) == 0
    assert "Ouster packets" in (listed := capsys.readouterr().out)
    assert "192-168-1-10" in listed
    part = ["--start", "0.05", "--duration", "0.1"]
    assert main(["convert", str(file), str(tmp_path / "out"), *part]) == 0
    told = json.loads((tmp_path / "out/conversion.json").read_text())
    assert told["metadata"] == {"192-168-1-9": "a_1.json", "192-168-1-10": "a_0.json"}
    assert told["frames"] == {"192-168-1-9": 1, "192-168-1-10": 1}


def test_a_clock_that_counts_from_power_on_is_said(tmp_path: Path) -> None:
    file = write_capture(tmp_path / "a.pcap", range(2 * PACKETS), late_ns=600 * 10**9)
    write_metadata(tmp_path / "a.json")
    for stamp, late_s in (("header", 0.0), ("log", 600.0)):
        out = tmp_path / stamp
        assert main(["convert", str(file), str(out), "--stamp", stamp]) == 0
        first = list_frames(out / "192-168-1-9")[0]
        assert abs((first.stamp_ns - BEGIN_NS) * 1e-9 - late_s) < 0.01
        (note,) = json.loads((out / "conversion.json").read_text())["notes"]
        assert "header stamps and log times differ by 600" in note


def test_what_is_missing_is_said_in_a_line(tmp_path: Path, fails, monkeypatch) -> None:
    file, out = write_capture(tmp_path / "a.pcap", range(40)), tmp_path / "out"
    assert "expected a.json beside it" in fails(4, "convert", file, out)
    write_metadata(tmp_path / "a.json", DUAL)
    assert "whose packets have 3328 bytes" in (line := fails(4, "convert", file, out))
    assert "a.json 4352" in line
    for text in ("", "{", "[]", '{"a": 1}', "\0"):
        (tmp_path / "a.json").write_text(text)
        assert "a.json: no metadata of an Ouster LiDAR" in fails(4, "convert", file, out)
    monkeypatch.setitem(sys.modules, "ouster.sdk.core", None)
    assert "pip install --no-deps 'ouster-sdk" in fails(2, "convert", file, out)
    assert "--topic is for bags" in fails(2, "convert", file, out, "--topic", "/a")


def test_no_damage_gives_more_than_one_line(tmp_path: Path, capfd) -> None:
    whole = write_capture(tmp_path / "a.pcap", range(2 * PACKETS)).read_bytes()
    write_metadata(tmp_path / "b.json")
    no_damage_gives_more_than_one_line(whole, tmp_path, capfd)


def test_packets_of_hesai_are_refused_with_what_to_do(tmp_path: Path, fails) -> None:
    # The head of a Pandar XT-32's packet: its begin, the version of its layout, beams and blocks.
    data = bytes([0xEE, 0xFF, 6, 1, 0, 0, 32, 8, 0, 4, 1, 0]) + bytes(1068)
    file = write_pcap(tmp_path / "a.pcap", [(BEGIN_NS, udp_frame(data, "192.168.1.201", 2368))] * 9)
    assert "Hesai LiDAR, which are not read, expected a bag" in fails(
        4, "convert", file, tmp_path / "out"
    )
