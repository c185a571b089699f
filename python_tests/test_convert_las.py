"""`unlidar convert` of LAS and LAZ files, which laspy writes for the tests."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from synthetic import BEGIN_NS, PERIOD_NS, Flight, make_flight
from unlidar.cli import main
from unlidar.frames_io import list_frames, read_pcd

laspy = pytest.importorskip("laspy", reason="the extra `las` is not installed")

# BEGIN_NS, 2024-01-26, as seconds of GPS time, which is 18 s ahead of UTC since 2017.
GPS_BEGIN_S = 1_706_300_000 - 315_964_800 + 18
FRACTION_S = (BEGIN_NS - 1_706_300_000 * 10**9) * 1e-9
SCALE_M = 1e-3


@pytest.fixture(scope="module")
def flight() -> Flight:
    return make_flight(frames=30)


def times_and_points(flight: Flight) -> tuple[np.ndarray, np.ndarray]:
    """Seconds after the whole second of the flight's begin, and positions, in order of time.

    Times are different half microseconds: those of the files are floating numbers, and none shall
    be rounded into another frame.
    """
    times_s = np.concatenate(
        [FRACTION_S + k * PERIOD_NS * 1e-9 + t.astype(float) for k, t in enumerate(flight.times_s)]
    )
    times_us, rows = np.unique(np.rint(times_s * 1e6), return_index=True)
    return (times_us + 0.5) * 1e-6, np.concatenate(flight.clouds)[rows].astype(float)


def write_las(
    path: Path,
    times_s: np.ndarray | None,
    xyz_m: np.ndarray,
    point_format: int = 6,
    standard: bool = True,
) -> Path:
    version = "1.4" if point_format >= 6 else "1.2"
    header = laspy.LasHeader(point_format=point_format, version=version)
    header.scales, header.offsets = [SCALE_M] * 3, [0.0] * 3
    header.global_encoding.gps_time_type = laspy.header.GpsTimeType(int(standard))
    las = laspy.LasData(header)
    las.x, las.y, las.z = xyz_m.T
    if times_s is not None:
        las.gps_time = times_s
    las.write(path)
    return path


def check_frames(folder: Path, times_s: np.ndarray, xyz_m: np.ndarray, begin_s: int) -> None:
    """All points arrived in the tenth of a second to which they belong, at their times."""
    frames = list_frames(folder)
    numbers = np.floor(times_s * 10).astype(int)
    assert [f.stamp_ns for f in frames] == [
        begin_s * 10**9 + n * 10**8 for n in np.unique(numbers).tolist()
    ]
    for frame, number in zip(frames, np.unique(numbers), strict=True):
        rows = read_pcd(frame.path)
        at_s = (frame.stamp_ns - begin_s * 10**9) * 1e-9 + rows["offset_time"] * 1e-9
        order, expected = np.argsort(at_s, kind="stable"), numbers == number
        np.testing.assert_allclose(at_s[order], times_s[expected], atol=3e-7)
        got_m = np.stack([rows[axis] for axis in "xyz"], axis=1)[order]
        np.testing.assert_allclose(got_m, xyz_m[expected], atol=0.51 * SCALE_M)


@pytest.mark.parametrize("point_format", [1, 3, 6, 10])
@pytest.mark.parametrize("ending", ["las", "laz"])
def test_points_become_frames_of_a_tenth_of_a_second(
    point_format: int, ending: str, flight: Flight, tmp_path: Path
) -> None:
    times_s, xyz_m = times_and_points(flight)
    gps_s = times_s + GPS_BEGIN_S - 1_000_000_000
    file = write_las(tmp_path / f"roof.{ending}", gps_s, xyz_m, point_format)
    assert main(["convert", str(file), str(tmp_path / "out")]) == 0
    check_frames(tmp_path / "out/roof", times_s, xyz_m, 1_706_300_000)
    assert json.loads((tmp_path / "out/conversion.json").read_text())["notes"] == []


def test_points_in_any_order_give_the_same_frames(flight: Flight, tmp_path: Path) -> None:
    times_s, xyz_m = times_and_points(flight)
    shuffled = np.random.default_rng(1).permutation(len(times_s))
    gps_s = times_s + GPS_BEGIN_S - 1_000_000_000
    file = write_las(tmp_path / "roof.laz", gps_s[shuffled], xyz_m[shuffled])
    assert main(["convert", str(file), str(tmp_path / "out")]) == 0
    check_frames(tmp_path / "out/roof", times_s, xyz_m, 1_706_300_000)


@pytest.mark.parametrize(
    ("written_s", "begin_s", "standard", "note"),
    [
        (1262304000 - 315964800 + 15 - 10**9, 1262304000, True, None),  # 2010
        (300_000, 300_000, False, "seconds of a GPS week"),
        (1_706_300_000, 1_706_300_000, False, "Unix time"),
    ],
)
def test_times_are_what_the_global_encoding_says(
    written_s: int, begin_s: int, standard: bool, note: str | None, flight: Flight, tmp_path: Path
) -> None:
    times_s, xyz_m = times_and_points(flight)
    file = write_las(tmp_path / "roof.las", times_s + written_s, xyz_m, 1, standard)
    assert main(["convert", str(file), str(tmp_path / "out")]) == 0
    check_frames(tmp_path / "out/roof", times_s, xyz_m, begin_s)
    notes = json.loads((tmp_path / "out/conversion.json").read_text())["notes"]
    assert (note is None and notes == []) or f"taken for {note}" in notes[0]


def test_a_part_of_it(flight: Flight, tmp_path: Path) -> None:
    times_s, xyz_m = times_and_points(flight)
    file = write_las(tmp_path / "roof.las", times_s, xyz_m)
    part = ["--start", "1", "--duration", "0.5"]
    assert main(["convert", str(file), str(tmp_path / "out"), *part]) == 0
    assert len(list_frames(tmp_path / "out/roof")) == 5


def test_what_cannot_be_frames_is_said(flight: Flight, tmp_path: Path, fails) -> None:
    times_s, xyz_m = times_and_points(flight)
    out = tmp_path / "out"
    file = write_las(tmp_path / "a.las", None, xyz_m, 2)
    assert "has points of format 2, which have no times" in fails(4, "convert", file, out)
    file = write_las(tmp_path / "b.las", np.full(len(times_s), 7.5), xyz_m)
    assert "points have one time, expected each its own" in fails(4, "convert", file, out)
    file = write_las(tmp_path / "c.las", times_s, xyz_m + np.array([500_000, 5_000, 0]))
    assert "expected them in the LiDAR's own frame" in fails(4, "convert", file, out)
    file = write_las(tmp_path / "d.las", times_s[:0], xyz_m[:0])
    assert "holds no points" in fails(4, "convert", file, out)
    file = write_las(tmp_path / "e.las", times_s * np.nan, xyz_m)
    assert "has a time that is none" in fails(4, "convert", file, out)
    assert not out.exists()
    file = write_las(tmp_path / "f.las", times_s, xyz_m)
    assert "--topic is for bags" in fails(2, "convert", file, out, "--topic", "/a")


def test_without_its_packages_it_says_which_to_install(tmp_path: Path, fails, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "lazrs", None)
    file = tmp_path / "a.laz"
    file.write_bytes(b"LASF")
    assert "pip install 'unlidar-track[las]'" in fails(2, "convert", file, tmp_path / "out")


@pytest.mark.parametrize("ending", ["las", "laz"])
def test_a_broken_file_keeps_what_came_before(
    ending: str, flight: Flight, tmp_path: Path, fails, monkeypatch
) -> None:
    monkeypatch.setattr("unlidar.conversion.las.CHUNK_POINTS", 5_000)
    times_s, xyz_m = times_and_points(flight)
    whole = write_las(tmp_path / f"a.{ending}", times_s, xyz_m).read_bytes()
    for size in (0, 3, 100, 226, 300, len(whole) // 2, len(whole) - 1):
        file = tmp_path / f"{size}.{ending}"
        file.write_bytes(whole[:size])
        assert f"{size}.{ending}: " in fails(4, "convert", file, tmp_path / f"out{size}")
    if ending == "las":
        assert len(list_frames(tmp_path / f"out{len(whole) // 2}/{len(whole) // 2}")) > 10


@pytest.mark.parametrize("ending", ["las", "laz"])
def test_no_damage_gives_more_than_one_line(
    ending: str, flight: Flight, tmp_path: Path, capfd
) -> None:
    times_s, xyz_m = times_and_points(flight)
    whole = write_las(tmp_path / f"a.{ending}", times_s[:3000], xyz_m[:3000]).read_bytes()
    rng = np.random.default_rng(3)
    for k in range(60):
        damaged = bytearray(whole)
        for at in rng.integers(0, 400 if k % 2 else len(whole), 3):
            damaged[at] = rng.integers(256)
        file = tmp_path / f"b.{ending}"
        file.write_bytes(damaged)
        code = main(["convert", str(file), str(tmp_path / "out"), "--force"])
        said = capfd.readouterr().err.splitlines()
        assert code in (0, 4), said
        assert code == 0 or len([line for line in said if line]) == 1, said
