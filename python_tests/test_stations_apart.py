"""Several stations of which one lies, floods, vanishes or has another's name: who suffers."""

from __future__ import annotations

import json
import time
from collections.abc import Callable

import pytest
from station_events import BEGIN_NS, ORIGIN, end, row, sensor, square, track, write_site
from unlidar.events.lines import Published
from unlidar.events.many import Many
from unlidar.events.site import Place, Site, load_site, load_zones
from unlidar.events.station import SILENT_S, Message, Station


def published(name: str, line: str, relay: str | None = None, retained: bool = False) -> Published:
    values = json.loads(line)
    assert "station" not in values
    text = line if relay is None else f'{line[:-1]},"instance":"{relay}"}}'
    return Published(name, text.encode(), gone=False, retained=retained)


def gone(name: str) -> Published:
    return Published(name, b"offline", gone=True, retained=False)


def shown(many: Many, *messages: Published) -> list[dict]:
    told = [t for message in messages for t in many.take(message)]
    return [json.loads(t.message.text) for t in told if t.shown]


def place(t: float) -> tuple[float, float, float]:
    return 0.8 * t, 3.0, 25.0


def is_where_it_is(event: dict) -> bool:
    x, y, _ = place(event["timestamp"] - BEGIN_NS * 1e-9)
    return abs(event["x"] - x) < 6 and abs(event["y"] - y) < 6


LIES = {
    "nothing": lambda t: None,
    "once, an hour ahead": lambda t: row(1, t + 3600, place(t)) if t == 10 else None,
    "once, years ahead": lambda t: row(1, t + 9e8, place(t)) if t == 10 else None,
    "a second ahead, far away": lambda t: row(1, t + 1, (500.0, 0.0, 25.0)) if t == 10 else None,
    "always far away": lambda t: row(1, t, (500.0, 0.0, 25.0)),
    "to and fro": lambda t: row(1, t, (500.0 * (round(t * 10) % 2), 0.0, 25.0)),
    "beyond all bounds": lambda t: row(1, t, (9e5, -9e5, 9e5), sigma_x=9e5),
    "sure of it, slowly away": lambda t: row(
        1, t, (0.8 * t + 3 * (t - 10), 3.0, 25.0), sigma_x=0.0, sigma_y=0.0, sigma_z=0.0
    ),
    "it has ended": lambda t: end(1, t) if t == 10 else None,
    "it is no drone": lambda t: row(1, t, place(t), drone=0.0),
    "hours behind": lambda t: row(1, t - 7200, place(t)),
    "a crowd around it": lambda t: row(2 + round(t * 10), t, place(t)),
}


@pytest.mark.parametrize("lie", LIES)
def test_who_lies_hides_no_drone_of_another(lie, tmp_path) -> None:
    """Both saw it for ten seconds; then one of them lies for ten more."""
    site = load_site(write_site(tmp_path, [square(400, "apron")], station="town"))
    many = Many(site, load_zones(site), "broker")
    told = []
    for step in range(200):
        t = step / 10
        lied = row(1, t, place(t), drone=0.9) if t < 10 else LIES[lie](t)
        seen = [] if lied is None else shown(many, published("liar", lied))
        seen += shown(many, published("honest", row(1, t, place(t), drone=0.9)))
        told += [(t, event) for event in seen]
    rows = [(t, e) for t, e in told if t > 10 and e["event"] == "row"]
    near = {t: e.get("drone") for t, e in rows if is_where_it_is(e)}
    assert len(near) >= 90
    assert set(near.values()) <= {0.9, None}  # a station may tell no probability
    raised = [e["track"] for _, e in told if e["event"] == "alarm" and e["state"] == "raised"]
    over = [e["track"] for _, e in told if e["event"] == "alarm" and e["state"] == "ended"]
    assert set(raised) - set(over)


def test_a_topic_identifies_the_sender_whatever_the_text_says() -> None:
    many = Many(Site(), (), "broker")
    text = f'{sensor("mid360", "silent")[:-1]},"station":"north"}}'.encode()
    (told,) = many.take(Published("evil", text, gone=False, retained=False))
    assert told.message.station == "evil"
    assert json.loads(told.message.text)["station"] == "evil"


def test_the_place_of_a_station_is_what_its_own_topic_says(tmp_path) -> None:
    many = Many(load_site(write_site(tmp_path)), (), "broker")
    moved = {"event": "site", "station": "north", "origin": ORIGIN | {"latitude_deg": 10.0}}
    shown(many, Published("north", json.dumps(moved | {"origin": ORIGIN}).encode(), False, True))
    shown(many, Published("evil", json.dumps(moved).encode(), False, True))
    line = row(1, 0.0, latitude_deg=47.0, longitude_deg=8.0, height_m=520.0)
    (told,) = [e for e in shown(many, published("north", line)) if e["event"] == "row"]
    assert [round(told[key], 3) for key in "xyz"] == [0.0, 0.0, 20.0]


