"""Captured packets of Velodyne LiDARs, written from the maker's manual of the VLP-16."""

from __future__ import annotations

import json
import struct
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from pcap_files import no_damage_gives_more_than_one_line, udp_frame, write_pcap
from unlidar.cli import main
from unlidar.frames_io import list_frames, read_pcd

pytest.importorskip("velodyne_decoder", reason="the extra `velodyne` is not installed")

BEGIN_US = 1_706_300_000_000_000
VLP16, STRONGEST = 0x22, 0x37
# Vertical angles of the lasers in degrees, in the order in which they fire.
ELEVATIONS_DEG = np.array([-15, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15.0])
FIRING_US, SEQUENCE_US = 2.304, 55.296
BLOCKS, SEQUENCES = 12, 2  # of a packet, of a block
PACKET_US = BLOCKS * SEQUENCES * SEQUENCE_US
TURN_US = 100_000.0
# Heights of the lasers above the middle of the sensor, as the manual's table has them, reach 11 mm;
# the distance is told in 2 mm, the azimuth in 0.01 degrees.
RESOLUTION_M = 0.012


def distance_mm(azimuth_deg: NDArray[np.float64], laser: NDArray[np.int64]) -> NDArray[np.int64]:
    """A room that is not round; every seventh ray of a laser has no return."""
    away = 8_000 + 3_000 * np.sin(np.radians(3 * azimuth_deg)) + 100 * laser
    gone = (azimuth_deg * 50).astype(int) % 7 == 0
    return np.where(gone, 0, 2 * np.rint(away / 2)).astype(int)


