"""A SAPIENT middleware that misbehaves: it is said in a line, bounded, and called again."""

from __future__ import annotations

import asyncio
import contextlib
import os
import random
import resource
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator

import pytest
from google.protobuf.message import DecodeError
from sapient_middleware import (
    Middleware,
    accepted,
    framed,
    message_of,
    received,
    task,
)
from sapient_msg.bsi_flex_335_v2_0.error_pb2 import Error
from sapient_msg.bsi_flex_335_v2_0.sapient_message_pb2 import SapientMessage
from sapient_msg.bsi_flex_335_v2_0.task_pb2 import Task
from station_events import ORIGIN, now, row, state, track, write_site
from test_relay_links import serving
from unlidar.addresses import Scheme, read_address
from unlidar.events.site import Place, Site
from unlidar.events.station import Station
from unlidar.relay.sapient.connection import Connection
from unlidar.relay.sapient.ids import lasting_node_id
from unlidar.relay.sapient.output import SapientOutput
from unlidar.relay.sapient.rules import faults

PATIENCE_S = 20.0


@pytest.fixture(autouse=True)
def impatient(monkeypatch) -> None:
    monkeypatch.setattr("unlidar.relay.output._WAIT_S", (0.01, 0.05))
    monkeypatch.setattr("unlidar.relay.sapient.output._ANSWER_S", 0.3)
    monkeypatch.setattr("unlidar.relay.sapient.connection.DIAL_S", 0.5)


def node(port: int) -> SapientOutput:
    schemes = {"sapient+tcp": Scheme()}
    address = read_address(f"sapient+tcp://127.0.0.1:{port}", schemes, "")
    return SapientOutput(address, "north", Place(**ORIGIN), 0.0, None)


def messages(*lines: str) -> list:
    station = Station(Site(origin=Place(**ORIGIN)))
    return [message for line in lines for message in station.take(line)]


def run(output: SapientOutput, holds: Callable[[], object]) -> None:
    """Runs a node, which is offered positions, until something holds; it must not have ended."""

    async def go() -> None:
        running = asyncio.ensure_future(output.run())
        for message in messages(state("running"), track(7, 0.0)):
            output.offer(message, spare=True)
        try:
            async with asyncio.timeout(PATIENCE_S):
                step = 0
                while not holds():
                    assert not running.done(), running
                    step += 1
                    for message in messages(now(7, step * 0.02)):
                        output.offer(message, spare=True)
                    await asyncio.sleep(0.02)
        finally:
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)

    asyncio.run(go())


def registered(client: socket.socket) -> Iterator[SapientMessage]:
    """Accepts a node; its later messages."""
    incoming = received(client)
    next(incoming)
    client.sendall(accepted())
    return incoming


def silent(client: socket.socket) -> None:
    with contextlib.suppress(OSError):
        while client.recv(65536):
            pass


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (b"", "the connection was closed"),
        (b"HTTP/1.1 400 Bad Request\r\n\r\n", "sent a message of 1,347,703,880 bytes"),
        (b"\xff\xff\xff\xff" + b"x" * 1000, "sent a message of 4,294,967,295 bytes"),
        (struct.pack("<I", 1 << 18) + b"x", "the connection was closed"),
        (b"\x05", "the connection was closed"),
        (accepted("no room", "\x1b[31mred"), "refused the registration: no room; \x1b[31mred"),
        (accepted(""), "refused the registration: it gives no reason"),
    ],
    ids=("nothing", "http", "huge", "half", "a byte", "two reasons", "no reason"),
)
def test_who_answers_a_registration_like_that_is_called_again(answer, said, caplog) -> None:
    calls = []

    def talk(client: socket.socket) -> None:
        calls.append(next(received(client)).WhichOneof("content"))
        client.sendall(answer)

    with serving(talk) as port:
        output = node(port)
        run(output, lambda: len(calls) >= 4)
    assert set(calls) == {"registration"}
    assert output.dropped > 0
    (told,) = [record.getMessage() for record in caplog.records]  # once, however often it happens
    assert told == f"sapient+tcp://127.0.0.1:{port}: {said}; it is tried again" or (
        said.startswith("sent") and said in told
    )