@pytest.mark.parametrize("line", [row(1, 0.0), sensor("mid360", "ok"), track(1), "nonsense"])
def test_invented_stations_lock_none_out_and_end_no_track(line) -> None:
    many = Many(Site(), (), "broker")
    shown(many, published("first", row(1, 0.0)), published("first", row(1, 0.1)))
    for i in range(300):
        name = f"x{i}"
        many.take(Published(name, line.encode(), gone=False, retained=False))
    seen = shown(many, published("first", row(1, 0.2)))
    assert [e["event"] for e in seen] == ["row"]
    seen = [e for t in range(10) for e in shown(many, published("late", row(5, t, (90, 90, 30))))]
    assert sum(e["event"] == "row" for e in seen) == 10
    assert len(many._stations) <= 64


def test_a_station_that_vanishes_without_a_will_is_gone_after_a_minute(tmp_path) -> None:
    """By the stamps of the others, as in a recording; its drone and its alarm with it."""
    site = load_site(write_site(tmp_path, [square(50, "apron")], station="town"))
    many = Many(site, load_zones(site), "broker")
    for t in range(50):
        shown(many, published("north", row(1, t / 10)))
    before = [shown(many, published("south", sensor("avia", "ok", t))) for t in range(5, 60)]
    assert all(len(told) == 1 for told in before)
    after = shown(many, *(published("south", sensor("avia", "ok", t)) for t in range(60, 80)))
    assert [(e["event"], e.get("state")) for e in after if e["event"] != "sensor"] == [
        ("end", None),
        ("alarm", "ended"),
    ]


def test_a_live_station_ages_by_this_computers_clock_and_by_no_other_station(tmp_path) -> None:
    now = time.time() - BEGIN_NS * 1e-9
    site = load_site(write_site(tmp_path, [square(50, "apron")], station="town"))
    many = Many(site, load_zones(site), "broker")
    for t in range(50):
        shown(many, published("north", row(1, now + t / 10 - 5)))
    for t in range(4000):  # of yesterday, and fast
        assert not [
            e for e in shown(many, published("south", sensor("a", "ok", now - 86400 + t)))
            if e["event"] != "sensor"
        ]  # fmt: skip
    clocks = [many._clock, *(k.station._clock for k in many._stations.values())]
    for clock in clocks:
        clock._machine_s = lambda: time.monotonic() + SILENT_S + 1
    told = [json.loads(t.message.text) for t in many.take(b"") if t.shown]  # nothing has come
    assert [e["event"] for e in told] == ["end", "alarm"]


def test_a_track_of_which_nothing_is_heard_ends_by_age(tmp_path) -> None:
    site = load_site(write_site(tmp_path, [square(50, "apron")]))
    station = Station(site, load_zones(site))
    for t in range(30):
        station.take(row(1, t / 10))
    far = (200.0, 0.0, 20.0)
    ended = [m for t in range(90) for m in station.take(row(2, 3 + t, far)) if m.kind != "row"]
    assert [(m.kind, json.loads(m.text)["track"]) for m in ended[:2]] == [("end", 1), ("alarm", 1)]
    assert station.take(row(1, 95))  # seen again


def test_an_end_is_reported_though_the_next_event_is_refused(tmp_path) -> None:
    site = load_site(write_site(tmp_path, [square(50, "apron")]))
    for taken in (Station(site, load_zones(site)).take, of_one(Many(site, load_zones(site), "b"))):
        for t in range(30):
            taken(row(1, t / 10))
        for i in range(64):
            taken(sensor(f"s{i}", "ok", 3 + 0.9 * i))
        told = [json.loads(m.text)["event"] for m in taken(sensor("s64", "ok", 66))]
        told += [json.loads(m.text)["event"] for m in taken("nonsense")]
        assert sorted(set(told)) == ["alarm", "end"]


def of_one(many: Many) -> Callable[[str], list[Message]]:
    def take(line: str) -> list[Message]:
        told = many.take(Published("north", line.encode(), gone=False, retained=False))
        return [t.message for t in told]

    return take


def test_a_place_that_is_none_changes_no_place_that_is_known(tmp_path) -> None:
    many = Many(load_site(write_site(tmp_path)), (), "broker")
    place = {"event": "site", "origin": ORIGIN}
    for told in (place, place | {"origin": ORIGIN | {"latitude_deg": 100.0}}):
        shown(many, Published("north", json.dumps(told).encode(), False, True))
    assert many.bad.count == 1
    line = row(1, 0.0, latitude_deg=47.0, longitude_deg=8.0, height_m=520.0)
    (event,) = [e for e in shown(many, published("north", line)) if e["event"] == "row"]
    assert [round(event[key], 3) for key in "xyz"] == [0.0, 0.0, 20.0]


