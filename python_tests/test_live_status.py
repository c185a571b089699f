"""--state and --metrics of a live run, and the JSON Schemas of what it writes."""

from __future__ import annotations

import json
import re
import shutil
import signal
import subprocess
from pathlib import Path

import jsonschema
import pytest
from live_program import FIELDS, Live, events_of, feed, messages, rows_of, wait_until
from synthetic import PROGRAM, PROJECT, make_flight, write_frames

SCHEMAS = PROJECT / "docs/schemas"
SAMPLE = re.compile(r"^([a-z_]+)(?:\{(.*)\})? (\S+)$")


@pytest.fixture(scope="module")
def stream(tmp_path_factory: pytest.TempPathFactory) -> list[bytes]:
    return messages(lidar=write_frames(tmp_path_factory.mktemp("flight") / "lidar", make_flight()))


def schema(name: str) -> dict:
    return json.loads((SCHEMAS / f"{name}.schema.json").read_text())


def state_of(path: Path) -> dict:
    state = json.loads(path.read_text())
    jsonschema.validate(state, schema("state"))
    return state


def metrics_of(path: Path) -> dict[str, float]:
    """Every sample, where each belongs to a family with help and type, as the format asks for."""
    types: dict[str, str] = {}
    helped: set[str] = set()
    samples: dict[str, float] = {}
    for line in path.read_text().splitlines():
        if line.startswith("# HELP "):
            name = line.split()[2]
            assert name not in helped, line
            helped.add(name)
        elif line.startswith("# TYPE "):
            _, _, name, kind = line.split()
            assert name in helped and name not in types, line
            types[name] = kind
            assert name.endswith("_total") == (kind == "counter"), line
        else:
            found = SAMPLE.match(line)
            assert found is not None, line
            family = re.sub("_(sum|count)$", "", found[1])
            assert types.get(found[1], types.get(family)) is not None, line
            key = line.rpartition(" ")[0]
            assert key not in samples, line
            samples[key] = float(found[3])
    return samples


def test_events_of_all_kinds_are_of_the_schema(stream: list[bytes], tmp_path: Path) -> None:
    options = "--events", "-", "--event-returns", "100"
    code, out, said = feed(b"".join(stream), tmp_path / "traj.csv", *options)
    assert code == 0, said
    events = events_of(out)
    assert {e["event"] for e in events} == set(FIELDS)
    validator = jsonschema.Draft202012Validator(schema("events"))
    for event in events:
        validator.validate(event)
        for key in event:
            with pytest.raises(jsonschema.ValidationError):
                validator.validate({k: v for k, v in event.items() if k != key})


def test_the_event_now_tells_where_a_track_is_at_each_stamp(
    stream: list[bytes], tmp_path: Path
) -> None:
    code, out, said = feed(b"".join(stream), tmp_path / "traj.csv", "--events", "-")
    assert code == 0, said
    events = events_of(out)
    now = [e for e in events if e["event"] == "now"]
    begun = next(k for k, e in enumerate(events) if e["event"] == "track")
    assert all(e["event"] != "now" for e in events[:begun])
    assert all(e["at"] == e["timestamp"] for e in now)
    stamps = [e["at"] for e in now]
    assert len(stamps) > 10 and len(set(stamps)) == len(stamps)
    latest = {e["timestamp"] for e in events if e["event"] == "row"}
    assert max(stamps) >= max(latest)


