"""Any input bytes give one line of strict JSON, or nothing and a note."""

from __future__ import annotations

import json
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from station_events import (
    ORIGIN,
    end,
    now,
    returns,
    row,
    sensor,
    square,
    state,
    track,
    write_site,
)
from unlidar.events.event import MOST_BYTES, decode
from unlidar.events.many import Many
from unlidar.events.site import Place, Site, load_site, load_zones
from unlidar.events.station import MOST_TRACKS, Station

GOOD = [
    row(1, 0.0),
    row(2, 0.5, drone=0.4),
    now(1, 0.5),
    now(2, 0.5, unseen_s=3.5, drone=0.4, bird_like=0.1),
    track(1, 1.0, drone=0.5),
    end(1, 12.0),
    sensor("mid360", "ok"),
    state("running"),
    returns("mid360", 0.5, [[1.0, 2.0, 3.0], [-4.0, 0.0, 60.0]]),
]
LITERALS = st.sampled_from(
    [
        "NaN", "Infinity", "-Infinity", "1e999", "-1e999", "1e200", "-0", "0", "1", "1.5", "1e-400",
        "true", "false", "null", '""', '"1.5"', '"a\\nb"', '"\\ud800"', '"\\u2028"', "[]", "{}",
        "[" * 2000, '{"a":' * 2000, str(2**53), str(2**53 - 1), str(2**63), "9" * 400, "-1",
        "4000000000", "4000000001", '"' + "x" * 130 + '"', '"' + "x" * 100 + '"',
    ]
)  # fmt: skip
KEYS = st.sampled_from(
    [
        *(key for line in GOOD for key in json.loads(line)),
        *("station", "latitude_deg", "height_m", "more", "instance", "a b", "__proto__", ""),
    ]
)


@st.composite
def lines(draw: st.DrawFn) -> str:
    """An event with some of its values, or the space between them, as nobody would write them."""
    line = draw(st.sampled_from(GOOD))
    parts = {key: json.dumps(value) for key, value in json.loads(line).items()}
    parts |= {key: line.split(f'"{key}":')[1].split(",")[0].rstrip("}") for key in parts}
    for key, literal in draw(st.dictionaries(KEYS, LITERALS, max_size=3)).items():
        parts[key] = literal
    gap = draw(st.sampled_from(["", " ", "\n", "\r", "\t", "\x00"]))
    return "{" + f",{gap}".join(f'"{key}":{gap}{value}' for key, value in parts.items()) + "}"


def strict(text: str) -> dict:
    def refuse(name: str) -> None:
        raise AssertionError(f"{name} is no JSON")

    values = json.loads(text, parse_constant=refuse)
    assert text.isprintable()
    assert len(text.encode()) <= MOST_BYTES
    for value in values.values():
        assert not isinstance(value, list | dict)
        assert not isinstance(value, float) or math.isfinite(value)
    return values


@given(lines() | st.text(max_size=100) | st.binary(max_size=100))
@settings(max_examples=300)
def test_what_is_taken_is_strict_json_that_is_taken_again_as_it_is(line) -> None:
    try:
        event, text = decode(line)
    except ValueError as error:
        assert len(str(error)) <= 200
        return
    strict(text)
    assert decode(text) == (event, text)
    assert decode(text.encode()) == (event, text)


@pytest.mark.parametrize("line", GOOD)
def test_the_engines_digits_leave_as_they_came(line) -> None:
    assert decode(line)[1] == line
    assert decode(line.replace(",", " ,\n ").replace(":", " : "))[1] == line


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("x", '"1.0"'), ("x", "true"), ("x", "1e7"), ("x", "1e400"), ("x", "null"), ("vx", "1e5"),
        ("sigma_x", "1e200"), ("sigma_x", "-0.1"), ("support", '"9"'), ("late", "0"),
        ("late", '"false"'), ("track", str(2**53)), ("track", "1.0"), ("track", '"1"'),
        ("track", "-1"), ("at", '"1706301000.5"'), ("at", "4000000001"), ("at", "true"),
        ("timestamp", "1"), ("timestamp", "1806301000"), ("drone", "1.1"), ("drone", '"0.5"'),
        ("latitude_deg", "9" * 400), ("height_m", "1e8"), ("x", "0." + "1" * 60),
    ],
)  # fmt: skip
def test_a_value_out_of_its_bounds_is_refused_by_its_name(key, value) -> None:
    parts = {k: v if k == key else json.dumps(v) for k, v in json.loads(row(1, 0.0)).items()}
    parts |= dict.fromkeys(("at", "timestamp"), "1706301000.5") | {key: value}
    with pytest.raises(ValueError, match=f"^{key}: |event: .*{key}: "):
        decode("{" + ",".join(f'"{k}":{v}' for k, v in parts.items()) + "}")


