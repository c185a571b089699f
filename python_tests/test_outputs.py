"""Which files are written, which are refused before the work, and what is said meanwhile."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from synthetic import (
    Flight,
    make_flight,
    read_traj,
    run_program,
    track,
    with_opposite_drone,
    write_frames,
)

USAGE = 2


@pytest.fixture(scope="module")
def flight() -> Flight:
    return make_flight()


@pytest.fixture(scope="module")
def frames(flight: Flight, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_frames(tmp_path_factory.mktemp("outputs") / "frames", flight)


@pytest.fixture(scope="module")
def two_drones(flight: Flight, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("two")
    return write_frames(folder / "frames", with_opposite_drone(flight))


def refusal(*arguments: str | Path) -> str:
    result = run_program(*arguments)
    assert result.returncode == USAGE, result.stderr
    assert len(result.stderr.splitlines()) == 1
    return result.stderr


@pytest.mark.parametrize("option", ["--clusters", "--points", "--summary", "--trace"])
def test_two_outputs_cannot_be_one_file(frames: Path, tmp_path: Path, option: str) -> None:
    (tmp_path / "link").symlink_to(tmp_path)
    same = tmp_path / "link" / "traj.csv"
    said = refusal("--frames", frames, "--out", tmp_path / "traj.csv", option, same)
    assert option in said and "--out" in said and str(same) in said
    assert not same.exists()


@pytest.mark.parametrize(("option", "text"), [("--config", "method: robust\n"), ("--at", "1.5\n")])
def test_an_output_cannot_replace_what_is_read(
    frames: Path, tmp_path: Path, option: str, text: str
) -> None:
    (tmp_path / "both").write_text(text)
    said = refusal("--frames", frames, "--out", tmp_path / "both", option, tmp_path / "both")
    assert option in said and "--out" in said
    assert (tmp_path / "both").read_text() == text


@pytest.mark.parametrize("name", ["target.pcd", "timestamps.csv"])
def test_an_output_cannot_become_a_frame(frames: Path, tmp_path: Path, name: str) -> None:
    out = tmp_path / "traj.csv"
    said = refusal("--frames", frames, "--out", out, "--points", frames / name)
    assert str(frames / name) in said
    assert not out.exists() and not (frames / name).exists()


@pytest.mark.parametrize("second", ["a={0}", "{0}/../{0.name}"])
def test_each_lidar_is_given_once(frames: Path, tmp_path: Path, second: str) -> None:
    said = refusal(
        "--frames", f"a={frames}", "--frames", second.format(frames), "--out", tmp_path / "t.csv"
    )
    assert "--frames" in said


def test_quiet_says_nothing_and_verbose_reports_the_stages(frames: Path, tmp_path: Path) -> None:
    base = ("--frames", frames, "--out", tmp_path / "traj.csv")
    quiet = run_program(*base, "--quiet")
    assert (quiet.returncode, quiet.stdout, quiet.stderr) == (0, "", "")
    normal = run_program(*base)
    assert len(normal.stdout.splitlines()) == 1 and "1 track" in normal.stdout
    assert normal.stderr == ""
    verbose = run_program(*base, "--verbose")
    assert verbose.stdout == normal.stdout
    for stage in ("read", "targets", "trajectories"):
        assert f"{stage}: " in verbose.stderr


def test_times_stand_in_the_summary_only(frames: Path, tmp_path: Path) -> None:
    def run(name: str) -> dict[str, bytes]:
        folder = tmp_path / name
        folder.mkdir()
        extra = ("--clusters", folder / "c.csv", "--points", folder / "p.pcd")
        threads = "1" if name == "first" else "4"
        track(
            frames, folder / "t.csv", *extra, "--summary", folder / "s.json", "--threads", threads
        )
        return {p.name: p.read_bytes() for p in folder.iterdir()}

    first, second = run("first"), run("second")
    summaries = [json.loads(files.pop("s.json")) for files in (first, second)]
    assert first == second
    times = [summary.pop("times_s") for summary in summaries]
    assert summaries[0] == summaries[1]
    assert list(times[0]) == list(times[1]) and min(times[0].values()) >= 0


def test_tum_gives_each_track_a_file_and_the_strongest_the_asked_one(
    two_drones: Path, tmp_path: Path
) -> None:
    track(two_drones, tmp_path / "all.csv", "--summary", tmp_path / "s.json")
    traj = read_traj(tmp_path / "all.csv")
    tracks = json.loads((tmp_path / "s.json").read_text())["tracks"]
    assert [t["track_id"] for t in tracks] == [0, 1]
    best = max(tracks, key=lambda t: t["score"])["track_id"]
    out = tmp_path / "tum"
    out.mkdir()
    said = track(two_drones, out / "traj.tum", "--format", "tum")
    other = out / f"traj_track{1 - best}.tum"
    assert str(other) in said
    assert sorted(out.iterdir()) == sorted([out / "traj.tum", other])
    for path, track_id in ((out / "traj.tum", best), (other, 1 - best)):
        rows = [line.split() for line in path.read_text().splitlines()[1:]]
        assert [row[0] for row in rows] == [
            s for s, i in zip(traj.stamps, traj.track_id, strict=True) if i == track_id
        ]