def packet(number: int) -> tuple[bytes, NDArray[np.float64], NDArray[np.float64]]:
    """Its bytes, and the positions and times (us after the begin) of its returns."""
    begin_us = number * PACKET_US
    data, points, times_us = b"", [], []
    lasers = np.arange(16)
    for block in range(BLOCKS):
        block_us = begin_us + block * SEQUENCES * SEQUENCE_US
        azimuth = round(36_000 * (block_us % TURN_US) / TURN_US) % 36_000
        data += struct.pack("<HH", 0xEEFF, azimuth)
        for sequence in range(SEQUENCES):
            fired_us = block_us + sequence * SEQUENCE_US + lasers * FIRING_US
            azimuth_deg = (azimuth / 100 + (fired_us - block_us) * 360 / TURN_US) % 360
            away_mm = distance_mm(azimuth_deg, lasers)
            data += b"".join(struct.pack("<HB", mm // 2, 50) for mm in away_mm.tolist())
            a, e = np.radians(azimuth_deg), np.radians(ELEVATIONS_DEG)
            # The manual's azimuth is clockwise from its y axis; x is forward as drivers have it.
            unit = np.stack([np.cos(e) * np.cos(a), -np.cos(e) * np.sin(a), np.sin(e)], axis=1)
            points.append((unit * away_mm[:, None] * 1e-3)[away_mm > 0])
            times_us.append(fired_us[away_mm > 0])
    hour_us = int((BEGIN_US + begin_us) % 3_600_000_000)
    data += struct.pack("<IBB", hour_us, STRONGEST, VLP16)
    assert len(data) == 1206
    return data, np.concatenate(points), np.concatenate(times_us)


def write_capture(
    path: Path, numbers: range, late_us: float = 900, sources: tuple[str, ...] = ("192.168.1.201",)
) -> Path:
    frames = []
    for number in numbers:
        sent_ns = round((BEGIN_US + (number + 1) * PACKET_US + late_us) * 1000)
        for source in sources:
            frames.append((sent_ns, udp_frame(packet(number)[0], source, 2368, 2368)))
            if number % 20 == 0:  # position of GPS
                frames.append((sent_ns, udp_frame(bytes(512), source, 8308, 8308)))
    return write_pcap(path, frames)


def test_a_capture_becomes_frames_of_a_turn(tmp_path: Path) -> None:
    numbers = range(400)  # five turns and a bit
    file = write_capture(tmp_path / "a.pcap", numbers)
    assert main(["convert", str(file), str(tmp_path / "out")]) == 0
    frames = list_frames(tmp_path / "out/192-168-1-201")
    assert len(frames) == 6
    told = [packet(number) for number in numbers]
    points_m, times_us = (np.concatenate([part[k] for part in told]) for k in (1, 2))
    got_m, got_us = [], []
    for frame in frames:
        rows = read_pcd(frame.path)
        assert (
            rows["offset_time"].min() >= 0
            and rows["offset_time"].max() < (TURN_US + 2 * PACKET_US) * 1e3
        )
        got_m.append(np.stack([rows[axis] for axis in "xyz"], axis=1))
        got_us.append((frame.stamp_ns - BEGIN_US * 1000 + rows["offset_time"]) * 1e-3)
    got_m, got_us = np.concatenate(got_m), np.concatenate(got_us)
    assert len(got_m) == len(points_m)
    order, expected = np.argsort(got_us, kind="stable"), np.argsort(times_us, kind="stable")
    np.testing.assert_allclose(got_us[order], times_us[expected], atol=1.5)
    np.testing.assert_allclose(got_m[order], points_m[expected], atol=RESOLUTION_M)
    # A sensor and a computer that agree have nothing to be told.
    assert json.loads((tmp_path / "out/conversion.json").read_text())["notes"] == []


def test_two_sensors_and_a_part_of_them(tmp_path: Path, capsys) -> None:
    sources = ("192.168.1.201", "192.168.1.202")
    file = write_capture(tmp_path / "a.pcap", range(250), sources=sources)
    assert main(["convert", str(file), "--list"]) == 0
    assert "Velodyne packets" in (listed := capsys.readouterr().out)
    assert "192-168-1-202" in listed
    part = ["--sensors", "192-168-1-202", "--start", "0.15", "--duration", "0.1"]
    assert main(["convert", str(file), str(tmp_path / "out"), *part]) == 0
    assert [p.name for p in (tmp_path / "out").iterdir() if p.is_dir()] == ["192-168-1-202"]
    assert len(list_frames(tmp_path / "out/192-168-1-202")) == 1


def test_a_clock_that_is_not_set_is_said_and_the_captures_can_be_taken(tmp_path: Path) -> None:
    file = write_capture(tmp_path / "a.pcap", range(100), late_us=600e6)
    for stamp, late_s in (("header", 0.0), ("log", 600.0)):
        out = tmp_path / stamp
        assert main(["convert", str(file), str(out), "--stamp", stamp]) == 0
        first = list_frames(out / "192-168-1-201")[0]
        assert abs(first.stamp_ns * 1e-9 - BEGIN_US * 1e-6 - late_s) < 0.01
        (note,) = json.loads((out / "conversion.json").read_text())["notes"]
        assert "header stamps and log times differ by 600" in note


def test_a_capture_that_is_cut_off_keeps_what_came_before(tmp_path: Path, fails) -> None:
    whole = write_capture(tmp_path / "a.pcap", range(250)).read_bytes()
    file = tmp_path / "cut.pcap"
    file.write_bytes(whole[: len(whole) // 2])
    assert "is cut off at byte" in fails(4, "convert", file, tmp_path / "out")
    assert len(list_frames(tmp_path / "out/192-168-1-201")) == 2


def test_no_damage_gives_more_than_one_line(tmp_path: Path, capfd) -> None:
    whole = write_capture(tmp_path / "a.pcap", range(100)).read_bytes()
    no_damage_gives_more_than_one_line(whole, tmp_path, capfd)


def test_without_its_package_it_says_which_to_install(tmp_path: Path, fails, monkeypatch) -> None:
    file = write_capture(tmp_path / "a.pcap", range(10))
    monkeypatch.setitem(sys.modules, "velodyne_decoder", None)
    assert "pip install 'unlidar-track[velodyne]'" in fails(2, "convert", file, tmp_path / "out")
    assert "--topic is for bags" in fails(2, "convert", file, tmp_path / "out", "--topic", "/a")
