"""The kind of a track in the summary, the events and the report; `--only-drones`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from live_program import events_of, feed, messages, rows_of
from report_run import make_run
from synthetic import (
    NO_DRONE_TRAJ,
    make_flight,
    run_program,
    track,
    with_opposite_drone,
    write_frames,
)

KINDS = ("drone", "bird_like", "unknown")


PACE = 2.0  # 8 m/s in circles: like a bird


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two fast drones, of which one is seen for half as long."""
    flight = with_opposite_drone(make_flight(pace=PACE))
    return write_frames(tmp_path_factory.mktemp("two") / "lidar", flight)


@pytest.fixture(scope="module")
def plain(frames: Path) -> tuple[str, list[dict]]:
    """The trajectory without the option, and the tracks of the summary."""
    out, summary = frames.parent / "plain.csv", frames.parent / "plain.json"
    track(frames, out, "--summary", summary)
    return out.read_text(), json.loads(summary.read_text())["tracks"]


def only_drones(max_bird_like: float) -> str:
    """The P that leaves out what is more of a bird than this."""
    return f"{2 - 2 * max_bird_like:.5f}"


def test_the_summary_says_what_each_track_may_be_and_why(plain) -> None:
    tracks = plain[1]
    assert len(tracks) == 2
    for one in tracks:
        assert list(one["kind"]) == list(KINDS)
        assert sum(one["kind"].values()) == pytest.approx(1, abs=1e-9)
        assert one["flight"]["judged_s"] == int(one["duration_s"])
        assert one["flight"]["speed_mps"] == pytest.approx(8.0, abs=0.6)
        assert set(one["flight"]["log_ratio"]) == {"speed", "climb", "turn"}
        assert one["flight"]["log_ratio"]["speed"] < 0  # the speed of a bird
        assert 0.05 < one["echo"]["extent_m"] < 0.3
        # 5 to 10 returns in each of 10 frames a second, 7 m and 8 m away
        assert one["echo"]["echo_m2_per_s"] == pytest.approx(75 * 113, rel=0.5)


@pytest.mark.parametrize("birds", [0, 1])
def test_only_drones_leaves_out_the_rows_of_what_is_surely_a_bird_and_no_more(
    frames: Path, tmp_path: Path, plain, birds: int
) -> None:
    text, tracks = plain
    tracks = sorted(tracks, key=lambda one: -one["kind"]["bird_like"])
    surest = tracks[0]["kind"]["bird_like"]
    assert surest > 0.5
    least = only_drones(surest + (-1e-4 if birds else 1e-4))
    out, summary = tmp_path / "traj.csv", tmp_path / "summary.json"
    points = tmp_path / "points.pcd"
    said = track(frames, out, "--only-drones", least, "--summary", summary, "--points", points)
    kept = {one["track_id"] for one in tracks[birds:]}
    head, *rows = text.splitlines(keepends=True)
    assert out.read_text() == head + "".join(r for r in rows if int(r.split(",")[1]) in kept)
    told = json.loads(summary.read_text())
    assert {one["track_id"] for one in told["tracks"]} == kept
    assert told["counts"]["tracks_left_out"] == birds
    assert told["counts"]["target_returns"] == sum(one["returns"] for one in tracks[birds:])
    assert f"POINTS {told['counts']['target_returns']}\n".encode() in points.read_bytes()
    assert ("left out" in said) == (birds > 0)


def test_without_any_drone_only_the_header_is_left(tmp_path: Path) -> None:
    bird = write_frames(tmp_path / "lidar", make_flight(pace=PACE))
    for form in ("csv", "tum"):
        said = track(bird, tmp_path / f"traj.{form}", "--only-drones", "1", "--format", form)
        assert "1 track left out" in said and "no drone found" in said
    assert (tmp_path / "traj.csv").read_text() == NO_DRONE_TRAJ


def test_what_is_hardly_known_is_kept_whatever_is_asked_for(tmp_path: Path) -> None:
    short = write_frames(tmp_path / "lidar", make_flight(frames=20))
    for least in ("0", "1"):
        track(short, tmp_path / f"{least}.csv", "--only-drones", least)
    assert (tmp_path / "1.csv").read_text() == (tmp_path / "0.csv").read_text() != NO_DRONE_TRAJ