@pytest.mark.parametrize("liars", ["one name", "many names"])
def test_no_flood_of_places_takes_the_place_of_a_station_that_is_heard(
    liars, tmp_path, monkeypatch
) -> None:
    monkeypatch.setattr("unlidar.events.many._MOST_PLACES", 64)
    many = Many(load_site(write_site(tmp_path)), (), "broker")
    north = {"event": "site", "instance": "aaaa", "origin": ORIGIN}
    shown(many, Published("north", json.dumps(north).encode(), False, False))
    globe = {"latitude_deg": 47.0, "longitude_deg": 8.0, "height_m": 520.0}
    shown(many, published("north", row(1, 0.0, **globe), "aaaa"))
    for i in range(1100):
        lie = north | {"instance": f"i{i}", "origin": ORIGIN | {"latitude_deg": 10.0}}
        name = "liar" if liars == "one name" else f"liar{i}"
        shown(many, Published(name, json.dumps(lie).encode(), False, False))
    line = published("north", row(1, 0.1, **globe), "aaaa")
    (event,) = [e for e in shown(many, line) if e["event"] == "row"]
    assert [round(event[key], 3) for key in "xyz"] == [0.0, 0.0, 20.0]
    assert sum(map(len, many._places.values())) < 600


def two_relays(many: Many, begin: int, until: int) -> list[dict]:
    seen = []
    for step in range(begin, until):
        for relay, x in (("aaaa", 0.0), ("bbbb", 150.0)):
            line = row(1, step / 10, (x, 0.0, 30.0))
            seen += shown(many, published("station", line, relay))
    return [e for e in seen if e["event"] == "row"]


def test_two_relays_of_one_name_are_said_and_neither_hides_or_ends_the_other(caplog) -> None:
    many = Many(Site(), (), "broker")
    shown(many, published("station", sensor("mid360", "ok"), "gone", retained=True))
    rows = two_relays(many, 0, 20)
    assert {e["x"] for e in rows} == {0.0, 150.0}
    assert len({e["track"] for e in rows}) == 2
    assert any("two relays have one name" in said for said in caplog.messages)
    assert shown(many, gone("station")) == []
    again = two_relays(many, 20, 40)
    assert {e["track"] for e in again} == {e["track"] for e in rows}


def test_a_relay_that_is_started_again_takes_its_name_again(caplog) -> None:
    many = Many(Site(), (), "broker")
    shown(many, published("north", row(1, 0.0), "aaaa"))
    assert [e["event"] for e in shown(many, gone("north"))] == ["end"]
    shown(many, published("north", row(1, 1.0), "bbbb"))
    assert list(many._stations) == ["north"]
    assert caplog.messages == []


def test_two_old_relays_of_one_name_are_known_by_a_track_that_jumps(caplog) -> None:
    many = Many(Site(), (), "broker")
    for step in range(10):
        for x in (0.0, 150.0):
            shown(many, published("station", row(1, step / 10 + x / 3000, (x, 0.0, 30.0))))
    assert any("two relays have one name" in said for said in caplog.messages)


def test_a_newcomer_stays_though_ever_new_names_tell_of_tracks_and_places() -> None:
    common = {"latitude_deg": 47.0, "longitude_deg": 8.0, "height_m": 500.0}
    many = Many(Site(origin=Place(**common)), (), "broker")
    own = common | {"latitude_deg": 47.01, "heading_deg": 90.0}
    shown(
        many, Published("north", json.dumps({"event": "site", "origin": own}).encode(), False, True)
    )
    told = []
    for step in range(40):
        for i in range(80):
            name = f"invented{step}_{i}"
            site = {"event": "site", "origin": common | {"heading_deg": 0.0}}
            lie = row(1, step / 10, (100.0 * i, 5000.0, 30.0))
            told += shown(many, Published(name, json.dumps(site).encode(), False, False))
            told += shown(many, published(name, lie))
        place = {"latitude_deg": 47.01, "longitude_deg": 8.0, "height_m": 520.0}
        told += shown(many, published("north", row(7, step / 10, (0.0, 0.0, 20.0), **place)))
    ours = [e for e in told if e["event"] == "row" and e["z"] == pytest.approx(20, abs=0.5)]
    assert len(ours) >= 25
    assert len({e["track"] for e in ours[2:]}) == 1  # from its second word on
    assert all(e["y"] == pytest.approx(1111.8, abs=1.0) for e in ours)  # where it truly is
