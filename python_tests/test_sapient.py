"""`unlidar relay EVENTS sapient+tcp://HOST:PORT`: what a middleware gets, and is answered."""

from __future__ import annotations

import itertools
import signal
import time
from pathlib import Path

import pytest
from live_program import wait_until
from sapient_middleware import MIDDLEWARE_ID, TASK_ID, Middleware, task
from sapient_msg.bsi_flex_335_v2_0.alert_pb2 import Alert
from sapient_msg.bsi_flex_335_v2_0.registration_pb2 import Registration
from sapient_msg.bsi_flex_335_v2_0.status_report_pb2 import StatusReport
from sapient_msg.bsi_flex_335_v2_0.task_ack_pb2 import TaskAck
from sapient_msg.bsi_flex_335_v2_0.task_pb2 import Task
from sapient_msg_pydantic.bsi_flex_335_v2_0.sapient_message import (
    SapientMessage as Checked,
)
from station_events import appended, end, now, row, sensor, square, state, track, write_site
from test_relay import Relay
from unlidar.relay.sapient.rules import faults

LOCATION = {"x": 8.0, "y": 47.0, "coordinate_system": 1, "datum": 1}
WELL = [sensor("mid360", "ok"), sensor("avia", "ok"), state("warming_up"), state("running")]


@pytest.fixture
def site(tmp_path: Path) -> Path:
    return write_site(tmp_path, [square(50, "apron")])


def url(middleware: Middleware) -> str:
    return f"sapient+tcp://127.0.0.1:{middleware.port}"


def check(middleware: Middleware) -> None:
    """Every message is valid by the standard's own rules, read by two programs."""
    for message in middleware.messages:
        assert list(faults(message)) == []
        Checked.from_pb2(message)


def test_a_node_registers_tells_and_says_goodbye(site) -> None:
    with (
        Middleware() as middleware,
        Relay("-", url(middleware), "--site", site, stdin=True) as relay,
    ):
        middleware.wait_for("status_report")
        relay.feed(*WELL, track(7, 1.0, drone=0.8, bird_like=0.05), now(7, 1.0), row(7, 0.1))
        (first, *_) = middleware.wait_for("detection_report")
        relay.feed(end(7, 20.0))
        last = middleware.wait_until("detection_report", lambda report: report.state == "lost")
        code, said = relay.end()
    assert code == 0, said
    kinds = [message.WhichOneof("content") for message in middleware.messages]
    assert kinds[:2] == ["registration", "status_report"]
    assert kinds[-1] == "status_report"
    reports = middleware.all("status_report")
    assert reports[0].info == StatusReport.INFO_NEW
    assert [r.system for r in reports].count(StatusReport.SYSTEM_GOODBYE) == 1
    assert reports[-1].system == StatusReport.SYSTEM_GOODBYE
    (node,) = {message.node_id for message in middleware.messages}
    assert f"is registered as node {node}" in said
    assert f"{len(middleware.messages)} messages sent" in said
    (told,) = middleware.all("registration")
    assert told.node_definition[0].node_type == Registration.NODE_TYPE_LIDAR
    assert last.object_id == first.object_id
    assert {c.type: round(c.confidence, 6) for c in first.classification} == {
        "Air Vehicle": 0.8, "Animal": 0.05, "Unknown": 0.15,
    }  # fmt: skip
    assert [c.sub_class[0].type for c in first.classification[:2]] == ["UAV Rotary Wing", "Bird"]
    assert first.track_info[0].value == "7"
    check(middleware)


