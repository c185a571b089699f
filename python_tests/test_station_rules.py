"""Events of a station taken in: exact stamps, places on the globe, zones and alarms."""

from __future__ import annotations

import json
import math

import numpy as np
import pymap3d
import pytest
from hypothesis import given
from hypothesis import strategies as st
from station_events import (
    BEGIN_NS,
    ORIGIN,
    end,
    row,
    sensor,
    square,
    stamp,
    state,
    track,
    write_site,
)
from unlidar.errors import ConfigError
from unlidar.events.event import MOST_BYTES, Row, decode
from unlidar.events.site import load_site, load_zones
from unlidar.events.source import Lines
from unlidar.events.station import Station


def station(tmp_path, features=(), **more) -> Station:
    site = load_site(write_site(tmp_path, list(features), **more))
    return Station(site, load_zones(site))


def told(station: Station, *lines: str) -> list[dict]:
    return [json.loads(m.text) for line in lines for m in station.take(line)]


def alarms(station: Station, *lines: str) -> list[tuple]:
    return [
        (e["state"], e["track"], e["zone"]) for e in told(station, *lines) if e["event"] == "alarm"
    ]


def test_stamps_keep_every_nanosecond() -> None:
    event, text = decode(row(7, 1.5))
    assert isinstance(event, Row)
    assert event.timestamp == BEGIN_NS + 1_500_000_000
    assert text == row(7, 1.5)


def test_what_is_sent_on_is_the_event_with_station_and_place(tmp_path) -> None:
    line = row(7, 1.5, (30.0, -40.0, 25.0))
    (message,) = station(tmp_path, [square(1)]).take(line)
    assert message.text.startswith(line[:-1])  # every digit
    sent = json.loads(message.text)
    assert sent["station"] == "north"
    place = [ORIGIN[key] for key in ("latitude_deg", "longitude_deg", "height_m")]
    expected = pymap3d.enu2geodetic(30.0, -40.0, 25.0, *place)
    found = sent["latitude_deg"], sent["longitude_deg"], sent["height_m"]
    assert np.allclose(found[:2], expected[:2], atol=1e-8)
    assert found[2] == pytest.approx(expected[2], abs=1e-3)


def test_a_heading_turns_the_places(tmp_path) -> None:
    """With x to the north, what lies ahead is north of the station."""
    place = ORIGIN | {"heading_deg": 0.0}
    (ahead,) = told(station(tmp_path, [square(1)], origin=place), row(1, 0, (100.0, 0.0, 0.0)))
    assert ahead["latitude_deg"] > ORIGIN["latitude_deg"] + 5e-4
    assert ahead["longitude_deg"] == pytest.approx(ORIGIN["longitude_deg"], abs=1e-7)


@pytest.mark.parametrize(
    "line",
    [
        " ",
        "no json",
        "[1]",
        "{}",
        '{"event":"row","at":1}',
        row(1, 0).replace("0.05", "NaN"),
        row(1, 0).replace("0.05", "-1"),
        row(1, 0).replace('"track":1', '"track":-1'),
        '{"event":"new_kind","at":1.0}',
        "[" * 100_000,
        '{"event":"' + "x" * MOST_BYTES + '"}',
    ],
)
def test_what_is_no_event_is_counted_and_left_out(line, tmp_path, caplog) -> None:
    taking = station(tmp_path, [square(1)])
    assert taking.take(line.encode()) == []
    assert taking.bad.count == 1
    assert len(caplog.messages) == 1
    assert len(caplog.messages[0]) < 400
    assert len(taking.take(row(1, 0))) == 1


@given(st.lists(st.integers(1, 40), max_size=30), st.binary(max_size=300))
def test_lines_are_cut_alike_however_the_bytes_come(sizes, data) -> None:
    whole = Lines().take(data)
    cut, found = Lines(), []
    for size in sizes:
        found += cut.take(data[:size])
        data = data[size:]
    assert found + cut.take(data) == whole


def test_an_endless_line_is_refused_once_and_not_kept() -> None:
    cut = Lines()
    refused = [line for _ in range(100) for line in cut.take(b"x" * 10_000)]
    assert [len(line) for line in refused] == [MOST_BYTES + 1]
    assert cut.take(b"rest\nnext\n") == [b"next"]