@pytest.mark.parametrize("begin", [b"", struct.pack("<I", 100) + b"half", b"\x01"])
def test_who_never_answers_a_registration_is_called_again(begin, caplog) -> None:
    calls = []

    def talk(client: socket.socket) -> None:
        calls.append(client)
        client.sendall(begin)
        silent(client)

    with serving(talk) as port:
        run(node(port), lambda: len(calls) >= 3)
    assert len(caplog.records) == 1


def test_nobody_there_is_said_once(caplog) -> None:
    with Middleware() as middleware:
        port = middleware.port
    output = node(port)
    end_s = time.monotonic() + 0.5
    run(output, lambda: time.monotonic() > end_s)
    assert len(caplog.records) == 1
    assert (output.sent, output.waiting) == (0, 1)  # of many positions the newest waits


def test_nothing_piles_up_while_nobody_is_there() -> None:
    with Middleware() as middleware:
        port = middleware.port
    output = node(port)
    flight = [line for t in range(1000) for line in (now(7, t / 100), row(7, t / 100 - 1))]
    for message in messages(track(7, 0.0), *flight):
        output.offer(message, spare=True)
    assert (output.waiting, output.dropped) == (1, 1000)
    with Middleware(port) as middleware:
        run(output, lambda: middleware.all("detection_report"))
        stamps = [m.timestamp.ToNanoseconds() for m in middleware.messages]
    assert time.time() - min(stamps) * 1e-9 < PATIENCE_S


def test_garbage_after_the_registration_is_answered_and_leaves_the_node_well(caplog) -> None:
    rng = random.Random(1)
    replies: list[SapientMessage] = []
    sent = []

    def talk(client: socket.socket) -> None:
        incoming = registered(client)
        for _ in range(30):
            sent.append(rng.randbytes(rng.randrange(200)))
            client.sendall(framed(sent[-1]))
        client.sendall(task(command=Task.Command(request="Status")))
        for message in incoming:
            replies.append(message)

    with serving(talk) as port:
        run(node(port), lambda: any(m.HasField("task_ack") for m in replies))
    errors = [m.error for m in replies if m.HasField("error")]
    assert [error.packet for error in errors] == [data for data in sent if not is_error(data)]
    assert any(m.HasField("detection_report") for m in replies)
    assert all(list(faults(m)) == [] for m in replies)
    noted = [r.getMessage() for r in caplog.records if "not understood" in r.getMessage()]
    assert 1 <= len(noted) <= 6
    assert max(map(len, noted)) < 350


def is_error(data: bytes) -> bool:
    try:
        return SapientMessage.FromString(data).HasField("error")
    except DecodeError:
        return False


def test_an_error_is_said_and_never_answered(caplog) -> None:
    replies: list[SapientMessage] = []

    def talk(client: socket.socket) -> None:
        incoming = registered(client)
        for _ in range(20):
            error = Error(packet=b"x", error_message=["too late", "y" * 10_000])
            client.sendall(message_of("error", error))
            client.sendall(message_of("error", Error()))  # itself at fault
        client.sendall(task(command=Task.Command(request="Status")))
        for message in incoming:
            replies.append(message)

    with serving(talk) as port:
        run(node(port), lambda: any(m.HasField("task_ack") for m in replies))
    assert not any(m.HasField("error") for m in replies)
    noted = [r.getMessage() for r in caplog.records if "answers with an error" in r.getMessage()]
    assert 1 <= len(noted) <= 5
    assert "too late" in noted[0]
    assert max(map(len, noted)) < 300


def test_a_task_that_is_incomplete_is_answered_by_its_fault() -> None:
    replies: list[SapientMessage] = []

    def talk(client: socket.socket) -> None:
        incoming = registered(client)
        client.sendall(message_of("task", Task(control=Task.CONTROL_START)))
        client.sendall(message_of("task", Task(task_id="x", control=17)))
        for message in incoming:
            replies.append(message)

    with serving(talk) as port:
        run(node(port), lambda: sum(m.HasField("error") for m in replies) >= 2)
    first, second = [list(m.error.error_message) for m in replies if m.HasField("error")]
    assert first == ["task.task_id: is missing"]
    assert second == ["task.task_id: is no ULID; task.control: 17 is none of its values"]


