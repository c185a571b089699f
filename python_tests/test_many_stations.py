"""Several stations as one sky: by themselves, and with a broker and relays between."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pymap3d
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from live_program import wait_until
from station_events import ORIGIN, end, row, sensor, square, state, track, write_site
from test_relay import Broker, Relay
from test_watch import Watch, events
from unlidar.events.many import SKY, Many, Told
from unlidar.events.site import Place, Site, load_site, load_zones
from unlidar.events.station import Station

COMMON = ORIGIN["latitude_deg"], ORIGIN["longitude_deg"], ORIGIN["height_m"]
SIGMA_M = np.array([0.05, 0.07, 0.09])


class Box:
    """A station some way off, turned by its heading, with noise and a number of its own."""

    def __init__(self, name: str, east_m: float, north_m: float, heading_deg: float, seed: int):
        lat, lon, height = pymap3d.enu2geodetic(east_m, north_m, 5.0, *COMMON)
        self.name = name
        self.place = Place(
            latitude_deg=float(lat), longitude_deg=float(lon), height_m=float(height),
            heading_deg=heading_deg,
        )  # fmt: skip
        self.site = Site(station=name, origin=self.place)
        self._random = np.random.default_rng(seed)
        a = math.radians(90.0 - heading_deg)
        turn = [[math.cos(a), math.sin(a), 0], [-math.sin(a), math.cos(a), 0], [0, 0, 1]]
        self._to_own = np.array(turn)

    def row(self, number: int, t: float, course: int = 0) -> str:
        """The engine's row of a drone, in the station's own frame."""
        enu, velocity = drone(t, course)
        spot = pymap3d.enu2geodetic(*enu, *COMMON)
        place = self.place.latitude_deg, self.place.longitude_deg, self.place.height_m
        own = self._to_own @ np.array(pymap3d.geodetic2enu(*spot, *place))
        own = own + self._random.normal(size=3) * SIGMA_M
        return row(number, t, tuple(own.tolist()), tuple((self._to_own @ velocity).tolist()))

    def site_line(self) -> bytes:
        told = {"event": "site", "station": self.name, "origin": asdict(self.place)}
        return json.dumps(told).encode()


def drone(t: float, course: int) -> tuple[np.ndarray, np.ndarray]:
    """East, north, up of the common frame, and velocity."""
    a, radius = 0.3 * t + 3 * course, 20.0
    position = np.array([radius * math.cos(a), radius * math.sin(a), 30.0 + 10 * course])
    return position, 0.3 * radius * np.array([-math.sin(a), math.cos(a), 0.0])


def boxes() -> list[Box]:
    return [
        Box("alpha", 0, 0, 90, 1),
        Box("bravo", 120, 40, 10, 2),
        Box("charlie", -60, 150, 222, 3),
    ]


class Stations:
    """Boxes whose relays hand straight over to the common sky."""

    def __init__(self, folder: Path) -> None:
        site = load_site(write_site(folder, [square(40, "apron")], station="town"))
        self.many = Many(site, load_zones(site), "broker")
        self.boxes = {box.name: box for box in boxes()}
        self.relays = {name: Station(box.site) for name, box in self.boxes.items()}
        for box in self.boxes.values():
            self.many.take(box.site_line())

    def say(self, name: str, line: str) -> list[Told]:
        told = self.relays[name].take(line)
        return [t for message in told for t in self.many.take(message.text.encode())]

    def fly(self, begin: float, until: float, who: dict[str, int], course: int = 0) -> list[dict]:
        """Messages to pages while stations see the drone under these numbers."""
        shown = []
        for step in range(round(begin * 10), round(until * 10)):
            for name, number in who.items():
                shown += self.say(name, self.boxes[name].row(number, step / 10, course))
        return [json.loads(t.message.text) for t in shown if t.shown]


def rows(told: list[dict]) -> list[dict]:
    return [e for e in told if e["event"] == "row"]


def test_a_drone_of_three_stations_is_one_where_it_truly_is(tmp_path) -> None:
    sky = Stations(tmp_path)
    told = sky.fly(0, 6, {"alpha": 3, "bravo": 1, "charlie": 9})
    assert {e["station"] for e in rows(told)} == {SKY}
    (identity,) = {e["track"] for e in rows(told)}  # from its first row on
    for event in rows(told)[10:]:
        t = event["timestamp"] - rows(told)[0]["timestamp"]
        truth, velocity = drone(t, 0)
        assert np.linalg.norm(np.array([event[k] for k in "xyz"]) - truth) < 0.5
        assert np.allclose([event[f"v{k}"] for k in "xyz"], velocity, atol=0.1)
    assert not any(e["event"] == "end" for e in told)
    # One alarm for the one drone goes on.
    alarms = [(e["state"], e["track"]) for e in told if e["event"] == "alarm"]
    assert alarms == [("raised", identity)]


def test_rows_are_not_more_than_a_station_would_send(tmp_path) -> None:
    sky = Stations(tmp_path)
    sky.fly(0, 3, dict.fromkeys(sky.boxes, 1))
    stamps = [e["timestamp"] for e in rows(sky.fly(3, 6, dict.fromkeys(sky.boxes, 1)))]
    assert len(stamps) == 30
    assert (np.diff(stamps) > 0.04).all()


def test_a_station_that_is_gone_takes_no_drone_along(tmp_path) -> None:
    sky = Stations(tmp_path)
    told = sky.fly(0, 4, {"alpha": 1, "bravo": 1})
    identity = rows(told)[-1]["track"]
    gone = sky.many.take(b'{"event":"gone","station":"alpha"}')
    assert [t.message.event.event for t in gone] == ["end"]
    assert not gone[0].shown
    told = sky.fly(4, 6, {"bravo": 1})
    assert {e["track"] for e in rows(told)} == {identity}
    told = sky.fly(6, 9, {"bravo": 1, "alpha": 2})
    assert rows(told)[-1]["track"] == identity
    shown = [json.loads(t.message.text) for t in sky.say("bravo", end(1, 9)) if t.shown]
    assert shown == []
    shown = [json.loads(t.message.text) for t in sky.say("alpha", end(2, 9)) if t.shown]
    assert [(e["event"], e["track"]) for e in shown] == [("end", identity), ("alarm", identity)]


@given(st.lists(st.tuples(st.sampled_from(("alpha", "bravo", "charlie")), st.integers(1, 15))))
@example([("alpha", 1), ("bravo", 2), ("charlie", 7)])
@settings(max_examples=40)
def test_a_drone_is_one_however_late_a_station_is_heard(tmp_path_factory, turns) -> None:
    sky = Stations(tmp_path_factory.mktemp("sky"))
    heard = dict.fromkeys(sky.boxes, 0)
    shown: list[Told] = []
    everything = [(name, 1) for _ in range(30) for name in sky.boxes]
    for name, count in turns + everything:
        for _ in range(min(count, 30 - heard[name])):
            if min(heard.values()) == 15 and heard["alpha"] < 30:
                shown += sky.many.take(b'{"event":"gone","station":"alpha"}')
                heard["alpha"] = 30
                break
            shown += sky.say(name, sky.boxes[name].row(1, heard[name] / 10))
            heard[name] += 1
    told = [json.loads(t.message.text) for t in shown if t.shown]
    assert {e["track"] for e in rows(told)} == {1}


def test_two_drones_are_two(tmp_path) -> None:
    sky = Stations(tmp_path)
    for second in range(6):
        sky.fly(second, second + 1, {"alpha": 1, "bravo": 2}, course=0)
        sky.fly(second, second + 1, {"alpha": 2, "bravo": 1}, course=1)
    told = [
        *sky.fly(6, 7, {"alpha": 1, "bravo": 2}, course=0),
        *sky.fly(6, 7, {"alpha": 2, "bravo": 1}, course=1),
    ]
    heights = {}
    for event in rows(told):
        heights.setdefault(event["track"], set()).add(round(event["z"] / 10))
    assert sorted(heights.values(), key=min) == [{3}, {4}]


def test_states_of_each_station_are_shown_and_its_own_rows_only_kept(tmp_path) -> None:
    sky = Stations(tmp_path)
    told = sky.say("alpha", sensor("mid360", "ok")) + sky.say("bravo", state("running"))
    assert [(t.message.station, t.shown) for t in told] == [("alpha", True), ("bravo", True)]
    told = sky.say("alpha", track(1)) + sky.say("alpha", sky.boxes["alpha"].row(1, 0))
    assert [(t.message.station, t.shown) for t in told] == [
        ("alpha", False),
        ("alpha", False),
        (SKY, True),
        (SKY, True),
    ]


@pytest.mark.parametrize(
    "line",
    [
        b"[]", b"{}", b'{"station":"a b","event":"row"}', b'{"station":"sky","event":"row"}',
        b'{"station":"a","event":"site","origin":3}',
        b'{"station":"a","event":"site","origin":{"x":1}}',
        b'{"station":"a","event":"row","latitude_deg":"x"}', b"[" * 9999, b"\xff",
    ],
)  # fmt: skip
def test_what_is_no_message_is_counted_and_left_out(line, tmp_path) -> None:
    sky = Stations(tmp_path)
    assert sky.many.take(line) == []
    assert sky.many.bad.count + sum(k.station.bad.count for k in sky.many._stations.values()) == 1


@given(st.binary(max_size=200))
def test_no_bytes_break_it(data) -> None:
    many = Many(Site(origin=Place(**ORIGIN)), (), "broker")
    assert many.take(data) == []


def test_three_stations_by_a_broker_one_killed_and_started_again(tmp_path) -> None:
    own = boxes()
    folders = {}
    for box in own:
        folders[box.name] = tmp_path / box.name
        folders[box.name].mkdir()
        write_site(folders[box.name], station=box.name, origin=asdict(box.place))
    (tmp_path / "town").mkdir()
    town = write_site(tmp_path / "town", [square(40, "apron")], station="town")

    def relay(box: Box, broker: Broker) -> Relay:
        url = f"mqtt://127.0.0.1:{broker.port}"
        return Relay("-", "--site", folders[box.name] / "site.yaml", "--to", url, stdin=True)

    def fly(relays: dict[Box, tuple[Relay, int]], begin: float, until: float) -> None:
        for step in range(round(begin * 10), round(until * 10)):
            for box, (told, number) in relays.items():
                told.feed(box.row(number, step / 10))
            if step % 5 == 4:
                wait_until(lambda: seen() >= step / 10 - 0.01, f"{step / 10} s is shown")  # noqa: B023

    with (
        Broker(tmp_path) as broker,
        Watch(f"mqtt://127.0.0.1:{broker.port}", "--site", town) as watch,
        watch.live() as got,
        relay(own[0], broker) as one,
        relay(own[1], broker) as two,
        relay(own[2], broker) as three,
    ):
        first = float(json.loads(own[0].row(1, 0.0))["timestamp"])

        def seen() -> float:
            return max((e["timestamp"] - first for e in rows(events(got))), default=-1.0)

        def names(since: float) -> set[int]:
            return {e["track"] for e in rows(events(got)) if e["timestamp"] - first > since}

        def ready(box: Box, told: Relay) -> None:
            before = len(events(got))
            told.feed(sensor("mid360", "ok"))
            wait_until(
                lambda: any(
                    e["event"] == "sensor" and e["station"] == box.name
                    for e in events(got)[before:]
                ),
                f"{box.name} is heard",
            )

        wait_until(lambda: len(got) >= 2, "the page is there")
        for box, told in zip(own, (one, two, three), strict=True):
            ready(box, told)
        fly({own[0]: (one, 1), own[1]: (two, 5), own[2]: (three, 2)}, 0, 4)
        (identity,) = names(3)
        one.process.kill()  # its last will says so
        fly({own[1]: (two, 5), own[2]: (three, 2)}, 4, 6)
        with relay(own[0], broker) as again:
            ready(own[0], again)
            fly({own[0]: (again, 8), own[1]: (two, 5), own[2]: (three, 2)}, 6, 9)
            assert names(0) == {identity}
        # The past shows drones, not what each station said of them.
        spans = json.loads(watch.ask("/spans")[2])["spans"]
        assert {name for name, *_ in spans} == {SKY}
        told = json.loads(watch.ask(f"/history?since={first}&until={first + 9}")[2])
        assert {t["station"] for t in told["tracks"]} == {SKY}
        alarms = [e for e in events(got) if e["event"] == "alarm"]
        assert [(e["state"], e["track"]) for e in alarms] == [("raised", identity)]
