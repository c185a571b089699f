"""SAPIENT: places, errors, ids and rules, compared with other programs and by laws."""

from __future__ import annotations

import time
import uuid

import numpy as np
import pytest
from google.protobuf.json_format import Parse, ParseError
from hypothesis import given
from hypothesis import strategies as st
from pymap3d import geodetic2enu
from sapient_msg.bsi_flex_335_v2_0.sapient_message_pb2 import SapientMessage
from station_events import BEGIN_NS, ORIGIN, end, now, row, sensor, square, state, track, write_site
from ulid import ULID
from unlidar.events.site import Place, Site, load_site, load_zones
from unlidar.events.station import Station
from unlidar.relay.sapient.ids import lasting_node_id, lasting_ulid, new_ulid
from unlidar.relay.sapient.messages import Reporter
from unlidar.relay.sapient.picture import Picture
from unlidar.relay.sapient.registration import registration
from unlidar.relay.sapient.rules import faults

NODE = lasting_node_id("north")


class Clock:
    """A monotonic clock that goes on when it is told to."""

    now_s = 1000.0

    def __call__(self) -> float:
        return self.now_s


def drawn(*lines: str, picture: Picture | None = None, site: Site | None = None) -> Picture:
    """The picture after these events."""
    station = Station(site or Site(origin=Place(**ORIGIN)), load_zones(site) if site else ())
    picture = Picture(NODE, Clock()) if picture is None else picture
    for line in lines:
        for message in station.take(line):
            picture.take(message)
    return picture


def learnt(*lines: str, site: Site | None = None) -> Picture:
    """The picture of one who reads these events of before its start, and may read on."""
    station = Station(site or Site(), load_zones(site) if site else ())
    picture = Picture(NODE, Clock())
    for line in lines:
        for message in station.take(line):
            picture.learn(message)
    return picture


def told(picture: Picture, place: dict = ORIGIN, now_s: float = Clock.now_s) -> list:
    return Reporter(NODE, Place(**place)).detections(picture.take_fresh(), now_s)


def enu_m(report, place: dict) -> np.ndarray:
    at = report.location
    keys = ("latitude_deg", "longitude_deg", "height_m")
    return np.array(geodetic2enu(at.y, at.x, at.z, *(place[key] for key in keys)))


@pytest.mark.parametrize("longitude", [8.0, -179.9999, 188.0])
@pytest.mark.parametrize(
    ("heading", "x_axis", "y_axis"),
    [
        (90.0, (1, 0), (0, 1)),
        (0.0, (0, 1), (-1, 0)),
        (225.0, (-(0.5**0.5),) * 2, (0.5**0.5, -(0.5**0.5))),
    ],
)
def test_place_velocity_and_errors_are_turned_as_the_station_is(
    longitude, heading, x_axis, y_axis
) -> None:
    place = ORIGIN | {"heading_deg": heading, "longitude_deg": longitude}
    picture = drawn(now(7, 1.0, (300.0, -40.0, 55.0), (3.0, 4.0, -1.0)))
    (report,) = told(picture, place)
    turn = np.array([[*x_axis, 0], [*y_axis, 0], [0, 0, 1]]).T
    assert enu_m(report, place) == pytest.approx(turn @ (300.0, -40.0, 55.0), abs=1e-3)
    assert -180 <= report.location.x <= 180
    velocity = report.enu_velocity
    enu_mps = [velocity.east_rate, velocity.north_rate, velocity.up_rate]
    assert enu_mps == pytest.approx(turn @ (3.0, 4.0, -1.0), abs=1e-9)
    # A place that is moved by the errors is moved by the standard deviations in metres.
    moved = SapientMessage(detection_report=report).detection_report
    moved.location.x += report.location.x_error
    moved.location.y += report.location.y_error
    moved.location.z += report.location.z_error
    sigma_m = np.sqrt(np.diag(turn @ np.diag([0.1**2, 0.2**2, 0.3**2]) @ turn.T))
    assert enu_m(moved, place) - enu_m(report, place) == pytest.approx(sigma_m, rel=1e-3)


def test_a_row_is_predicted_to_now_and_its_error_grows() -> None:
    picture = drawn(row(7, 1.0, (10.0, 0.0, 20.0), (15.0, 0.0, 0.0)))  # told 0.9 s after its stamp
    (report,) = told(picture, now_s=Clock.now_s + 0.1)
    assert enu_m(report, ORIGIN) == pytest.approx([25.0, 0.0, 20.0], abs=1e-3)
    metres = report.location.y_error * 111_180
    assert metres == pytest.approx((0.07**2 + (0.5 * 3 * 1.0**2) ** 2) ** 0.5, rel=1e-3)
    assert told(picture) == []  # told once


