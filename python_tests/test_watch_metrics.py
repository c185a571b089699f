"""`/metrics` of `unlidar watch`: what the page knows, for Prometheus."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from live_program import wait_until
from station_events import appended, row, sensor, square, state, track, write_site
from test_live_status import metrics_of
from test_watch import SECRET, Watch
from unlidar.events.site import Site
from unlidar.events.station import Station
from unlidar.watch.connections import Connections
from unlidar.watch.metrics import Metrics, Taken
from unlidar.watch.pages import Pages
from unlidar.watch.sky import Sky


def scraped(watch: Watch, path: Path, **headers: str) -> dict[str, float]:
    status, told, content = watch.ask("/metrics", **headers)
    assert status == 200
    assert told["content-type"] == "text/plain; version=0.0.4; charset=utf-8"
    path.write_bytes(content)
    return metrics_of(path)


def in_process(*messages_of: tuple[str, list[str]]) -> tuple[Sky, Metrics]:
    """A sky that took the events of stations by name."""
    sky = Sky()
    for name, lines in messages_of:
        station = Station(Site(station=name))
        for line in lines:
            for message in station.take(line):
                sky.take(message)
    return sky, Metrics(sky, Pages(sky), Connections(), Taken())


def test_they_tell_what_the_page_shows(tmp_path: Path) -> None:
    events = tmp_path / "events.jsonl"
    more = appended(events)
    more(
        *(sensor("mid360", "ok", clock="lost"), sensor("avia", "blinded"), "rubbish", "{}"),
        *(state("running", frames=90, dropped=3), track(7, 1.0), track(8, 1.0), row(8, 1.0)),
        *(row(7, t / 10) for t in range(30)),
    )
    site = write_site(tmp_path, [square(50, "apron")])
    with Watch(events, "--site", site) as watch, watch.live() as pages:
        wait_until(lambda: "snapshot" in [name for name, _ in pages], "a page is open")
        path = tmp_path / "x.prom"
        wait_until(
            lambda: scraped(watch, path).get('unlidar_watch_events_total{fate="taken"}') == 36,
            "all events came",
        )
        found = scraped(watch, path)
        (station,) = {m for key in found for m in re.findall(r'station="([^"]*)"', key)}
        at = f'{{station="{station}"'
        snapshot = next(data for name, data in pages if name == "snapshot")
        assert len(snapshot["tracks"]) <= found[f"unlidar_watch_tracks{at}}}"] == 2
        assert found[f"unlidar_watch_alarms{at}}}"] == 1
        assert found['unlidar_watch_events_total{fate="refused"}'] == 2
        assert found[f'unlidar_watch_engine_state{at},state="running"}}'] == 1
        assert found[f'unlidar_watch_engine_state{at},state="overloaded"}}'] == 0
        assert found[f"unlidar_watch_frames_total{at}}}"] == 90
        assert found[f"unlidar_watch_frames_dropped_total{at}}}"] == 3
        assert found[f'unlidar_watch_sensor_state{at},sensor="avia",state="blinded"}}'] == 1
        assert found[f'unlidar_watch_sensor_state{at},sensor="avia",state="ok"}}'] == 0
        assert found[f'unlidar_watch_sensor_state{at},sensor="mid360",state="ok"}}'] == 1
        assert found[f'unlidar_watch_sensor_clock{at},sensor="mid360",clock="lost"}}'] == 1
        assert not any("sensor_clock" in key and "avia" in key for key in found)
        assert found["unlidar_watch_pages"] == 1 and found["unlidar_watch_connections"] == 2
        assert found["unlidar_watch_crowded"] == 0
        assert found[f"unlidar_watch_last_event_age_seconds{at}}}"] >= 0
        assert watch.end()[0] == 0


def test_they_need_what_the_page_needs(tmp_path: Path) -> None:
    token = tmp_path / "token"
    token.write_text(SECRET + "\n")
    events = tmp_path / "events.jsonl"
    appended(events)(state("running"))
    with Watch(events, "--token-file", token) as watch:
        for refused in ({}, {"Authorization": "Bearer x"}, {"Authorization": SECRET}):
            status, _, content = watch.ask("/metrics", **refused)
            assert status == 401 and b"unlidar_" not in content
        path = tmp_path / "x.prom"
        assert scraped(watch, path, Authorization=f"Bearer {SECRET}")["unlidar_watch_pages"] == 0
        assert SECRET not in path.read_text()
        foreign = {"Authorization": f"Bearer {SECRET}", "Origin": "https://elsewhere.org"}
        assert watch.ask("/metrics", **foreign)[0] == 403
        assert SECRET not in watch.end()[1]
    with Watch(events) as watch:
        assert watch.ask("/metrics", Host="elsewhere.org")[0] == 421


def test_names_are_escaped(tmp_path: Path) -> None:
    name = 'a"b\\c\\nd{e}=,'
    _, metrics = in_process(("north", [sensor(name, "ok")]))
    path = tmp_path / "x.prom"
    path.write_text(metrics.text())
    (label,) = {
        json.loads(f'"{word}"')
        for key in metrics_of(path)
        for word in re.findall(r'sensor="((?:[^"\\]|\\.)*)"', key)
    }
    assert label == name


def test_series_are_bounded_whatever_is_said(tmp_path: Path) -> None:
    lines = [
        *(sensor(f"{'x' * 100}{k}", f"state {k}", clock=f"clock {k}") for k in range(64)),
        *(state(f"state {k}") for k in range(64)),
    ]
    _, metrics = in_process(*((f"station{k}", lines) for k in range(100)))
    text = metrics.text()
    assert text.count("\n") < 64 * 16 * (3 + 3) + 64 * 12 + 100
    path = tmp_path / "x.prom"
    path.write_text(text)
    metrics_of(path)
    assert not re.search(r'(state|clock)="(state|clock) ', text)


def test_scrapes_within_a_second_share_an_answer() -> None:
    sky, metrics = in_process(("north", [sensor("a", "ok")]))
    first = metrics.text()
    station = Station(Site(station="south"))
    for message in station.take(state("running")):
        sky.take(message)
    assert metrics.text() == first
    metrics._made_s -= 1.0
    assert 'station="south"' in metrics.text()


@pytest.mark.skipif(shutil.which("promtool") is None, reason="promtool is not installed")
def test_promtool_finds_nothing_to_say() -> None:
    lines = [sensor("a", "ok", clock="lost"), state("running"), track(1, 1.0), row(1, 1.0)]
    _, metrics = in_process(("north", lines), ("south", lines))
    checked = subprocess.run(
        ["promtool", "check", "metrics"], input=metrics.text().encode(), capture_output=True
    )
    assert (checked.returncode, checked.stdout + checked.stderr) == (0, b"")