def test_an_alarm_is_raised_when_a_track_has_stayed_and_ends_with_it(tmp_path) -> None:
    watched = station(tmp_path, [square(50, "apron")])
    rows = [row(3, t / 10) for t in range(0, 60)]
    assert alarms(watched, track(3), *rows[:20]) == []
    assert alarms(watched, rows[20]) == [("raised", 3, "apron")]
    # Once, also when it leaves and comes back.
    away = [row(3, 6 + t / 10, (90.0, 0.0, 20.0)) for t in range(10)]
    back = [row(3, 7 + t / 10) for t in range(40)]
    assert alarms(watched, *rows[21:], *away, *back) == []
    assert alarms(watched, end(3, 12)) == [("ended", 3, "apron")]
    assert alarms(watched, end(3, 12)) == []


@pytest.mark.parametrize(("every", "raised"), [(3, 0), (4, 0), (12, 1), (38, 1)])
def test_noise_at_an_edge_hides_no_dwell_and_passing_by_is_none(every, raised, tmp_path) -> None:
    """One row in so many is outside."""
    watched = station(tmp_path, [square(50)])
    inside, outside = (0.0, 0.0, 20.0), (60.0, 0.0, 20.0)
    course = [row(1, t / 20, outside if t % every == 0 else inside) for t in range(300)]
    assert len(alarms(watched, *course)) == raised


def test_a_zone_that_was_left_is_entered_anew(tmp_path) -> None:
    watched = station(tmp_path, [square(50)])
    course = [row(1, t / 10) for t in range(15)]
    course += [row(1, 1.5 + t / 10, (90.0, 0.0, 20.0)) for t in range(20)]
    assert alarms(watched, *course, *[row(1, 3.5 + t / 10) for t in range(20)]) == []
    assert len(alarms(watched, row(1, 5.5))) == 1


def test_rows_before_the_confirmation_count_with_their_own_times(tmp_path) -> None:
    watched = station(tmp_path, [square(50, "apron")])
    late = [row(1, t / 10, late=True) for t in range(25)]
    events = told(watched, track(1, 3.0), *late)
    raised = [e for e in events if e["event"] == "alarm"]
    assert len(raised) == 1
    text = watched_text(tmp_path, late)
    assert f'"since":{stamp(0)}' in text
    assert f'"raised":{stamp(2.0)}' in text


def watched_text(tmp_path, lines) -> str:
    watched = station(tmp_path, [square(50, "apron")])
    return "".join(m.text for line in lines for m in watched.take(line) if m.kind == "alarm")


def test_heights_bound_a_zone(tmp_path) -> None:
    feature = square(50, "low", min_height_m=0, max_height_m=30)
    for height, expected in ((20.0, 1), (31.0, 0), (-1.0, 0)):
        watched = station(tmp_path, [feature])
        course = [row(1, t / 10, (0.0, 0.0, height)) for t in range(30)]
        assert len(alarms(watched, *course)) == expected, height


def test_each_zone_raises_its_own_alarm(tmp_path) -> None:
    watched = station(tmp_path, [square(50, "wide"), square(10, "core")])
    course = [row(1, t / 10, (30.0, 0.0, 20.0)) for t in range(60)]
    assert alarms(watched, *course) == [("raised", 1, "wide")]
    course = [row(1, 6 + t / 10) for t in range(30)]
    assert alarms(watched, *course) == [("raised", 1, "core")]
    assert sorted(alarms(watched, end(1, 20))) == [("ended", 1, "core"), ("ended", 1, "wide")]


def test_the_kind_of_a_track_decides_only_where_a_rule_asks(tmp_path) -> None:
    def raised(*lines: str, **rule: float) -> int:
        rules = [{"zones": "zones.geojson", **rule}]
        return len(alarms(station(tmp_path, [square(50)], rules=rules), *lines))

    course = [row(1, t / 10) for t in range(30)]
    assert raised(track(1, drone=0.0), *course) == 1
    assert raised(track(1, drone=0.05), *course, min_probability=0.1) == 0
    assert raised(track(1, drone=0.2), *course, min_probability=0.1) == 1
    later = [*[row(1, t / 10, drone=0.05) for t in range(30)], row(1, 3, drone=0.9)]
    assert raised(*later, min_probability=0.1) == 1
    assert raised(track(1), *course, min_probability=0.1) == 1  # none told: a track counts as 1