def test_state_and_metrics_tell_of_the_run(stream: list[bytes], tmp_path: Path) -> None:
    state, metrics = tmp_path / "state.json", tmp_path / "unlidar.prom"
    out = tmp_path / "traj.csv"
    with Live("--stdin", "--out", out, "--state", state, "--metrics", metrics) as live:
        wait_until(state.exists, "there is a state")
        assert state_of(state)["state"] == "warming_up" and state_of(state)["sensors"] == []
        for data in stream:
            live.send(data)
        # Replaced as a whole: a reader that has it open keeps the old one.
        before = state.stat().st_ino
        wait_until(lambda: state_of(state)["counts"]["frames"] == len(stream), "all are counted")
        assert state.stat().st_ino != before
        known = state_of(state)
        assert known["state"] == "running" and known["load"]["one_in"] == 1
        assert [(s["name"], s["state"]) for s in known["sensors"]] == [("lidar", "ok")]
        (track,) = known["tracks"]
        assert track["timestamp"] == known["at"]
        found = metrics_of(metrics)
        assert found["unlidar_tracks"] == 1 and found['unlidar_state{state="running"}'] == 1
        code, _, said = live.end()
        assert code == 0, said
    known, found = state_of(state), metrics_of(metrics)
    assert known["state"] == "stopped" and known["tracks"] == []
    assert found["unlidar_tracks"] == 0 and found["unlidar_tracks_total"] == 1
    assert found["unlidar_rows_total"] == len(rows_of(out))
    assert found['unlidar_frames_total{sensor="lidar"}'] == len(stream)
    assert found["unlidar_frame_cpu_seconds_count"] == len(stream)
    assert found['unlidar_sensor_state{sensor="lidar",state="ok"}'] == 1
    assert found["process_resident_memory_bytes"] > 1e6


def test_names_of_folders_are_escaped_in_labels(tmp_path: Path) -> None:
    metrics = tmp_path / "unlidar.prom"
    folder = write_frames(tmp_path / 'of "mine"', make_flight(frames=1))
    with Live(
        "--follow", "--frames", folder, "--out", tmp_path / "traj.csv", "--metrics", metrics
    ) as live:
        wait_until(metrics.exists, "there are metrics")
        code, _, said = live.end(signal.SIGTERM)
    assert code == 0, said
    assert 'unlidar_frames_total{sensor="of \\"mine\\""}' in metrics_of(metrics)


@pytest.mark.skipif(shutil.which("promtool") is None, reason="promtool is not installed")
def test_promtool_finds_nothing_to_say(stream: list[bytes], tmp_path: Path) -> None:
    metrics = tmp_path / "unlidar.prom"
    code, _, said = feed(b"".join(stream), tmp_path / "traj.csv", "--metrics", metrics)
    assert code == 0, said
    checked = subprocess.run(
        ["promtool", "check", "metrics"], input=metrics.read_bytes(), capture_output=True
    )
    assert (checked.returncode, checked.stdout + checked.stderr) == (0, b"")


@pytest.mark.parametrize("option", ["--state", "--metrics"])
def test_what_cannot_be_written_is_said_before_the_work(
    option: str, stream: list[bytes], tmp_path: Path
) -> None:
    for path, code, reason in (
        ("/dev/null", 2, "no regular file"),
        (str(tmp_path / "traj.csv"), 2, "the same file as --out"),
        (str(tmp_path / "none" / "x"), 5, "none"),
    ):
        ended, _, said = feed(stream[0], tmp_path / "traj.csv", option, path)
        assert ended == code and reason in said and said.count("\n") == 1, said
    done = subprocess.run(
        [PROGRAM, "--frames", tmp_path, "--out", tmp_path / "t.csv", option, tmp_path / "x"],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2 and "expected with --follow" in done.stderr


def test_a_state_that_cannot_be_replaced_any_more_stops_nothing(
    stream: list[bytes], tmp_path: Path
) -> None:
    folder = tmp_path / "gone"
    folder.mkdir()
    state = folder / "state.json"
    with Live("--stdin", "--out", tmp_path / "traj.csv", "--state", state) as live:
        wait_until(state.exists, "there is a state")
        shutil.rmtree(folder)
        for data in stream:
            live.send(data)
        wait_until(lambda: rows_of(tmp_path / "traj.csv"), "there are rows")
        code, _, said = live.end()
    assert code == 0
    assert said.count("state.json") == 1, said