@pytest.mark.parametrize("name", ["", "a\nb", "a\u2028b", "\ud800", "\u202eb", "x" * 121, 5, None])
def test_a_sensor_has_a_name_that_can_be_shown(name) -> None:
    with pytest.raises(ValueError, match="name: "):
        decode(json.dumps({"event": "sensor", "at": 1.5, "name": name, "state": "ok"}))


def test_what_a_later_engine_adds_is_passed_on_within_bounds() -> None:
    short = {"wind_mps": 3.5, "note": "gusty \u00e9", "ok": True, "none": None}
    long = {"points": [1, 2], "deep": {"a": 1}, "text": "x" * 500, "bad key": 1, "line": "a\nb"}
    many = {f"more{i}": "y" * 100 for i in range(100)}
    line = json.dumps(json.loads(sensor("mid360", "ok")) | short | long | many)
    told = strict(decode(line)[1])
    assert short.items() <= told.items()
    assert not set(long) & set(told)
    assert len(decode(line)[1]) < 6000


def test_a_key_that_is_there_twice_is_refused() -> None:
    with pytest.raises(ValueError, match="twice"):
        decode(row(1, 0.0)[:-1] + ',"x":5.0}')


@given(st.lists(lines(), max_size=30))
@settings(max_examples=60)
def test_nothing_breaks_a_station_and_what_it_sends_is_strict(tmp_path_factory, told) -> None:
    site = load_site(write_site(tmp_path_factory.getbasetemp(), [square(50, "apron")]))
    station = Station(site, load_zones(site))
    for line in [*told, *GOOD]:
        for message in station.take(line):
            assert strict(message.text)["station"] == "north"


NAMES = st.sampled_from(["north", "south", "evil", "x1", "sky", "a b", "", "x" * 200])


@st.composite
def said(draw: st.DrawFn) -> bytes:
    """Messages of a station, including its place."""
    kind = draw(st.sampled_from(["event", "event", "event", "site", "gone", "bytes"]))
    name = draw(NAMES)
    if kind == "bytes":
        return draw(st.binary(max_size=50))
    if kind == "gone":
        return json.dumps({"event": "gone", "station": name}).encode()
    if kind == "site":
        keys = draw(st.dictionaries(st.sampled_from(sorted(ORIGIN)), LITERALS, max_size=2))
        origin = {key: json.dumps(value) for key, value in ORIGIN.items()} | keys
        parts = ",".join(f'"{key}":{value}' for key, value in origin.items())
        return f'{{"event":"site","station":"{name}","origin":{{{parts}}}}}'.encode()
    place = f'"latitude_deg":{draw(LITERALS)},"longitude_deg":8.0,"height_m":{draw(LITERALS)},'
    place = draw(st.sampled_from(["", place]))
    return (f'{{"station":"{name}",{place}' + draw(lines())[1:]).encode(errors="replace")


@given(st.lists(said(), max_size=40))
@settings(max_examples=80)
def test_nothing_breaks_a_sky_of_many_stations(messages) -> None:
    many = Many(Site(origin=Place(**ORIGIN)), (), "broker")
    for message in messages:
        for told in many.take(message):
            values = strict(told.message.text)
            assert values["station"] == told.message.station


def test_tracks_and_sensors_of_a_station_are_bounded(caplog) -> None:
    station = Station(Site())
    ended = []
    for number in range(4 * MOST_TRACKS):
        told = station.take(row(number, number / 1000))
        ended += [m.event.track for m in told if m.kind == "end"]
    assert ended == list(range(3 * MOST_TRACKS))  # who is unheard for longest goes first
    taken = [bool(station.take(sensor(f"s{i}", "ok", 2.0))) for i in range(100)]
    assert sum(taken) == 64
    assert any("sensors" in message for message in caplog.messages)


@pytest.mark.parametrize("name", ["\u3164", "\u2800", " ", "\u00a0", "mid360\u115f", "\u0300"])
def test_a_name_that_nobody_sees_is_none(name: str) -> None:
    with pytest.raises(ValueError, match="characters that can be seen"):
        decode(sensor(name, "ok"))


def test_how_old_an_event_is_says_the_server_alone() -> None:
    text = f'{state("running")[:-1]},"age_s":-1e9,"load":0.1}}'
    (message,) = Station(Site()).take(text)
    (told,) = Many(Site(), (), "broker").take(f'{text[:-1]},"station":"north"}}'.encode())
    for line in (message.text, told.message.text):
        assert "age_s" not in json.loads(line)
        assert json.loads(line)["load"] == 0.1
