"""Behaviour of unlidar_track with wrong, strange or missing input.

A refusal is one line on stderr that names the file and the value, the exit code of its kind, and
no file written, replaced or left behind.
"""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from synthetic import (
    NO_DRONE_TRAJ,
    PERIOD_NS,
    SHARED,
    Flight,
    decimal_name,
    make_flight,
    read_traj,
    run_program,
    seconds,
    track,
    write_frames,
    write_pcd,
)

USAGE, CONFIG, INPUT, OUTPUT = 2, 3, 4, 5
MALFORMED = SHARED / "data" / "formats" / "pcd" / "malformed"


@pytest.fixture(scope="module")
def flight() -> Flight:
    return make_flight(frames=40)


@pytest.fixture
def frames(flight: Flight, tmp_path: Path) -> Path:
    return write_frames(tmp_path / "in" / "frames", flight)


@pytest.fixture(scope="module")
def plain(flight: Flight, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The trajectory of the untouched flight."""
    folder = tmp_path_factory.mktemp("plain")
    track(write_frames(folder / "frames", flight), folder / "traj.csv")
    return (folder / "traj.csv").read_bytes()


@pytest.fixture
def out(tmp_path: Path) -> Path:
    """A place in a folder of its own, which must still be empty after a refusal."""
    (tmp_path / "out").mkdir()
    return tmp_path / "out" / "traj.csv"


def assert_refused(result: subprocess.CompletedProcess[str], code: int, *named: object) -> None:
    assert result.returncode == code, result.stderr
    lines = result.stderr.strip().splitlines()
    assert len(lines) == 1, result.stderr
    assert [n for n in map(str, named) if n not in lines[0]] == [], lines[0]
    assert result.stdout == ""


def assert_untouched(out: Path) -> None:
    assert list(out.parent.iterdir()) == []


# --- usage ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--no-such-option"], "--no-such-option"),
        (["--rate", "0"], "0"),
        (["--rate", "-5"], "-5"),
        (["--rate", "fast"], "fast"),
        (["--rate", "nan"], "nan"),
        (["--rate", "inf"], "inf"),
        (["--threads", "0"], "0"),
        (["--threads", "-1"], "-1"),
        (["--threads", "two"], "two"),
        (["--format", "xml"], "xml"),
        (["--quiet", "--verbose"], "--verbose"),
        (["--at", "at.txt", "--rate", "5"], "--rate"),
        (["stray"], "stray"),
    ],
)
def test_wrong_usage_is_refused(frames: Path, out: Path, arguments: list[str], named: str) -> None:
    result = run_program("--frames", frames, "--out", out, *arguments)
    assert_refused(result, USAGE, named)
    assert_untouched(out)


@pytest.mark.parametrize("missing", ["--frames", "--out"])
def test_a_missing_option_is_named(frames: Path, out: Path, missing: str) -> None:
    given = {"--frames": frames, "--out": out}
    given.pop(missing)
    arguments = [part for pair in given.items() for part in pair]
    assert_refused(run_program(*arguments), USAGE, missing)
    assert_untouched(out)


# --- configuration ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "line", "named"),
    [
        ("input:\n  max_range_m: 100\n  max_rnge_m: 3\n", 3, "max_rnge_m"),
        ("\nno_such_section:\n  key: 1\n", 2, "no_such_section"),
        ("input:\n  max_range_m: far\n", 2, "far"),
        ("input:\n  max_range_m: -3\n", 2, "-3"),
        ("input:\n  max_range_m: .nan\n", 2, "max_range_m"),
        ("input:\n  max_range_m: [1, 2]\n", 2, "max_range_m"),
        ("input:\n  skip_bad_frames: 7\n", 2, "7"),
        ("method: magic\n", 1, "magic"),
        ("sensors:\n  a:\n    translation_m: [1, 2]\n", 3, "translation_m"),
        ("sensors:\n  a:\n    rotation: [0, 0, 0, 0]\n", 3, "rotation"),
        ("sensors:\n  a:\n    colour: red\n", 3, "colour"),
        ("input: 3\n", 1, "input"),
        ("input:\n  max_range_m: 5\n  max_range_m: 6\n", 3, "max_range_m"),
        ("input: {max_range_m: 5\n", None, ""),
        ("- a\n- b\n", 1, ""),
    ],
)
def test_wrong_configuration_is_refused_with_its_line(
    frames: Path, out: Path, tmp_path: Path, text: str, line: int | None, named: str
) -> None:
    config = tmp_path / "config.yaml"
    config.write_text(text)
    result = run_program("--frames", frames, "--out", out, "--config", config)
    place = str(config) if line is None else f"{config}:{line}"
    assert_refused(result, CONFIG, place, named)
    assert_untouched(out)


@pytest.mark.parametrize(
    ("setting", "named"),
    [
        ("input.no_such_key=1", "input.no_such_key"),
        ("nowhere.key=1", "nowhere"),
        ("input.max_range_m=far", "far"),
        ("input.max_range_m=", "input.max_range_m"),
        ("input.max_range_m", "input.max_range_m"),
        ("=3", "=3"),
    ],
)
def test_a_wrong_setting_is_refused(frames: Path, out: Path, setting: str, named: str) -> None:
    result = run_program("--frames", frames, "--out", out, "--set", setting)
    assert result.returncode in (USAGE, CONFIG)
    assert_refused(result, result.returncode, named)
    assert_untouched(out)


def test_a_missing_config_file_is_named(frames: Path, out: Path, tmp_path: Path) -> None:
    config = tmp_path / "absent.yaml"
    result = run_program("--frames", frames, "--out", out, "--config", config)
    assert_refused(result, CONFIG, config)
    assert_untouched(out)


def test_an_empty_config_file_changes_nothing(
    frames: Path, out: Path, tmp_path: Path, plain: bytes
) -> None:
    (tmp_path / "config.yaml").write_text("# nothing\n")
    track(frames, out, "--config", tmp_path / "config.yaml")
    assert out.read_bytes() == plain


# --- frame directories ------------------------------------------------------------------------


def test_a_missing_directory_is_refused(out: Path, tmp_path: Path) -> None:
    result = run_program("--frames", tmp_path / "absent", "--out", out)
    assert_refused(result, INPUT, tmp_path / "absent")
    assert_untouched(out)


def test_a_directory_without_frames_is_refused(out: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    assert_refused(
        run_program("--frames", tmp_path / "empty", "--out", out), INPUT, tmp_path / "empty"
    )
    assert_untouched(out)


def test_a_file_in_place_of_a_directory_is_refused(out: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    result = run_program("--frames", tmp_path / "file", "--out", out)
    assert_refused(result, INPUT, tmp_path / "file")
    assert_untouched(out)


@pytest.mark.parametrize("name", ["frame_12.pcd", "1.2.3.pcd", "12s.pcd", "nan.pcd", "1e400.pcd"])
def test_a_frame_without_a_stamp_is_refused(
    frames: Path, flight: Flight, out: Path, name: str
) -> None:
    write_pcd(frames / name, flight.clouds[0])
    assert_refused(run_program("--frames", frames, "--out", out), INPUT, frames / name)
    assert_untouched(out)


def test_two_frames_of_one_sensor_with_one_stamp_are_refused(
    frames: Path, flight: Flight, out: Path
) -> None:
    twin = frames / f"{seconds(flight.stamps_ns[7])}000.pcd"
    write_pcd(twin, flight.clouds[3])
    result = run_program("--frames", frames, "--out", out)
    assert_refused(result, INPUT, seconds(flight.stamps_ns[7]))
    assert_untouched(out)


def test_two_sensors_may_share_a_stamp(
    frames: Path, flight: Flight, out: Path, tmp_path: Path
) -> None:
    second = write_frames(tmp_path / "second", flight)
    track([f"a={frames}", f"b={second}"], out)
    assert len(read_traj(out)) > 30


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("file,timestamp\n{name},soon\n", "soon"),
        ("file,timestamp\n{name}\n", "timestamps.csv"),
        ("name,when\n{name},1.0\n", "timestamps.csv"),
        ("", "timestamps.csv"),
        ("file,timestamp\n{name},1.0\n{name},2.0\n", "{name}"),
    ],
)
def test_a_wrong_timestamps_csv_is_refused(
    frames: Path, flight: Flight, out: Path, text: str, named: str
) -> None:
    name = decimal_name(flight.stamps_ns[0])
    (frames / "timestamps.csv").write_text(text.format(name=name))
    result = run_program("--frames", frames, "--out", out)
    assert_refused(result, INPUT, frames / "timestamps.csv", named.format(name=name))
    assert_untouched(out)


@pytest.mark.parametrize("text", ["soon\n", "", "when\n1.0\n"])
def test_a_wrong_file_of_output_times_is_refused(
    frames: Path, out: Path, tmp_path: Path, text: str
) -> None:
    at = tmp_path / "at.txt"
    at.write_text(text)
    result = run_program("--frames", frames, "--out", out, "--at", at)
    assert_refused(result, INPUT, at)
    assert_untouched(out)


def test_a_missing_file_of_output_times_is_refused(frames: Path, out: Path, tmp_path: Path) -> None:
    result = run_program("--frames", frames, "--out", out, "--at", tmp_path / "absent.csv")
    assert_refused(result, INPUT, tmp_path / "absent.csv")
    assert_untouched(out)


# --- frames that cannot be parsed -------------------------------------------------------------

HEADER = (
    "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
    "WIDTH {width}\nHEIGHT {height}\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {points}\nDATA {data}\n"
)


def pcd(width: object = 2, height: object = 1, points: object = 2, data: str = "binary") -> bytes:
    return HEADER.format(width=width, height=height, points=points, data=data).encode()


MENDED = pcd() + bytes(24)
BAD_FRAMES = {
    "empty_file": b"",
    "no_header": b"1 2 3\n4 5 6\n",
    "random_bytes": np.random.default_rng(0).bytes(4000),
    "header_only_without_data": pcd().replace(b"DATA binary\n", b""),
    "truncated_binary": pcd() + bytes(23),
    "truncated_ascii": pcd(data="ascii") + b"1 2 3\n",
    "letters_in_ascii": pcd(data="ascii") + b"1 2 3\n1 two 3\n",
    "missing_value_in_ascii": pcd(data="ascii") + b"1 2 3\n1 2\n",
    "unknown_data": pcd(data="zipped") + bytes(24),
    "no_x": MENDED.replace(b"FIELDS x y z", b"FIELDS w y z"),
    "sizes_missing": MENDED.replace(b"SIZE 4 4 4", b"SIZE 4 4"),
    "size_three": MENDED.replace(b"SIZE 4 4 4", b"SIZE 4 3 4"),
    "type_unknown": MENDED.replace(b"TYPE F F F", b"TYPE F Q F"),
    "width_negative": pcd(width=-2) + bytes(24),
    "width_huge": pcd(width=10**12, points=10**12) + bytes(24),
    "width_times_height_overflows": pcd(width=2**32, height=2**32, points=2**64) + bytes(24),
    "count_huge": MENDED.replace(b"COUNT 1 1 1", b"COUNT 1 1 4000000000"),
    "compressed_sizes_lie": pcd(data="binary_compressed") + b"\xff\xff\xff\xff\xff\xff\xff\xff",
    "compressed_too_short": pcd(data="binary_compressed") + b"\x05\x00\x00\x00\x18\x00\x00\x00",
}


@pytest.mark.parametrize("kind", BAD_FRAMES)
def test_a_frame_that_cannot_be_parsed_is_refused_in_bounded_memory(
    frames: Path, flight: Flight, out: Path, kind: str
) -> None:
    bad = frames / decimal_name(flight.stamps_ns[20])
    bad.write_bytes(BAD_FRAMES[kind])
    result = run_program("--frames", frames, "--out", out, memory_bytes=2 << 30)
    assert_refused(result, INPUT, bad)
    assert_untouched(out)


@pytest.mark.skipif(not MALFORMED.is_dir(), reason="no ../shared beside the project")
def test_every_malformed_file_of_other_projects_is_refused(
    frames: Path, flight: Flight, out: Path
) -> None:
    files = sorted(MALFORMED.iterdir())
    assert files
    bad = frames / decimal_name(flight.stamps_ns[20])
    for file in files:
        bad.write_bytes(file.read_bytes())
        result = run_program("--frames", frames, "--out", out, memory_bytes=2 << 30)
        assert_refused(result, INPUT, bad)
    assert_untouched(out)


def test_bad_frames_are_skipped_counted_and_reported_when_asked(
    frames: Path, flight: Flight, out: Path, plain: bytes
) -> None:
    bad = frames / decimal_name(flight.stamps_ns[20])
    bad.write_bytes(BAD_FRAMES["truncated_binary"])
    summary = out.with_name("summary.json")
    skip = ("--set", "input.skip_bad_frames=true")
    said = track(frames, out, "--summary", summary, *skip)
    assert json.loads(summary.read_text())["counts"]["bad_frames"] == 1
    assert "1 frame" in said and "skip" in said
    # The drone is tracked across the lost frame.
    assert len(read_traj(out)) >= plain.count(b"\n") - 3


# --- strange but legal ------------------------------------------------------------------------

Change = Callable[[np.random.Generator, np.ndarray], np.ndarray]


def with_rows(*rows: tuple[float, float, float]) -> Change:
    """Adds the rows at random places of every frame; the order of the others stays."""

    def change(rng: np.random.Generator, cloud: np.ndarray) -> np.ndarray:
        places = np.sort(rng.integers(0, len(cloud) + 1, len(rows)))
        return np.insert(cloud, places, np.array(rows, np.float32), axis=0)

    return change


NAN, INF = float("nan"), float("inf")
ROWS = {
    "no_return": [(0.0, 0.0, 0.0)] * 50 + [(-0.0, 0.0, -0.0)],
    "nan": [(NAN, NAN, NAN), (1.0, NAN, 3.0), (NAN, 0.0, 0.0)],
    "infinite": [(INF, 1.0, 1.0), (1.0, -INF, 1.0), (INF, -INF, NAN)],
    "absurd": [(1e30, 1e30, 1e30), (-3.4e38, 3.4e38, 3.4e38), (1e9, 0.0, 0.0), (0.0, 5e4, 0.0)],
    "denormal": [(1e-42, 0.0, 0.0), (0.0, -1e-40, 1e-41)],
}


@pytest.mark.parametrize("kind", ROWS)
def test_rows_that_are_no_returns_change_nothing_and_are_counted(
    flight: Flight, out: Path, tmp_path: Path, plain: bytes, kind: str
) -> None:
    rng = np.random.default_rng(3)
    change = with_rows(*ROWS[kind])
    spoiled = Flight(flight.stamps_ns, [change(rng, c) for c in flight.clouds])
    summary = out.with_name("summary.json")
    track(write_frames(tmp_path / "frames", spoiled), out, "--summary", summary)
    assert out.read_bytes() == plain
    counts = json.loads(summary.read_text())["counts"]
    counter = {
        "no_return": "no_return_rows",
        "nan": "non_finite_rows",
        "infinite": "non_finite_rows",
    }
    name = counter.get(kind, "out_of_range_rows")
    dropped = len(flight.clouds) * len(ROWS[kind])
    assert counts[name] >= dropped
    assert counts["rows"] == sum(map(len, flight.clouds)) + dropped
    others = ("no_return_rows", "non_finite_rows", "out_of_range_rows", "returns")
    assert counts["rows"] == sum(counts[other] for other in others)


def test_an_empty_frame_is_data(flight: Flight, out: Path, tmp_path: Path) -> None:
    clouds = [c[:0] if i in (10, 11, 20) else c for i, c in enumerate(flight.clouds)]
    frames = write_frames(tmp_path / "frames", Flight(flight.stamps_ns, clouds))
    summary = out.with_name("summary.json")
    track(frames, out, "--summary", summary)
    assert json.loads(summary.read_text())["counts"]["empty_frames"] == 3
    # Rows stand at the stamps of empty frames too.
    assert seconds(flight.stamps_ns[10]) in read_traj(out).stamps


@pytest.mark.parametrize("method", ["robust", "paper"])
@pytest.mark.parametrize(
    "case", ["no_returns", "one_frame", "one_return", "one_return_a_frame", "all_rows_nan"]
)
def test_recordings_with_next_to_nothing_end_well(
    flight: Flight, out: Path, tmp_path: Path, case: str, method: str
) -> None:
    first = flight.clouds[0]
    clouds = {
        "no_returns": [first[:0]] * 20,
        "one_frame": [first],
        "one_return": [first[:1]],
        "one_return_a_frame": [first[:1]] * 20,
        "all_rows_nan": [np.full((30, 3), np.nan, np.float32)] * 20,
    }[case]
    frames = write_frames(tmp_path / "frames", Flight(flight.stamps_ns[: len(clouds)], clouds))
    track(frames, out, "--set", f"method={method}", "--clusters", out.with_name("clusters.csv"))
    if method == "robust":
        assert out.read_text() == NO_DRONE_TRAJ
    for value in out.read_text().replace("\n", ",").split(","):
        assert value not in ("nan", "-nan", "inf", "-inf")


@pytest.mark.parametrize("method", ["robust", "paper"])
def test_a_pause_of_an_hour_between_frames_is_borne(
    flight: Flight, out: Path, tmp_path: Path, method: str
) -> None:
    later = [s + (3600 * 10**9 if i >= 20 else 0) for i, s in enumerate(flight.stamps_ns)]
    frames = write_frames(tmp_path / "frames", Flight(later, flight.clouds))
    track(frames, out, "--set", f"method={method}")
    assert len(out.read_text().splitlines()) <= 1 + len(later)


@pytest.mark.parametrize("method", ["robust", "paper"])
def test_frames_that_fall_on_one_nanosecond_after_another_are_borne(
    flight: Flight, out: Path, tmp_path: Path, method: str
) -> None:
    dense = [s - i * (PERIOD_NS - 1) for i, s in enumerate(flight.stamps_ns)]
    frames = write_frames(tmp_path / "frames", Flight(dense, flight.clouds))
    track(frames, out, "--set", f"method={method}")
    assert "nan" not in out.read_text()


# --- output that cannot be written ------------------------------------------------------------


@pytest.mark.parametrize("option", ["--out", "--clusters", "--points", "--summary", "--trace"])
@pytest.mark.parametrize("place", ["missing_folder", "under_a_file", "is_a_folder"])
def test_an_output_that_cannot_be_written_is_refused(
    frames: Path, tmp_path: Path, option: str, place: str
) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / "file").write_text("keep me")
    (folder / "folder").mkdir()
    target = {
        "missing_folder": folder / "absent" / "output",
        "under_a_file": folder / "file" / "output",
        "is_a_folder": folder / "folder",
    }[place]
    others = [] if option == "--out" else ["--out", tmp_path / "traj.csv"]
    result = run_program("--frames", frames, *others, option, target)
    assert_refused(result, OUTPUT, target)
    assert sorted(p.name for p in folder.rglob("*")) == ["file", "folder"]
    assert (folder / "file").read_text() == "keep me"
    # What was written beside an output has been renamed or taken away.
    assert {p.name for p in tmp_path.iterdir()} <= {"in", "out", "traj.csv"}


def test_a_full_disk_is_refused_as_output(frames: Path, out: Path) -> None:
    if not Path("/dev/full").is_char_device():
        pytest.skip("no /dev/full on this system")
    out.symlink_to("/dev/full")
    result = run_program("--frames", frames, "--out", out)
    assert_refused(result, OUTPUT, out)
    assert [p.name for p in out.parent.iterdir()] == [out.name]


def test_a_device_or_a_link_is_written_to_and_not_replaced(
    frames: Path, out: Path, tmp_path: Path, plain: bytes
) -> None:
    # Renaming a file over /dev/null, as root can, would break the machine.
    null, link = out.with_name("null"), out.with_name("link.csv")
    null.symlink_to("/dev/null")
    track(frames, null)
    assert null.is_symlink() and null.is_char_device()
    null.unlink()
    (tmp_path / "real.csv").write_text("older")
    link.symlink_to(tmp_path / "real.csv")
    track(frames, link)
    assert link.is_symlink() and (tmp_path / "real.csv").read_bytes() == plain
    assert list(out.parent.iterdir()) == [link]


def test_a_refusal_keeps_the_older_output(frames: Path, flight: Flight, out: Path) -> None:
    out.write_text("older\n")
    (frames / decimal_name(flight.stamps_ns[3])).write_bytes(b"")
    assert run_program("--frames", frames, "--out", out).returncode == INPUT
    assert out.read_text() == "older\n"
    assert [p.name for p in out.parent.iterdir()] == [out.name]


def test_the_folder_of_a_whole_recording_is_distinguished_from_that_of_a_lidar(
    tmp_path: Path,
) -> None:
    write_frames(tmp_path / "rec" / "mid360", make_flight(frames=3))
    (tmp_path / "rec" / ".hidden").mkdir()
    result = run_program("--frames", tmp_path / "rec", "--out", tmp_path / "traj.csv")
    assert result.returncode == 4
    assert result.stderr.splitlines() == [
        f"unlidar_track: error: {tmp_path}/rec: holds no .pcd file, expected at least one frame; a "
        f"recording of several LiDARs has one --frames each, as --frames {tmp_path}/rec/mid360"
    ]
