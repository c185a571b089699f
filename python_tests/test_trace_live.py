"""`--trace` of a stream: what was detected, and which rule refused a path or a track."""

from __future__ import annotations

import json
import signal
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
from live_program import Live, events_of, feed, messages, wait_until
from rejections import NEAR_GROUND, rejections
from synthetic import (
    BEGIN_NS,
    PERIOD_NS,
    Flight,
    make_flight,
    read_traj,
    run_program,
    seconds,
    write_frames,
)

FRAMES = 80


@pytest.fixture(scope="module")
def flight() -> Flight:
    return make_flight(frames=FRAMES)


@pytest.fixture(scope="module")
def frames(flight: Flight, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_frames(tmp_path_factory.mktemp("trace") / "lidar", flight)


def lines_of(trace: Path) -> dict[str, list[dict]]:
    kinds: dict[str, list[dict]] = defaultdict(list)
    for line in trace.read_text().splitlines():
        told = json.loads(line)
        kinds[told["trace"]].append(told)
    return kinds


def traced(frames: Path, folder: Path, *options: str | Path) -> dict[str, list[dict]]:
    """The objects of the trace by their kind."""
    code, _, said = feed(
        b"".join(messages(lidar=frames)),
        folder / "traj.csv",
        "--trace",
        folder / "trace.jsonl",
        *options,
    )
    assert code == 0, said
    return lines_of(folder / "trace.jsonl")


@pytest.fixture(scope="module")
def plain(frames: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[dict]]:
    return traced(frames, tmp_path_factory.mktemp("plain"))


def test_rows_and_events_are_the_same_with_and_without_a_trace(
    frames: Path, tmp_path: Path
) -> None:
    traced(frames, tmp_path, "--events", tmp_path / "events.jsonl")
    stream = b"".join(messages(lidar=frames))
    code, events, said = feed(stream, tmp_path / "other.csv", "--events", "-")
    assert code == 0, said
    assert (tmp_path / "traj.csv").read_bytes() == (tmp_path / "other.csv").read_bytes()
    assert (tmp_path / "events.jsonl").read_text() == events
    assert len(read_traj(tmp_path / "other.csv")) > 50


def test_every_frame_is_traced_once_and_every_rejection_is_a_rule(
    flight: Flight, plain: dict[str, list[dict]]
) -> None:
    assert len(plain["header"]) == 1
    assert [frame["stamp"] for frame in plain["frame"]] == [seconds(s) for s in flight.stamps_ns]
    returns = [frame["returns"] for frame in plain["frame"]]
    assert returns == [len(cloud) for cloud in flight.clouds]
    told = [*plain["frame"], *plain["path"], *plain["track"]]
    told += [d for frame in plain["frame"] for d in frame["detections"]]
    assert {one.get("rejection") for one in told} <= rejections() | {None}
    for path in plain["path"]:
        least = path["log_likelihood_ratio"] - path["crowding_penalty"]
        assert (path["rejection"] is None) == (path["track"] is not None)
        assert path["rejection"] is not None or least >= path["threshold"]
        assert sum(number for _, number in path["cuts"]) <= len(path["detections"])


def test_a_path_leads_through_detections_of_its_frames(plain: dict[str, list[dict]]) -> None:
    known = {(d["x"], d["y"], d["z"]) for frame in plain["frame"] for d in frame["detections"]}
    places = [tuple(d[1:]) for path in plain["path"] for d in path["detections"]]
    assert places and set(places) <= known


def test_a_track_is_told_from_its_initiation_to_its_end(
    frames: Path, plain: dict[str, list[dict]], tmp_path: Path
) -> None:
    states = [(t["track"], t["state"], t["rejection"]) for t in plain["track"]]
    assert states == [(0, "initiated", None), (0, "confirmed", None), (0, "deleted", None)]
    code, events, _ = feed(b"".join(messages(lidar=frames)), tmp_path / "traj.csv", "--events", "-")
    assert code == 0
    (confirmed,) = (e for e in events_of(events) if e["event"] == "track")
    assert float(plain["track"][1]["first"]) == pytest.approx(confirmed["first_evidence"], abs=1e-6)
    (path,) = (path for path in plain["path"] if path["track"] == 0)
    begun = float(plain["track"][0]["at"])
    for frame in plain["frame"]:
        drone = [d for d in frame["detections"] if d["z"] > 5]
        if float(frame["stamp"]) >= begun:
            assert {d["track"] for d in drone} == {0}
        else:
            assert not any("track" in d for d in drone)
    assert float(path["last"]) <= begun + 0.1


@pytest.mark.parametrize(
    ("options", "rejection"),
    [
        (NEAR_GROUND, "near_ground"),
        (("--set", "robust.min_cross_section_m2=1e6"), "weak_return"),
        (("--set", "robust.min_plots=1000"), "too_few_detections"),
    ],
)
def test_the_gate_that_refuses_the_drone_is_named_once_a_path_and_at_each_detection(
    frames: Path, tmp_path: Path, options: tuple[str, ...], rejection: str
) -> None:
    kinds = traced(frames, tmp_path, *options)
    assert kinds["track"] == []
    refused = [path for path in kinds["path"] if path["rejection"] == rejection]
    assert 1 <= len(refused) <= 3  # not one a frame
    named = [
        d for frame in kinds["frame"] for d in frame["detections"]
        if d.get("rejection") == rejection and d["z"] > 5
    ]  # fmt: skip
    assert len(named) > FRAMES / 2


def test_what_stands_still_far_away_waits_as_suspended_until_that_is_disabled(
    tmp_path: Path,
) -> None:
    flight = make_flight(drone=False, frames=FRAMES)
    rng = np.random.default_rng(3)
    clouds = [
        np.concatenate([cloud, np.float32([0, 60, 25]) + rng.normal(0, 0.02, (6, 3))]).astype("f4")
        for cloud in flight.clouds
    ]
    frames = write_frames(tmp_path / "frames", Flight(flight.stamps_ns, clouds))
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    at_rest = traced(frames, tmp_path / "a")
    assert ("waiting", "suspended") in {(t["state"], t["rejection"]) for t in at_rest["track"]}
    assert "confirmed" not in {t["state"] for t in at_rest["track"]}
    loose = traced(frames, tmp_path / "b", "--set", "robust.disabled_rules=[suspended]")
    assert "confirmed" in {t["state"] for t in loose["track"]}


def test_frames_are_there_while_it_runs_and_a_moved_file_is_begun_anew(
    frames: Path, tmp_path: Path
) -> None:
    trace, stream = tmp_path / "trace.jsonl", messages(lidar=frames)
    with Live("--stdin", "--out", tmp_path / "traj.csv", "--trace", trace) as live:
        live.send(b"".join(stream[:50]))
        wait_until(lambda: trace.exists() and trace.read_text().count('"frame"') > 20, "frames")
        trace.rename(tmp_path / "old.jsonl")
        live.signal(signal.SIGHUP)
        wait_until(trace.exists, "a new file")
        live.send(b"".join(stream[50:]))
        code, _, said = live.end()
    assert code == 0, said
    old, new = lines_of(tmp_path / "old.jsonl"), lines_of(trace)
    assert len(old["header"]) == len(new["header"]) == 1
    stamps = [frame["stamp"] for frame in old["frame"] + new["frame"]]
    assert stamps == [seconds(BEGIN_NS + i * PERIOD_NS) for i in range(FRAMES)]


def test_a_restart_appends_to_a_trace_with_long_lines(frames: Path, tmp_path: Path) -> None:
    traced(frames, tmp_path)
    trace = tmp_path / "trace.jsonl"
    long = json.dumps({"trace": "frame", "bodies": [[0.0, 0.0, 0.0]] * 20_000})
    trace.write_text(trace.read_text() + long + "\n" + '{"trace":"fra')
    (tmp_path / "traj.csv").unlink()
    kinds = traced(frames, tmp_path)
    assert len(kinds["header"]) == 2
    assert len(kinds["frame"]) == 2 * FRAMES + 1


def test_folders_that_are_followed_have_a_trace(frames: Path, tmp_path: Path) -> None:
    trace = tmp_path / "trace.jsonl"
    options = ("--follow", "--frames", f"lidar={frames}", "--trace", trace)
    with Live(*options, "--out", tmp_path / "traj.csv") as live:
        wait_until(lambda: trace.exists() and trace.read_text().count('"frame"') > 70, "frames")
        code, _, said = live.end(signal.SIGTERM)
    assert code == 0, said
    assert {frame["sensor"] for frame in lines_of(trace)["frame"]} == {"lidar"}


@pytest.mark.parametrize(
    ("options", "code", "expected"),
    [
        (["--trace", "-"], 2, "--trace -: not with --stdin, expected a file"),
        (["--trace", "traj.csv"], 2, "the same file as --out"),
        (["--trace", "absent/t"], 5, "absent/t"),
        (["--trace", "t", "--set", "live.delay_s=.inf"], 3, "expected a finite delay with --trace"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
def test_what_cannot_be_traced_is_refused(
    options: list[str], code: int, expected: str, tmp_path: Path
) -> None:
    result = run_program("--stdin", "--out", "traj.csv", *options, cwd=tmp_path)
    assert result.returncode == code, result.stderr
    assert expected in result.stderr
    assert len(result.stderr.splitlines()) == 1


def test_a_file_that_is_no_trace_is_left_alone(frames: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.write_text("mine\n")
    code, _, said = feed(b"", tmp_path / "traj.csv", "--trace", other)
    assert code == 5 and "other" in said
    assert other.read_text() == "mine\n"