def test_of_a_stream_of_now_the_time_under_way_counts(monkeypatch) -> None:
    line = now(7, 1.0, (0.0, 0.0, 20.0), (10.0, 0.0, 0.0))
    (message,) = Station(Site(origin=Place(**ORIGIN))).take(line)
    monkeypatch.setattr(time, "time", lambda: message.at_ns * 1e-9 + 0.5)
    picture = Picture(NODE, Clock())
    picture.take(message)
    assert enu_m(told(picture)[0], ORIGIN)[0] == pytest.approx(5.0, abs=1e-3)


def test_rows_tell_no_position_while_there_are_events_now() -> None:
    picture = drawn(track(7, 1.0), now(7, 1.0, (1.0, 0.0, 9.0)), row(7, 1.1, (50.0, 0.0, 9.0)))
    assert enu_m(told(picture)[0], ORIGIN)[0] == pytest.approx(1.0, abs=1e-3)
    picture._monotonic_s.now_s += 2.5
    drawn(row(7, 3.0, (50.0, 0.0, 9.0), (0.0, 0.0, 0.0)), picture=picture)
    (report,) = told(picture, now_s=Clock.now_s + 2.5)
    assert enu_m(report, ORIGIN)[0] == pytest.approx(50.0, abs=1e-3)


def test_late_rows_and_what_is_old_tell_no_position() -> None:
    assert told(drawn(track(7, 1.0), row(7, 1.0, late=True))) == []
    picture = drawn(row(7, 1.0))
    picture._monotonic_s.now_s += 10
    assert told(picture) == []


def test_confidence_falls_while_a_track_is_not_seen() -> None:
    found = [told(drawn(now(7, 1.0, unseen_s=s)))[0].detection_confidence for s in (0, 2, 5, 60)]
    assert found[0] == 1.0
    assert found == sorted(found, reverse=True)
    assert min(found) > 0


def test_a_track_that_ended_between_two_scans_is_told_once_as_lost() -> None:
    picture = drawn(track(7, 1.0), now(7, 1.0, (5.0, 6.0, 7.0)), end(7, 12.0))
    assert picture.has_positions
    reporter = Reporter(NODE, Place(**ORIGIN))
    assert reporter.detections(picture.take_fresh(), Clock.now_s) == []
    (report,) = reporter.lost(picture.take_lost())
    assert report.state == "lost"
    assert enu_m(report, ORIGIN) == pytest.approx([5.0, 6.0, 7.0], abs=1e-3)
    assert not picture.waiting


def test_what_was_told_before_the_start_gives_ids_and_health_but_no_reports() -> None:
    picture = learnt(sensor("avia", "blinded"), state("running"), track(7, 1.0), now(7, 1.0))
    picture.learned()
    assert not picture.waiting
    assert [s.text for s in picture.health().told][-1].startswith("no LiDAR sees")
    drawn(now(7, 2.0), picture=picture)
    (known,) = picture.take_fresh()
    (fresh,) = drawn(track(7, 1.0), now(7, 2.0)).take_fresh()
    assert known.object_id == fresh.object_id
    (other,) = drawn(track(7, 9.0), now(7, 9.0)).take_fresh()  # its number came again
    assert other.object_id != known.object_id


def test_nothing_of_a_history_is_told_while_it_is_read(tmp_path) -> None:
    site = load_site(write_site(tmp_path, [square(50, "apron")]))
    flight = [row(7, t / 10) for t in range(40)]
    picture = learnt(sensor("avia", "blinded"), *flight, site=site)
    picture.tell_again()  # who comes meanwhile
    assert not picture.waiting
    (told_of,) = picture.health().told
    assert told_of.text.endswith("is being read")
    picture.learned()
    (alert,) = picture.take_alerts()
    assert alert.is_active
    assert len(picture.health().told) > 1
    over = learnt(*flight, end(7, 20.0), site=site)
    over.learned()
    assert not over.waiting