def test_an_engine_that_begins_anew_ends_tracks_and_alarms_of_before(tmp_path) -> None:
    watched = station(tmp_path, [square(50, "apron")])
    told(watched, track(1), *[row(1, t / 10) for t in range(30)], track(2), row(2, 3.0))
    events = told(watched, state("warming_up", 10.0))
    assert [(e["event"], e.get("track")) for e in events] == [
        ("end", 1),
        ("end", 2),
        ("alarm", 1),
        ("state", None),
    ]
    assert told(watched, state("running", 11.0), sensor("mid360", "ok"))[0]["event"] == "state"


@given(
    st.floats(-170, 170), st.floats(-70, 70), st.floats(0, 360), st.floats(0, 2 * math.pi),
    st.floats(0, 300),
)  # fmt: skip
def test_a_zone_lies_where_its_places_are(lon, lat, heading, angle, distance) -> None:
    """A square about a place that is so far away, in this direction, holds that place alone."""
    from unlidar.events.site import Place, Rule, _zone
    from unlidar.geodesy import to_geodetic

    place = Place(latitude_deg=lat, longitude_deg=lon, height_m=100.0, heading_deg=heading)
    centre = np.array([distance * math.cos(angle), distance * math.sin(angle), 0.0])
    offsets = np.array([[-5, -5], [5, -5], [5, 5], [-5, 5], [-5, -5]], dtype=float)
    corners = to_geodetic(place.origin(), np.column_stack([centre[:2] + offsets, np.zeros(5)]))
    ring = corners[:, 1::-1].tolist()
    geometry = {"type": "Polygon", "coordinates": [ring]}
    zone = _zone({"geometry": geometry}, 0, __import__("pathlib").Path("z"), Rule(zones="z"), place)
    assert zone.holds(*centre)
    for dx, dy in ((5.5, 0), (-5.5, 0), (0, 5.5), (0, -5.5)):
        assert not zone.holds(centre[0] + dx, centre[1] + dy, 0.0)


@pytest.mark.parametrize(
    ("site", "said"),
    [
        ({"station": "a b"}, "station: 'a b', expected a name"),
        ({"station": 3}, "station: '3', expected a text"),
        ({"stattion": "a"}, "unknown key 'stattion'"),
        ({"origin": {"latitude_deg": 91.0, "longitude_deg": 0.0, "height_m": 0.0}}, "up to 90"),
        ({"origin": {"latitude_deg": 1.0}}, "key 'longitude_deg' is missing"),
        ({"origin": None, "rules": [{"zones": "x"}]}, "need 'origin'"),
        ({"rules": [{"zones": "x", "min_probability": 2}]}, "up to 1"),
        ({"outputs": [{"to": "x", "room": 1}]}, "from 10 on"),
    ],
)
def test_a_wrong_site_is_one_line_that_names_the_key(site, said, tmp_path) -> None:
    with pytest.raises(ConfigError) as refused:
        load_site(write_site(tmp_path, **site))
    assert said in str(refused.value)
    assert str(tmp_path / "site.yaml") in str(refused.value)
    assert "\n" not in str(refused.value)


def ring(positions: str) -> str:
    geometry = f'{{"type":"Polygon","coordinates":[[{positions}]]}}'
    return f'{{"type":"Feature","geometry":{geometry}}}'


