"""Events `now`: where a track is, before its row comes."""

from __future__ import annotations

import json
import sqlite3
import xml.etree.ElementTree as Xml
from pathlib import Path

import numpy as np
import pytest
from live_program import events_of, feed
from live_program import messages as frames_of
from station_events import ORIGIN, now, row, square, track, write_site
from synthetic import make_flight, truth_m, write_frames
from unlidar.events.event import Now, decode
from unlidar.events.site import Place, Site, load_site, load_zones
from unlidar.events.station import Station
from unlidar.history.store import Store
from unlidar.relay.cot import Encoder


def messages(station: Station, *lines: str) -> list:
    return [message for line in lines for message in station.take(line)]


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("x", "1e7"), ("vy", "true"), ("sigma_z", "-0.1"), ("unseen_s", "-1"), ("unseen_s", "1e9"),
        ("unseen_s", '"1"'), ("track", "1.5"), ("timestamp", "1"), ("drone", "1.5"),
        ("bird_like", "-0.5"),
    ],
)  # fmt: skip
def test_a_value_out_of_its_bounds_is_refused_by_its_name(key: str, value: str) -> None:
    line = now(1, 0.5, drone=0.5, bird_like=0.1)
    before, _, rest = line.partition(f'"{key}":')
    end = rest.find(",") if "," in rest else rest.find("}")
    with pytest.raises(ValueError, match=f"{key}: "):
        decode(f'{before}"{key}":{value}{rest[end:]}')


@pytest.mark.parametrize("key", ["unseen_s", "x", "timestamp", "track", "sigma_x"])
def test_a_value_that_is_missing_is_named(key: str) -> None:
    parts = json.loads(now(1, 0.5))
    del parts[key]
    with pytest.raises(ValueError, match=f"{key}: "):
        decode(json.dumps(parts))


def test_a_position_has_its_place_and_raises_no_alarm(tmp_path) -> None:
    site = load_site(write_site(tmp_path, [square(50, "apron")]))
    station = Station(site, load_zones(site))
    told = messages(station, *(now(7, t / 10) for t in range(100)))
    assert {type(message.event) for message in told} == {Now}
    values = json.loads(told[-1].text)
    assert values["latitude_deg"] == pytest.approx(47.0, abs=1e-6)
    assert values["unseen_s"] == 0.0
    rows = messages(station, *(row(7, t / 10) for t in range(100)))
    assert [message.kind for message in rows if message.kind != "row"] == ["alarm"]


def test_a_track_that_is_told_of_is_alive() -> None:
    station = Station(Site())
    messages(station, track(7, 1.0), row(7, 1.0))
    told = messages(station, *(now(7, 1.0 + t) for t in range(1, 100, 9)), row(7, 100.0))
    assert "end" not in {message.kind for message in told}


def test_the_history_keeps_rows_alone(tmp_path) -> None:
    station = Station(Site())
    store = Store(tmp_path / "sky.db", 1.0, 10.0)
    store.take(messages(station, track(7, 1.0), row(7, 1.0), now(7, 2.0), now(8, 2.0)))
    store.close()
    with sqlite3.connect(tmp_path / "sky.db") as db:
        assert db.execute("SELECT count(*) FROM row").fetchone() == (1,)
        assert db.execute("SELECT count(*) FROM told").fetchone() == (0,)


def told_by_cot(*lines: str) -> list[float]:
    """Longitudes that clients of Cursor on Target get."""
    site = Site(origin=Place(**ORIGIN))
    station, encoder = Station(site), Encoder(site.origin, 0.0)
    texts = [encoder.encode(message) for message in messages(station, *lines)]
    events = [Xml.fromstring(text) for text in texts if text is not None]
    return [float(event.find("point").get("lon")) for event in events]


def test_cursor_on_target_tells_where_a_track_is_now() -> None:
    lines = [
        line
        for t in range(30)
        for line in (
            now(7, 2.0 + t / 10, (20.0 + t, 0.0, 9.0)),
            row(7, 1.0 + t / 10, (10.0 + t, 0.0, 9.0), drone=0.9),
        )
    ]
    told = told_by_cot(*lines)
    assert len(told) == 30
    assert told == told_by_cot(*lines[::2])
    rows = told_by_cot(*lines[1::2])
    assert told[0] > rows[0]
    # Where the engine tells no more of now, rows do.
    later = [row(7, 5.0 + t / 10, (50.0 + t, 0.0, 9.0)) for t in range(5)]
    assert len(told_by_cot(*lines, *later)) == 35


def test_cursor_on_target_tells_of_now_what_rows_say_it_is() -> None:
    site = Site(origin=Place(**ORIGIN))
    station, encoder = Station(site), Encoder(site.origin, 0.0)
    told = messages(station, row(7, 1.0, drone=0.9), now(7, 2.0))
    remarks = [Xml.fromstring(encoder.encode(m)).findtext("detail/remarks") for m in told]
    assert all("drone 0.90" in text for text in remarks)


def test_its_sigmas_are_as_large_as_its_errors(tmp_path: Path) -> None:
    """Errors over sigmas, squared and summed over three axes, average 3."""
    nees = []
    for seed in (1, 2, 3):
        frames = frames_of(lidar=write_frames(tmp_path / f"{seed}", make_flight(seed, 120)))
        code, out, said = feed(b"".join(frames), tmp_path / f"{seed}.csv", "--events", "-")
        assert code == 0, said
        told = [event for event in events_of(out) if event["event"] == "now"]
        errors_m = np.array([[e[axis] for axis in "xyz"] for e in told])
        errors_m -= truth_m([e["timestamp"] for e in told])
        sigmas_m = np.array([[e[f"sigma_{axis}"] for axis in "xyz"] for e in told])
        nees += list(np.sum((errors_m / sigmas_m) ** 2, axis=1))
    assert len(nees) > 200
    assert 2 < np.mean(nees) < 4
    assert np.mean(np.array(nees) < 7.81) > 0.9  # of chi-square with three degrees of freedom, 0.95