@pytest.mark.parametrize("reads", [True, False])
def test_a_flood_of_tasks_takes_neither_memory_nor_the_place_of_detections(reads) -> None:
    replies: list[SapientMessage] = []
    # The second is nothing but faults, 100,000 of them.
    flood = task(command=Task.Command(request="x" * 100_000)) * 10
    flood += task(region=[Task.Region()] * 100_000) * 10

    def read(incoming: Iterator[SapientMessage]) -> None:
        with contextlib.suppress(OSError):
            for message in incoming:
                replies.append(message)

    def talk(client: socket.socket) -> None:
        incoming = registered(client)
        if reads:
            threading.Thread(target=read, args=(incoming,), daemon=True).start()
        with contextlib.suppress(OSError):
            for _ in range(200):
                client.sendall(flood)
                calls.append(1)

    calls: list[int] = []
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with serving(talk) as port:
        output = node(port)
        if reads:
            run(output, lambda: sum(m.HasField("detection_report") for m in replies) >= 5)
        else:
            end_s = time.monotonic() + 2
            run(output, lambda: calls and time.monotonic() > end_s)
    grown_mb = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb) / 1024
    assert grown_mb < 60


def test_who_takes_nothing_more_is_left_and_called_again(caplog) -> None:
    sessions = []

    def talk(client: socket.socket) -> None:
        client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        sessions.append(client)
        next(received(client))
        with contextlib.suppress(OSError):
            client.sendall(accepted())
            # Each garbled message asks for an answer, and none is read.
            while True:
                client.sendall(framed(os.urandom(4000)))

    with serving(talk) as port:
        run(node(port), lambda: len(sessions) >= 2)
    # By our patience or by the system's, whichever ends first.
    said = " ".join(record.getMessage() for record in caplog.records)
    assert "took nothing for" in said or "Connection lost" in said


def test_little_waits_for_who_reads_nothing_and_none_of_it_in_the_process() -> None:
    """What is sent is out of the reach of a SIGKILL, and what is not is told as it is then."""
    full = threading.Event()

    def talk(client: socket.socket) -> None:
        client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        full.wait(PATIENCE_S)

    async def fill(port: int) -> int:
        connection, sent = Connection("a middleware", lasting_node_id("north")), 0
        await connection.open("127.0.0.1", port)
        with pytest.raises(ConnectionError, match="took nothing"):
            while True:
                await connection.send([Error(packet=bytes(300))], "error")
                assert connection._writer.transport.get_write_buffer_size() == 0
                sent += 300
        await connection.close()
        return sent

    with serving(talk) as port:
        assert 0 < asyncio.run(fill(port)) < 300_000
        full.set()


def test_a_clock_that_is_set_back_begins_a_new_session(monkeypatch, caplog) -> None:
    with Middleware() as middleware:
        real = time.time_ns
        run_until = iter([False])

        def moved() -> bool:
            if not middleware.all("detection_report"):
                return False
            if next(run_until, True) is False:
                monkeypatch.setattr(time, "time_ns", lambda: real() - 5_000_000_000)
            return middleware.sessions > 1 and len(middleware.all("status_report")) > 1

        run(node(middleware.port), moved)
    assert any("clock was set back" in record.getMessage() for record in caplog.records)


def test_a_site_without_origin_is_refused(tmp_path, fails) -> None:
    (tmp_path / "site.yaml").write_text("station: north\n")
    url = "sapient+tcp://127.0.0.1:5020"
    assert "origin" in fails(3, "relay", "x", url, "--site", tmp_path / "site.yaml")
    assert "HOST:PORT" in fails(
        2, "relay", "x", "sapient+tcp://127.0.0.1", "--site", write_site(tmp_path)
    )