@pytest.mark.parametrize(
    ("zones", "said"),
    [
        ("no json", "cannot be read as GeoJSON"),
        ("[]", "expected a GeoJSON FeatureCollection"),
        ('{"type":"FeatureCollection","features":[]}', "holds no feature"),
        ('{"type":"FeatureCollection","features":[3]}', "features[0]"),
        ('{"type":"Feature","geometry":{"type":"Point","coordinates":[8,47]}}', "'Point'"),
        (json.dumps(square(5, min_height_m=9, max_height_m=3)), "not below max_height_m"),
        (json.dumps(square(5, max_height_m="high")), "max_height_m: 'high'"),
        (json.dumps(square(5, name="")), "name: expected"),
        (json.dumps(square(1e9)), "longitude, latitude"),
        (ring("[8,47],[8.01,47.01],[8.01,47]"), "a ring is not closed"),
        (ring("[8,47],[8.01,47.01],[8,47]"), "a ring is not closed"),
        (ring("[NaN,47],[8,47],[8,48],[NaN,47]"), "NaN is no number"),
        (ring("[1e999,47],[8,47],[8,48],[1e999,47]"), "longitude, latitude"),
        (ring(f"[{'9' * 400},47],[8,47],[8,48],[8,47]"), "features[0]"),
        (ring('["8","47"],["8","48"],["9","48"],["8","47"]'), "expected numbers"),
        (ring("[true,47],[8,48],[9,48],[true,47]"), "expected numbers"),
        (ring("[8],[8],[9],[8]"), "expected numbers"),
        (ring("8,47,9,48"), "expected numbers"),
        (ring("[8,47],[8.01,47.01],[8.01,47],[8,47.01],[8,47]"), "Self-intersection"),
        (ring("[8,47],[8,47],[8,47],[8,47]"), "features[0]"),
        (ring("[47,8],[47.01,8],[47.01,8.01],[47,8]"), "longitude comes before latitude"),
        (ring("[356750,222950],[356760,222950],[356760,222960],[356750,222950]"), "longitude"),
        (ring(""), "geometry is empty"),
        ('{"type":"Feature","geometry":{"type":"Polygon","coordinates":[]}}', "is empty"),
        ('{"type":"Feature","geometry":{"type":"Polygon"}}', "geometry is empty"),
        ('{"type":"Feature","geometry":{"type":"MultiPolygon","coordinates":[3]}}', "is empty"),
        ('{"type":"Feature","geometry":null}', "'None'"),
        ('{"type":"Feature","geometry":[]}', "'None'"),
        (json.dumps(square(5) | {"properties": [1]}), "properties: expected"),
        (json.dumps(square(5, name="a\nb")), "that can be seen"),
        (json.dumps(square(5, name=["a"])), "that can be seen"),
        (json.dumps(square(5, min_height_m=10**400)), "min_height_m"),
        (json.dumps(square(5) | {"crs": {"properties": {"name": "EPSG:21781"}}}), "crs"),
        ("[" * 100_000, "cannot be read as GeoJSON"),
        ('{"type":"Feature","crs":' + "[" * 900 + "]" * 900 + "}", "crs"),
    ],
)
def test_a_wrong_zone_is_one_line_that_names_the_file(zones, said, tmp_path) -> None:
    site = load_site(write_site(tmp_path, [square(5)]))
    (tmp_path / "zones.geojson").write_text(zones)
    with pytest.raises(ConfigError) as refused:
        load_zones(site)
    assert said in str(refused.value)
    assert "zones.geojson" in str(refused.value)
    assert "\n" not in str(refused.value)
    assert len(str(refused.value).removeprefix(str(tmp_path))) < 250


def test_a_huge_file_is_not_read(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("unlidar.events.site._MOST_FILE_BYTES", 1000)
    site = load_site(write_site(tmp_path, [square(5)] * 50))
    with pytest.raises(ConfigError, match=r"is larger than 0\.001 MB"):
        load_zones(site)


def test_two_zones_need_two_names(tmp_path) -> None:
    site = load_site(write_site(tmp_path, [square(5, "a"), square(9, "a")]))
    with pytest.raises(ConfigError, match="two zones have the name 'a'"):
        load_zones(site)


@given(st.lists(st.tuples(*[st.integers(-6, 6)] * 2, st.integers(1, 5)), max_size=30))
def test_zones_are_found_as_if_each_were_asked(squares) -> None:
    from shapely import box
    from unlidar.events.site import Rule, Zone, Zones

    zones = [
        Zone(f"z{i}", Rule(zones="z"), box(x - r, y - r, x + r, y + r), -r, r)
        for i, (x, y, r) in enumerate(squares)
    ]
    index = Zones(zones)
    for x, y, z in ((0, 0, 0), (1, -2, 3), (-6, 6, 1), (2.5, 2.5, -2)):
        assert index.around(x, y, z) == [zone for zone in zones if zone.holds(x, y, z)]