def test_the_latest_ends_are_told_again_to_who_comes_anew(tmp_path) -> None:
    site = load_site(write_site(tmp_path, [square(50, "apron")]))
    station, picture = Station(site, load_zones(site)), Picture(NODE, Clock())

    def take(*lines: str) -> None:
        for line in lines:
            for message in station.take(line):
                picture.take(message)

    def ends() -> list[str]:
        return [t.object_id for t in picture.take_lost()] + [
            a.alert_id for a in picture.take_alerts() if not a.is_active
        ]

    take(*(row(7, t / 10) for t in range(40)))
    (raised,) = picture.take_alerts()
    take(end(7, 20.0))
    known = [raised.object_id, raised.alert_id]
    assert ends() == known
    assert ends() == []
    picture._monotonic_s.now_s += 10.0  # that the loss of a connection may need
    for _ in range(2):
        picture.tell_again()
        assert ends() == known
    picture._monotonic_s.now_s += 3600.0  # in which nobody was there
    picture.tell_again()
    assert ends() == known
    picture._monotonic_s.now_s += 3600.0
    assert ends() == []  # who is there has had time to take it
    picture.tell_again()
    assert ends() == []


@pytest.mark.parametrize(("ago_s", "is_told"), [(5.0, True), (600.0, False)])
def test_what_ended_just_before_the_start_is_told(ago_s, is_told, tmp_path, monkeypatch) -> None:
    site = load_site(write_site(tmp_path, [square(50, "apron")]))
    monkeypatch.setattr(time, "time", lambda: BEGIN_NS * 1e-9 + 20.0 + ago_s)
    picture = learnt(*(row(7, 10 + t / 10) for t in range(40)), end(7, 20.0), site=site)
    picture.learned()
    assert [alert.is_active for alert in picture.take_alerts()] == [False] * is_told
    lost = Reporter(NODE, Place(**ORIGIN)).lost(picture.take_lost())
    assert [report.state for report in lost] == ["lost"] * is_told


def test_a_picture_is_bounded(tmp_path) -> None:
    site = load_site(write_site(tmp_path, [square(50, f"zone{i}") for i in range(40)]))
    picture = Picture(NODE, Clock())
    flights = (row(number, number / 100 + t) for number in range(300) for t in (0.0, 3.0))
    drawn(*flights, site=site, picture=picture)
    assert picture.waiting <= 256 + 256 + 1000
    assert len(picture.take_alerts()) == 1000


@given(st.integers(-(10**18), 4 * 10**18), st.text(max_size=5))
def test_ulids_are_those_of_another_program(stamp_ns, name) -> None:
    text = lasting_ulid(stamp_ns, name)
    assert lasting_ulid(stamp_ns, name) == text != lasting_ulid(stamp_ns, name + "1")
    assert ULID.from_str(text).milliseconds == max(stamp_ns // 1_000_000, 0)
    assert str(ULID.from_str(text)) == text


def test_ulids_are_of_now_and_never_alike() -> None:
    found = [new_ulid() for _ in range(1000)]
    assert len(set(found)) == 1000
    assert ULID.from_str(found[0]).timestamp == pytest.approx(time.time(), abs=5)


def test_a_node_has_one_id_for_ever_and_another_name_another(tmp_path, fails) -> None:
    assert lasting_node_id("north") == NODE != lasting_node_id("south")
    assert uuid.UUID(NODE).version == 4
    output = {"to": "sapient+tcp://127.0.0.1:1", "node_id": NODE}
    assert load_site(write_site(tmp_path, outputs=[output])).outputs[0].node_id == NODE
    for wrong in (str(uuid.uuid1()), NODE.upper(), "north", ""):
        site = write_site(tmp_path, outputs=[output | {"node_id": wrong}])
        assert "UUID of version 4" in fails(3, "relay", "x", "--site", site)


def test_the_messages_of_the_standards_harness_are_told_apart(shared) -> None:
    def found(text: str) -> list[str]:
        try:
            return list(faults(Parse(text, SapientMessage())))
        except ParseError as error:
            return [str(error)]

    good = {p.name: found(p.read_text()) for p in (shared / "data/sapient/good").iterdir()}
    bad = {p.name: found(p.read_text()) for p in (shared / "data/sapient/bad").iterdir()}
    assert len(good) == 38
    assert {name: why for name, why in good.items() if why} == {}
    # Not declared by the messages themselves: a version, a count, ids of other nodes.
    missed = sorted(name for name, why in bad.items() if not why)
    assert [name.split(".")[0] for name in missed] == ["0028", "0074", "0096", "0178", "0189"]


def test_a_registration_is_valid_whatever_the_station_is_called() -> None:
    for name in ("station", "x" * 120, "_"):
        assert list(faults(registration(name))) == []