def test_zero_leaves_nothing_out(frames: Path, tmp_path: Path, plain) -> None:
    track(frames, tmp_path / "traj.csv", "--only-drones", "0")
    assert (tmp_path / "traj.csv").read_text() == plain[0]


@pytest.mark.parametrize("value", ["-0.1", "1.01", "nan", "inf", "many", ""])
@pytest.mark.parametrize("live", [False, True])
def test_what_is_no_probability_is_a_usage_error(
    frames: Path, tmp_path: Path, value: str, live: bool
) -> None:
    source = ["--stdin"] if live else ["--frames", frames]
    result = run_program(*source, "--out", tmp_path / "traj.csv", "--only-drones", value)
    assert result.returncode == 2
    assert len(result.stderr.splitlines()) == 1
    assert "--only-drones" in result.stderr
    assert not (tmp_path / "traj.csv").exists()


# --- live -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def stream(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    flight = make_flight(frames=120, pace=PACE)
    frames = write_frames(tmp_path_factory.mktemp("stream") / "lidar", flight)
    return b"".join(messages(lidar=frames))


@pytest.fixture(scope="module")
def told(stream: bytes, tmp_path_factory: pytest.TempPathFactory) -> tuple[list[str], list[dict]]:
    out = tmp_path_factory.mktemp("told") / "traj.csv"
    code, events, said = feed(stream, out, "--events", "-")
    assert code == 0, said
    return rows_of(out), events_of(events)


def test_events_report_what_is_known_by_then(told) -> None:
    events = [event for event in told[1] if "drone" in event]
    assert {event["event"] for event in events} == {"track", "row", "end"}
    assert events[-1]["unknown"] < events[0]["unknown"]  # the more is seen the surer


def test_rows_wait_while_the_track_is_surely_a_bird(stream: bytes, tmp_path: Path, told) -> None:
    rows, events = told
    birds = [event["bird_like"] for event in events if event["event"] == "row"]
    assert len(rows) == len(birds)
    limit = (0.5 + max(birds)) / 2
    written, held = [], []
    for row, bird_like in zip(rows, birds, strict=True):
        held.append(row)
        if bird_like <= limit:
            written += held
            held = []
    assert held and written
    out = tmp_path / "traj.csv"
    code, text, said = feed(stream, out, "--events", "-", "--only-drones", only_drones(limit))
    assert code == 0, said
    assert rows_of(out) == written
    told_of = [e["event"] for e in events_of(text) if "track" in e]
    assert [e for e in told_of if e != "now"] == ["track"] + ["row"] * len(written) + ["end"]
    assert told_of[0] == "track" and "now" in told_of
    assert said.count("left out") == 0


def test_live_a_bird_throughout_is_not_reported(stream: bytes, tmp_path: Path) -> None:
    out, summary = tmp_path / "traj.csv", tmp_path / "summary.json"
    settings = ["--set", "live.delay_s=.inf", "--set", "live.window_s=.inf"]  # judged as a whole
    code, text, said = feed(
        stream, out, "--events", "-", "--only-drones", "1", "--summary", summary, *settings
    )
    assert code == 0
    assert out.read_text() == NO_DRONE_TRAJ
    assert {event["event"] for event in events_of(text)} == {"sensor", "state"}
    assert "1 track left out" in said and "no drone found" in said
    counts = json.loads(summary.read_text())["counts"]
    assert (counts["tracks"], counts["tracks_left_out"]) == (0, 1)


def test_live_summary_has_the_kind_of_each_track(stream: bytes, tmp_path: Path, told) -> None:
    summary = tmp_path / "summary.json"
    code, _, said = feed(stream, tmp_path / "traj.csv", "--summary", summary)
    assert code == 0, said
    end = next(event for event in told[1] if event["event"] == "end")
    (one,) = json.loads(summary.read_text())["tracks"]
    assert one["kind"] == {key: end[key] for key in KINDS}


# --- the report -------------------------------------------------------------------------------


def test_the_report_shows_what_each_track_may_be(tmp_path: Path) -> None:
    from unlidar.report.data import load_run
    from unlidar.report.html import tracks_table

    shown = tracks_table(load_run(make_run(tmp_path / "run")), 0.0)
    for text in ("bird-like", "0.75", "0.0625", "0.1875", "hovers", "0.375", "-1.625"):
        assert f">{text}<" in shown, text
    assert "{" not in shown  # nested values have columns of their own
