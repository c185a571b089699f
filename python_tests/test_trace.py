"""`--trace`: what was detected, and why paths of detections were refused."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from rejections import NEAR_GROUND, rejections
from synthetic import (
    Flight,
    make_flight,
    read_traj,
    run_program,
    track,
    with_opposite_drone,
    write_frames,
    write_pcd,
)


@pytest.fixture(scope="module")
def flight() -> Flight:
    return make_flight()


@pytest.fixture(scope="module")
def frames(flight: Flight, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_frames(tmp_path_factory.mktemp("trace") / "frames", flight)


def traced(frames: Path, folder: Path, *options: str | Path) -> dict[str, list[dict]]:
    """The objects of the trace by their kind."""
    track(frames, folder / "traj.csv", "--trace", folder / "trace.jsonl", *options)
    kinds: dict[str, list[dict]] = {"header": [], "frame": [], "path": []}
    for line in (folder / "trace.jsonl").read_text().splitlines():
        told = json.loads(line)
        kinds[told["trace"]].append(told)
    return kinds


def accepted(kinds: dict[str, list[dict]]) -> list[dict]:
    return [path for path in kinds["path"] if path["rejection"] is None]


def test_rows_are_the_same_with_and_without_a_trace(frames: Path, tmp_path: Path) -> None:
    traced(frames, tmp_path)
    track(frames, tmp_path / "other.csv")
    assert (tmp_path / "traj.csv").read_bytes() == (tmp_path / "other.csv").read_bytes()


def test_every_frame_is_traced_once_and_every_path_has_its_reason(
    flight: Flight, frames: Path, tmp_path: Path
) -> None:
    kinds = traced(frames, tmp_path)
    assert kinds["header"][0]["sensors"] == [frame["sensor"] for frame in kinds["frame"][:1]]
    stamps = [frame["stamp"] for frame in kinds["frame"]]
    assert stamps == [f"{s // 10**9}.{s % 10**9:09d}" for s in flight.stamps_ns]
    assert {path["rejection"] for path in kinds["path"]} <= rejections() | {None}
    tracks = read_traj(tmp_path / "traj.csv")
    assert len(accepted(kinds)) == len(set(tracks.track_id))
    for path in kinds["path"]:
        least = path["log_likelihood_ratio"] - path["crowding_penalty"]
        if path["rejection"] == "below_threshold":
            assert path["log_likelihood_ratio"] < path["threshold"]
        elif path["rejection"] is None:
            assert least >= path["threshold"]


def test_a_path_leads_through_detections_of_its_frames(frames: Path, tmp_path: Path) -> None:
    kinds = traced(frames, tmp_path)
    known = {
        (round(d["x"], 3), round(d["y"], 3), round(d["z"], 3))
        for frame in kinds["frame"]
        for d in frame["detections"]
    }
    places = [tuple(d[1:]) for path in kinds["path"] for d in path["detections"]]
    assert places and set(places) <= known


def test_a_long_recording_is_traced_window_by_window(tmp_path: Path) -> None:
    flight = make_flight(frames=150)
    frames = write_frames(tmp_path / "frames", flight)
    kinds = traced(
        frames, tmp_path, "--set", "robust.window_s=5", "--set", "robust.window_margin_s=1"
    )
    counts = Counter(frame["stamp"] for frame in kinds["frame"])
    assert len(counts) == 150 and set(counts.values()) == {1}
    assert len(kinds["header"]) == 1
    assert len(accepted(kinds)) >= 3  # one for each window


def test_clusters_of_a_long_recording_change_no_row(tmp_path: Path) -> None:
    frames = write_frames(tmp_path / "frames", make_flight(frames=150))
    options = ("--set", "robust.window_s=5", "--set", "robust.window_margin_s=1")
    track(frames, tmp_path / "plain.csv", *options)
    track(frames, tmp_path / "scored.csv", *options, "--clusters", tmp_path / "c.csv")
    assert (tmp_path / "plain.csv").read_bytes() == (tmp_path / "scored.csv").read_bytes()
    assert len((tmp_path / "plain.csv").read_text().splitlines()) > 50
    # Scored as a whole, however it is searched.
    track(frames, tmp_path / "whole.csv", "--clusters", tmp_path / "whole_clusters.csv")
    assert (tmp_path / "c.csv").read_bytes() == (tmp_path / "whole_clusters.csv").read_bytes()


def test_a_sky_without_a_return_has_frames_and_no_path(tmp_path: Path) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    for i in range(5):
        write_pcd(folder / f"{1_700_000_000 + i / 10:.1f}.pcd", np.zeros((0, 3), np.float32))
    kinds = traced(folder, tmp_path)
    assert len(kinds["frame"]) == 5 and kinds["path"] == []


@pytest.mark.parametrize(
    ("options", "rejection"),
    [
        (NEAR_GROUND, "near_ground"),
        (("--set", "robust.min_cross_section_m2=1e6"), "weak_return"),
        (("--set", "robust.min_plots=1000"), "too_few_detections"),
    ],
)
def test_the_gate_that_refuses_the_drone_is_named(
    frames: Path, tmp_path: Path, options: tuple[str, ...], rejection: str
) -> None:
    best = traced(frames, tmp_path)["path"][0]
    kinds = traced(frames, tmp_path, *options)
    assert accepted(kinds) == []
    assert best["rejection"] is None
    assert kinds["path"][0]["rejection"] == rejection


def test_a_drone_that_stands_still_far_away_is_refused_as_suspended_until_that_is_disabled(
    tmp_path: Path,
) -> None:
    flight = make_flight(drone=False)
    rng = np.random.default_rng(3)
    clouds = [
        np.concatenate([cloud, np.float32([0, 60, 25]) + rng.normal(0, 0.02, (6, 3))]).astype("f4")
        for cloud in flight.clouds
    ]
    frames = write_frames(tmp_path / "frames", Flight(flight.stamps_ns, clouds))
    at_rest = traced(frames, tmp_path)
    assert {path["rejection"] for path in at_rest["path"][:1]} == {"suspended"}
    loose = traced(frames, tmp_path, "--set", "robust.disabled_rules=[suspended]")
    assert loose["path"][0]["rejection"] != "suspended"


def test_two_drones_are_two_paths(flight: Flight, tmp_path: Path) -> None:
    frames = write_frames(tmp_path / "frames", with_opposite_drone(flight))
    assert len(accepted(traced(frames, tmp_path))) == 2


def test_the_paper_has_no_trace(frames: Path, tmp_path: Path) -> None:
    out = tmp_path / "traj.csv"
    result = run_program(
        "--frames", frames, "--out", out, "--trace", tmp_path / "t", "--set", "method=paper"
    )
    assert result.returncode == 3
    assert result.stderr.splitlines() == [
        "unlidar_track: error: method: 'paper', expected robust with --trace"
    ]
    assert not out.exists()
