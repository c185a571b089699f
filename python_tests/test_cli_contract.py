"""The command line of unlidar_track, as its users and their scripts rely on it."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from synthetic import (
    BEGIN_NS,
    NO_DRONE_TRAJ,
    PERIOD_NS,
    PROJECT,
    Flight,
    decimal_name,
    make_flight,
    read_binary_pcd,
    read_traj,
    rmse_m,
    run_program,
    seconds,
    track,
    truth_m,
    write_frames,
    write_pcd,
)

OPTIONS = [
    "--frames", "--out", "--config", "--set", "--at", "--rate", "--format", "--clusters",
    "--points", "--summary", "--trace", "--only-drones", "--follow", "--stdin", "--events",
    "--threads", "--quiet", "--verbose", "--version", "--help",
]  # fmt: skip


@pytest.fixture(scope="module")
def flight() -> Flight:
    return make_flight()


@pytest.fixture(scope="module")
def frames(flight: Flight, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_frames(tmp_path_factory.mktemp("flight") / "frames", flight)


@pytest.fixture(scope="module")
def plain_out(frames: Path) -> Path:
    """The trajectory of the flight without any option."""
    out = frames.parent / "plain.csv"
    track(frames, out)
    return out


@pytest.fixture(scope="module")
def no_drone_frames(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_frames(tmp_path_factory.mktemp("none") / "frames", make_flight(drone=False))


def files_in(directory: Path) -> list[str]:
    return sorted(p.name for p in directory.iterdir())


# --- the trajectory ---------------------------------------------------------------------------


def test_one_drone_gives_one_track_near_the_truth(plain_out: Path) -> None:
    traj = read_traj(plain_out)
    assert set(traj.track_id) == {traj.track_id[0]}
    assert len(traj) >= 58
    assert rmse_m(traj.position_m, truth_m(traj.time_s)) < 0.25
    speed_mps = np.linalg.norm(np.diff(truth_m(traj.time_s), axis=0), axis=1) / 0.1
    estimated_mps = np.linalg.norm(traj.velocity_mps, axis=1)[1:]
    assert np.median(np.abs(estimated_mps - speed_mps)) < 0.5


def test_rows_stand_at_the_stamps_of_the_first_sensors_frames(
    plain_out: Path, flight: Flight
) -> None:
    stamps = read_traj(plain_out).stamps
    expected = [seconds(s) for s in flight.stamps_ns]
    assert stamps == expected[expected.index(stamps[0]) :][: len(stamps)]


def test_sigmas_are_positive_and_support_counts_the_returns(
    frames: Path, plain_out: Path, tmp_path: Path
) -> None:
    traj = read_traj(plain_out)
    assert np.isfinite(traj.sigma_m).all() and (traj.sigma_m > 0).all()
    track(frames, tmp_path / "traj.csv", "--points", tmp_path / "target.pcd")
    assert traj.support.sum() <= len(read_binary_pcd(tmp_path / "target.pcd"))
    assert traj.support.sum() >= 5 * len(traj) * 0.9


def test_without_a_drone_there_is_only_a_header_and_one_line_on_stderr(
    no_drone_frames: Path, tmp_path: Path
) -> None:
    said = track(no_drone_frames, tmp_path / "traj.csv")
    assert (tmp_path / "traj.csv").read_text() == NO_DRONE_TRAJ
    assert len(said.strip().splitlines()) == 1, said


def test_sigma_grows_across_a_gap(flight: Flight, tmp_path: Path) -> None:
    gap = range(24, 36)  # 1.2 s: a part of sigma is common to all rows, along the ray
    with_gap = Flight(
        flight.stamps_ns,
        [c[c[:, 2] < 5] if i in gap else c for i, c in enumerate(flight.clouds)],
    )
    frames = write_frames(tmp_path / "frames", with_gap)
    track(frames, tmp_path / "traj.csv", "--set", "trajectory.max_sigma_m=1000")
    traj = read_traj(tmp_path / "traj.csv")
    assert len(set(traj.track_id)) == 1
    of_stamp = {s: i for i, s in enumerate(traj.stamps)}
    inside = of_stamp[seconds(flight.stamps_ns[30])]
    outside = of_stamp[seconds(flight.stamps_ns[15])]
    assert traj.sigma_m[inside].max() > 1.5 * traj.sigma_m[outside].max()
    assert traj.support[inside] == 0


# --- output times -----------------------------------------------------------------------------


@pytest.mark.parametrize("header", ["", "timestamp\n", "frame,timestamp,note\n"])
def test_at_gives_rows_at_just_those_stamps_inside_the_track(
    frames: Path, tmp_path: Path, header: str
) -> None:
    inside = [BEGIN_NS + ns for ns in (1_000_000_007, 2_345_678_901, 4_000_000_000)]
    outside = [BEGIN_NS - 10**9, BEGIN_NS + 3600 * 10**9]
    line = "{0}\n" if header in ("", "timestamp\n") else "f1,{0},hello\n"
    wanted = [outside[0], *inside, outside[1]]
    at = tmp_path / "at.csv"
    at.write_text(header + "".join(line.format(seconds(s)) for s in wanted))
    track(frames, tmp_path / "traj.csv", "--at", at)
    traj = read_traj(tmp_path / "traj.csv")
    assert traj.stamps == [seconds(s) for s in inside]
    assert rmse_m(traj.position_m, truth_m(traj.time_s)) < 0.3


def test_rate_gives_evenly_spaced_rows(frames: Path, tmp_path: Path) -> None:
    track(frames, tmp_path / "traj.csv", "--rate", "25")
    traj = read_traj(tmp_path / "traj.csv")
    assert len(traj) >= 140
    stamps_ns = [int(s.replace(".", "")) for s in traj.stamps]
    assert set(np.diff(stamps_ns)) == {40_000_000}
    assert rmse_m(traj.position_m, truth_m(traj.time_s)) < 0.25


def test_tum_holds_the_same_positions_with_unit_quaternions(
    frames: Path, plain_out: Path, tmp_path: Path
) -> None:
    track(frames, tmp_path / "traj.tum", "--format", "tum")
    lines = (tmp_path / "traj.tum").read_text().splitlines()
    rows = [line.split(" ") for line in lines if not line.startswith("#")]
    traj = read_traj(plain_out)
    assert [row[0] for row in rows] == traj.stamps
    values = np.array(rows, dtype=float)
    assert values.shape == (len(traj), 8)
    np.testing.assert_allclose(values[:, 1:4], traj.position_m, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(values[:, 4:], axis=1), 1, atol=1e-6)


# --- stamps of frames -------------------------------------------------------------------------


def in_nanoseconds(stamp_ns: int) -> str:
    return f"{stamp_ns}.pcd"


def in_microseconds(stamp_ns: int) -> str:
    return f"{stamp_ns // 1000}.pcd"


@pytest.mark.parametrize("name", [in_nanoseconds, in_microseconds], ids=["ns", "us"])
def test_integer_names_are_read_by_magnitude(
    flight: Flight, plain_out: Path, tmp_path: Path, name
) -> None:
    track(write_frames(tmp_path / "frames", flight, name), tmp_path / "traj.csv")
    got, plain = read_traj(tmp_path / "traj.csv"), read_traj(plain_out)
    unit_ns = 1 if name is in_nanoseconds else 1000
    expected = [seconds(s // unit_ns * unit_ns) for s in flight.stamps_ns]
    assert got.stamps == expected[: len(got)]
    np.testing.assert_allclose(got.position_m, plain.position_m, atol=1e-3)


def test_frames_are_ordered_by_number_and_not_by_letter(flight: Flight, tmp_path: Path) -> None:
    early = Flight([7 * 10**9 + i * PERIOD_NS for i in range(60)], flight.clouds)

    def short(stamp_ns: int) -> str:
        return f"{stamp_ns // 10**9}.{stamp_ns % 10**9 // 10**8}.pcd"

    frames = write_frames(tmp_path / "frames", early, short)
    assert files_in(frames)[0] == "10.0.pcd"
    track(frames, tmp_path / "traj.csv")
    traj = read_traj(tmp_path / "traj.csv")
    assert traj.stamps[0] == "7.000000000" and (np.diff(traj.time_s) > 0).all()
    assert rmse_m(traj.position_m, truth_m(traj.time_s, begin_s=7.0)) < 0.25


def write_stamps(frames: Path, rows: list[tuple[str, str]]) -> None:
    text = "".join(f"{file},{stamp}\n" for file, stamp in rows)
    (frames / "timestamps.csv").write_text("file,timestamp\n" + text)


def test_timestamps_csv_goes_before_the_names(
    flight: Flight, plain_out: Path, tmp_path: Path
) -> None:
    # The names count down: by them, time would run backwards.
    name_of = {s: f"{1000 - i}.pcd" for i, s in enumerate(flight.stamps_ns)}
    frames = write_frames(tmp_path / "frames", flight, name_of.__getitem__)
    write_stamps(frames, [(name_of[s], seconds(s)) for s in flight.stamps_ns])
    track(frames, tmp_path / "traj.csv")
    assert (tmp_path / "traj.csv").read_bytes() == plain_out.read_bytes()


def test_other_files_in_a_frame_directory_are_left_alone(
    flight: Flight, plain_out: Path, tmp_path: Path
) -> None:
    frames = write_frames(tmp_path / "frames", flight)
    (frames / "README.txt").write_text("not a frame")
    (frames / "0000.pcd.part").write_bytes(b"half a frame")
    (frames / "more").mkdir()
    track(frames, tmp_path / "traj.csv")
    assert (tmp_path / "traj.csv").read_bytes() == plain_out.read_bytes()


@pytest.mark.parametrize("kind", ["absolute_seconds", "relative_seconds", "relative_nanoseconds"])
def test_times_of_points_are_used_where_a_frame_has_them(
    flight: Flight, tmp_path: Path, kind: str
) -> None:
    # Only returns of the last tenth of each sweep: by the stamp alone they are 45 ms too early,
    # which at 4 m/s is 0.18 m along the path.
    frames = tmp_path / "frames"
    frames.mkdir()
    for i, (stamp_ns, cloud) in enumerate(zip(flight.stamps_ns, flight.clouds, strict=True)):
        rng = np.random.default_rng(i)
        static = cloud[(cloud[:, 2] < 5)]
        after_s = rng.uniform(0.09, 0.1, 8)
        drone = truth_m((stamp_ns - BEGIN_NS) * 1e-9 + after_s, begin_s=0.0)
        drone += rng.uniform(-0.05, 0.05, (8, 3))
        points = np.concatenate([static, drone]).astype(np.float32)
        times_s = np.concatenate([rng.uniform(0, 0.1, len(static)), after_s])
        extra = {
            "absolute_seconds": {"timestamp": stamp_ns * 1e-9 + times_s},
            "relative_seconds": {"time": times_s.astype(np.float32)},
            "relative_nanoseconds": {"t": (times_s * 1e9).astype(np.uint32)},
        }[kind]
        write_pcd(frames / decimal_name(stamp_ns), points, **extra)
    track(frames, tmp_path / "traj.csv")
    traj = read_traj(tmp_path / "traj.csv")
    assert len(traj) >= 57
    assert rmse_m(traj.position_m, truth_m(traj.time_s)) < 0.09


# --- several sensors --------------------------------------------------------------------------

QUARTER_TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # about z
QUARTER_TURN_XYZW = "[0, 0, 0.70710678118654752, 0.70710678118654752]"


def test_two_sensors_are_merged(flight: Flight, plain_out: Path, tmp_path: Path) -> None:
    left = Flight(flight.stamps_ns, [c[::2] for c in flight.clouds])
    right = Flight([s + 13_000_000 for s in flight.stamps_ns], [c[1::2] for c in flight.clouds])
    sources = [
        f"left={write_frames(tmp_path / 'a', left)}",
        f"right={write_frames(tmp_path / 'b', right)}",
    ]
    track(sources, tmp_path / "traj.csv", "--set", "sensors.right.time_offset_s=-0.013")
    traj = read_traj(tmp_path / "traj.csv")
    assert traj.stamps == read_traj(plain_out).stamps
    assert rmse_m(traj.position_m, truth_m(traj.time_s)) < 0.25


def test_a_sensors_pose_and_clock_bring_its_frames_into_the_common_frame(
    flight: Flight, tmp_path: Path
) -> None:
    mount_m = np.array([3.0, -2.0, 0.5])
    tilted = [((c[1::2] - mount_m) @ QUARTER_TURN).astype(np.float32) for c in flight.clouds]
    turned = Flight([s - 10**10 for s in flight.stamps_ns], tilted)
    sources = [
        f"straight={write_frames(tmp_path / 'a', flight)}",
        f"turned={write_frames(tmp_path / 'b', turned)}",
    ]
    config = tmp_path / "config.yaml"
    config.write_text(
        "sensors:\n  turned:\n    translation_m: [3.0, -2.0, 0.5]\n"
        f"    rotation: {QUARTER_TURN_XYZW}\n    time_offset_s: 10\n"
    )
    track(sources, tmp_path / "traj.csv", "--config", config)
    traj = read_traj(tmp_path / "traj.csv")
    assert len(set(traj.track_id)) == 1
    assert rmse_m(traj.position_m, truth_m(traj.time_s)) < 0.25
    # Both sensors see the drone: half as many returns again as the first has alone.
    assert traj.support.sum() > 1.3 * read_support(sources[0], tmp_path)


def read_support(source: str, tmp_path: Path) -> int:
    track([source], tmp_path / "alone.csv")
    return int(read_traj(tmp_path / "alone.csv").support.sum())


def test_a_turned_and_shifted_recording_gives_the_turned_and_shifted_trajectory(
    frames: Path, plain_out: Path, tmp_path: Path
) -> None:
    config = tmp_path / "config.yaml"
    config.write_text(
        "sensors:\n  lidar:\n    translation_m: [100, 20, -3]\n"
        f"    rotation: {QUARTER_TURN_XYZW}\n    time_offset_s: -100.5\n"
    )
    track([f"lidar={frames}"], tmp_path / "traj.csv", "--config", config)
    got, plain = read_traj(tmp_path / "traj.csv"), read_traj(plain_out)
    moved_ns = [int(s.replace(".", "")) - 100_500_000_000 for s in plain.stamps]
    assert got.stamps == [seconds(s) for s in moved_ns]
    expected = plain.position_m @ QUARTER_TURN.T + [100, 20, -3]
    assert rmse_m(got.position_m, expected) < 0.1
    assert rmse_m(got.velocity_mps, plain.velocity_mps @ QUARTER_TURN.T) < 0.5


def test_paths_may_hold_blanks_and_equals_signs(
    flight: Flight, plain_out: Path, tmp_path: Path
) -> None:
    frames = write_frames(tmp_path / "a b" / "c=d", flight)
    track([f"lidar={frames}"], tmp_path / "a b" / "my traj.csv")
    assert (tmp_path / "a b" / "my traj.csv").read_bytes() == plain_out.read_bytes()


# --- configuration ----------------------------------------------------------------------------


def test_the_documented_defaults_are_the_defaults(
    frames: Path, plain_out: Path, tmp_path: Path
) -> None:
    track(frames, tmp_path / "traj.csv", "--config", PROJECT / "configs" / "default.yaml")
    assert (tmp_path / "traj.csv").read_bytes() == plain_out.read_bytes()


def test_set_goes_before_the_config_file(frames: Path, plain_out: Path, tmp_path: Path) -> None:
    config = tmp_path / "config.yaml"
    config.write_text("input:\n  max_range_m: 1.0\n")
    track(frames, tmp_path / "near.csv", "--config", config)
    assert (tmp_path / "near.csv").read_text() == NO_DRONE_TRAJ
    track(frames, tmp_path / "traj.csv", "--config", config, "--set", "input.max_range_m=2000")
    assert (tmp_path / "traj.csv").read_bytes() == plain_out.read_bytes()


def test_the_last_of_two_settings_of_one_key_holds(
    frames: Path, plain_out: Path, tmp_path: Path
) -> None:
    settings = ("--set", "input.max_range_m=1", "--set", "input.max_range_m=2000")
    track(frames, tmp_path / "traj.csv", *settings)
    assert (tmp_path / "traj.csv").read_bytes() == plain_out.read_bytes()


# --- the other files --------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["robust", "paper"])
def test_clusters_are_finite_numbers(frames: Path, tmp_path: Path, method: str) -> None:
    clusters = tmp_path / "clusters.csv"
    track(frames, tmp_path / "traj.csv", "--clusters", clusters, "--set", f"method={method}")
    with clusters.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert rows and len(rows[0]) > 3
    for row in rows:
        for name, value in row.items():
            assert np.isfinite(float(value)), f"{name} is {value}"


def test_points_are_returns_of_the_drone(frames: Path, flight: Flight, tmp_path: Path) -> None:
    track(frames, tmp_path / "traj.csv", "--points", tmp_path / "target.pcd")
    points = read_binary_pcd(tmp_path / "target.pcd")
    given = {tuple(p) for cloud in flight.clouds for p in cloud}
    assert all(tuple(p) in given for p in points)
    drone = {tuple(p) for cloud in flight.clouds for p in cloud[cloud[:, 2] > 5]}
    found = {tuple(p) for p in points}
    assert len(found & drone) > 0.95 * len(drone)
    assert len(found - drone) < 0.05 * len(found)


def test_without_a_drone_the_other_files_are_valid_too(
    no_drone_frames: Path, tmp_path: Path
) -> None:
    extra = ("--points", tmp_path / "target.pcd", "--summary", tmp_path / "summary.json")
    track(no_drone_frames, tmp_path / "traj.csv", *extra)
    assert len(read_binary_pcd(tmp_path / "target.pcd")) == 0
    assert json.loads((tmp_path / "summary.json").read_text())["tracks"] == []


def test_summary_holds_version_effective_config_counts_times_and_tracks(
    frames: Path, flight: Flight, plain_out: Path, tmp_path: Path
) -> None:
    setting = ("--set", "input.max_range_m=1234.5")
    track(frames, tmp_path / "traj.csv", "--summary", tmp_path / "summary.json", *setting)
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["version"] in run_program("--version").stdout
    assert summary["config"]["input"]["max_range_m"] == 1234.5
    assert summary["config"]["input"]["min_range_m"] == pytest.approx(0.5)
    assert summary["counts"]["frames"] == len(flight.clouds)
    assert summary["counts"]["rows"] == sum(len(c) for c in flight.clouds)
    assert summary["times_s"] and all(v >= 0 for v in summary["times_s"].values())
    assert len(summary["tracks"]) == 1


# --- sameness ---------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["robust", "paper"])
def test_the_same_input_gives_the_same_bytes_for_any_thread_count(
    frames: Path, tmp_path: Path, method: str
) -> None:
    outputs = []
    for run, threads in enumerate(["1", "1", "2", "3"]):
        folder = tmp_path / str(run)
        folder.mkdir()
        track(
            frames, folder / "traj.csv", "--clusters", folder / "clusters.csv",
            "--points", folder / "target.pcd", "--threads", threads, "--set", f"method={method}",
        )  # fmt: skip
        outputs.append({p.name: p.read_bytes() for p in folder.iterdir()})
    assert len(outputs[0]) == 3
    assert all(output == outputs[0] for output in outputs[1:])


def test_an_output_is_replaced_whole_and_nothing_is_left_beside_it(
    frames: Path, plain_out: Path, tmp_path: Path
) -> None:
    (tmp_path / "traj.csv").write_text("older and longer\n" * 10_000)
    track(frames, tmp_path / "traj.csv")
    assert files_in(tmp_path) == ["traj.csv"]
    assert (tmp_path / "traj.csv").read_bytes() == plain_out.read_bytes()


def test_relative_paths_are_relative_to_the_callers_folder(
    frames: Path, plain_out: Path, tmp_path: Path
) -> None:
    result = run_program("--frames", frames.name, "--out", "relative.csv", cwd=frames.parent)
    assert result.returncode == 0, result.stderr
    assert (frames.parent / "relative.csv").read_bytes() == plain_out.read_bytes()


# --- words ------------------------------------------------------------------------------------


def test_help_names_every_option_and_version_a_version() -> None:
    shown = run_program("--help")
    assert shown.returncode == 0
    assert [option for option in OPTIONS if option not in shown.stdout] == []
    version = run_program("--version")
    assert version.returncode == 0
    assert version.stdout.strip().split()[-1].count(".") == 2


def test_quiet_says_nothing_and_verbose_more(frames: Path, tmp_path: Path) -> None:
    quiet = run_program("--frames", frames, "--out", tmp_path / "a.csv", "--quiet")
    assert (quiet.returncode, quiet.stdout, quiet.stderr) == (0, "", "")
    plain = run_program("--frames", frames, "--out", tmp_path / "b.csv")
    assert (plain.returncode, plain.stderr) == (0, "")
    verbose = run_program("--frames", frames, "--out", tmp_path / "c.csv", "--verbose")
    assert verbose.returncode == 0 and verbose.stderr != ""