def test_detections_of_a_scan_have_one_stamp_and_scans_are_apart(site) -> None:
    with (
        Middleware() as middleware,
        Relay("-", url(middleware), "--site", site, stdin=True) as relay,
    ):
        middleware.wait_for("status_report")
        for step in range(40):  # of two LiDARs, faster than it may be told
            relay.feed(*(now(number, step / 30) for number in range(5)))
            time.sleep(1 / 30)
        middleware.wait_for("detection_report", 50)
        relay.end()
    stamps_ns = [m.timestamp.ToNanoseconds() for m in middleware.messages]
    scans_ns = [
        stamp_ns
        for stamp_ns, m in zip(stamps_ns, middleware.messages, strict=True)
        if m.HasField("detection_report")
    ]
    steps_ns = [b - a for a, b in itertools.pairwise(scans_ns)]
    assert all(step == 0 or step >= 80_000_000 for step in steps_ns)
    assert max(scans_ns.count(stamp) for stamp in scans_ns) == 5
    others = [stamp for stamp in stamps_ns if stamp not in scans_ns]
    assert others == sorted(set(others))
    late_s = [t - ns * 1e-9 for t, ns in zip(middleware.received_s, stamps_ns, strict=True)]
    assert min(late_s) > -0.1
    assert sorted(late_s)[len(late_s) // 2] < 0.5
    assert len({r.report_id for r in middleware.all("detection_report")}) == len(scans_ns)
    check(middleware)


def test_ids_last_over_lost_connections_and_restarts(site, tmp_path) -> None:
    events = tmp_path / "events.jsonl"
    append = appended(events)
    append(*WELL, track(7, 1.0), now(7, 1.0))
    seconds = itertools.count(2)
    with Middleware() as middleware:

        def is_told(known: int) -> bool:
            append(now(7, next(seconds) * 0.1))
            return any(m.HasField("detection_report") for m in middleware.messages[known:])

        for _start in range(2):
            with Relay(events, url(middleware), "--site", site) as relay:
                for _session in range(2):
                    known, sessions = len(middleware.messages), middleware.sessions
                    wait_until(lambda known=known: is_told(known), "a detection came")
                    middleware.kick()
                    wait_until(
                        lambda s=sessions: middleware.sessions > s, "the node is there again"
                    )
                assert relay.end(signal.SIGTERM)[0] == 0
    assert len({message.node_id for message in middleware.messages}) == 1
    assert len({report.object_id for report in middleware.all("detection_report")}) == 1
    check(middleware)


def test_the_status_follows_lidars_and_engine(site) -> None:
    def has(system: int, *texts: str):
        return lambda report: (
            report.system == system and [s.status_value for s in report.status] == list(texts)
        )

    ok, warning, error = (getattr(StatusReport, f"SYSTEM_{n}") for n in ("OK", "WARNING", "ERROR"))
    with (
        Middleware() as middleware,
        Relay("-", url(middleware), "--site", site, stdin=True) as relay,
    ):
        middleware.wait_until("status_report", has(warning, "nothing was heard of the engine yet"))
        relay.feed(*WELL[:3])
        middleware.wait_until("status_report", has(warning, "the engine learns its scene"))
        relay.feed(state("running"))
        middleware.wait_until("status_report", has(ok))
        relay.feed(sensor("avia", "blinded", 3.0))
        told = middleware.wait_until("status_report", has(warning, "LiDAR avia blinded"))
        assert told.status[0].status_type == StatusReport.STATUS_TYPE_EXTERNAL_FAULT
        relay.feed(sensor("mid360", "silent", 4.0))
        told = middleware.wait_until("status_report", lambda report: report.system == error)
        assert told.status[-1].status_type == StatusReport.STATUS_TYPE_NOT_DETECTING
        relay.feed(sensor("mid360", "ok", 5.0), sensor("avia", "ok", 5.0, clock="lost"))
        text = "LiDAR avia has lost its time synchronisation"
        told = middleware.wait_until("status_report", has(warning, text))
        assert told.status[0].status_type == StatusReport.STATUS_TYPE_EXTERNAL_FAULT
        relay.feed(sensor("avia", "ok", 6.0, clock="synchronised"))
        middleware.wait_until("status_report", has(ok))
        relay.feed(sensor("avia", "ok", 7.0, clock="lost"), sensor("avia", "ok", 8.0))
        middleware.wait_until("status_report", has(ok))  # of an engine that tells none
        relay.feed(state("overloaded"))
        text = "the engine is overloaded: weak drones may be missed"
        middleware.wait_until("status_report", has(warning, text))
        middleware.wait_until("status_report", lambda r: r.info == StatusReport.INFO_UNCHANGED)
        relay.end()
    check(middleware)


def test_an_alarm_is_an_alert_until_its_track_ends(site) -> None:
    flight = [row(7, t / 10) for t in range(40)]
    with (
        Middleware() as middleware,
        Relay("-", url(middleware), "--site", site, stdin=True) as relay,
    ):
        middleware.wait_for("status_report")
        relay.feed(*WELL, track(7, 1.0, drone=0.8), *flight)
        (raised,) = middleware.wait_for("alert")
        (seen, *_) = middleware.wait_for("detection_report")
        middleware.kick()
        middleware.wait_for("alert", 2)  # who comes anew is told of what goes on
        relay.feed(end(7, 20.0))
        middleware.wait_for("alert", 3)
        relay.end()
    statuses = [alert.status for alert in middleware.all("alert")]
    assert statuses == [Alert.ALERT_STATUS_ACTIVE] * 2 + [Alert.ALERT_STATUS_CLEAR]
    assert len({alert.alert_id for alert in middleware.all("alert")}) == 1
    assert raised.description == "track 7 in apron"
    assert raised.associated_detection[0].object_id == seen.object_id
    assert raised.location.y == pytest.approx(47.0, abs=1e-3)
    check(middleware)


def test_alerts_of_a_long_history_are_those_that_go_on(site, tmp_path) -> None:
    """The node registers while it still reads."""
    events = tmp_path / "events.jsonl"
    appended(events)(
        *WELL, sensor("avia", "blinded"), track(7, 1.0), *(row(7, t / 50) for t in range(4000)),
        end(7, 90.0), sensor("avia", "ok", 90.0), track(8, 91.0),
        *(row(8, 91.0 + t / 10) for t in range(40)),
    )  # fmt: skip
    with Middleware() as middleware, Relay(events, url(middleware), "--site", site) as relay:
        middleware.wait_for("alert")
        appended(events)(end(8, 100.0))
        middleware.wait_until("alert", lambda alert: alert.status == Alert.ALERT_STATUS_CLEAR)
        assert relay.end(signal.SIGTERM)[0] == 0
    told = [(alert.description, alert.status) for alert in middleware.all("alert")]
    assert told == [
        ("track 8 in apron", Alert.ALERT_STATUS_ACTIVE),
        ("track 8 in apron", Alert.ALERT_STATUS_CLEAR),
    ]
    texts = {s.status_value for r in middleware.all("status_report") for s in r.status}
    assert "LiDAR avia blinded" not in texts
    check(middleware)


def test_requests_are_fulfilled_and_all_else_is_rejected_by_its_name(site) -> None:
    rejected = {
        "mode_change fast": {"command": Task.Command(mode_change="fast")},
        "detection_threshold": {"command": Task.Command(detection_threshold=1)},
        "patrol": {"command": Task.Command(patrol={"locations": [LOCATION]})},
        "request stop": {"command": Task.Command(request="Stop")},
        "CONTROL_STOP": {"control": Task.CONTROL_STOP, "command": Task.Command(request="Reset")},
        "a task without command": {},
    }
    with (
        Middleware() as middleware,
        Relay("-", url(middleware), "--site", site, stdin=True) as relay,
    ):
        middleware.wait_for("status_report")
        node = middleware.messages[0].node_id
        for number, (name, content) in enumerate(rejected.items(), 1):
            middleware.send(task(node, **content))
            reply = middleware.wait_for("task_ack", number)[-1]
            assert reply.task_status == TaskAck.TASK_STATUS_REJECTED
            assert reply.task_id == TASK_ID
            assert reply.reason[0].startswith(f"{name} is not supported")
        for request in ("Registration", "status", "Reset"):
            known = len(middleware.messages)
            middleware.send(task(node, command=Task.Command(request=request)))
            wait_until(
                lambda known=known: any(
                    m.HasField("status_report") and m.status_report.info == StatusReport.INFO_NEW
                    for m in middleware.messages[known:]
                ),
                "the status is told anew",
            )
            answers = [m.WhichOneof("content") for m in middleware.messages[known:]]
            assert answers[0] == "task_ack"
            assert ("registration" in answers) == (request != "status")
            assert middleware.messages[known].destination_id == MIDDLEWARE_ID
            accepted = middleware.messages[known].task_ack.task_status
            assert accepted == TaskAck.TASK_STATUS_ACCEPTED
        known = len(middleware.all("task_ack"))
        middleware.send(task(MIDDLEWARE_ID, command=Task.Command(request="Status")))
        relay.wait_for("a task for node")
        relay.end()
    assert len(middleware.all("task_ack")) == known
    check(middleware)


def test_events_that_end_before_the_registration_are_told(site) -> None:
    flight = [*WELL, track(7, 1.0), *(now(7, 1.0 + t / 10) for t in range(50)), end(7, 20.0)]
    with Middleware() as middleware, Relay(
        "-", url(middleware), "--site", site, stdin=True
    ) as relay:  # fmt: skip
        relay.feed(*flight)
        code, said = relay.end()
    assert code == 0, said
    assert middleware.all("detection_report")[-1].state == "lost"
    assert middleware.all("status_report")[-1].system == StatusReport.SYSTEM_GOODBYE
    check(middleware)


def test_a_middleware_that_was_away_is_told_of_now(site) -> None:
    middleware = Middleware()
    port = middleware.port
    with Relay("-", url(middleware), "--site", site, stdin=True) as relay:
        middleware.wait_for("status_report")
        middleware.close()
        relay.wait_for("it is tried again")
        relay.feed(*WELL, track(7, 1.0), *(now(7, 1.0 + t / 100) for t in range(100)))
        with Middleware(port) as again:
            again.wait_for("status_report")
            relay.feed(now(7, 2.1))
            again.wait_for("detection_report")
            code, said = relay.end()
    assert code == 0
    assert "is there again" in said
    check(again)
