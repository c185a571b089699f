"""`unlidar relay` where connections hold for a message or two: by MQTT, TCP and TLS."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import socket
import sqlite3
import ssl
import struct
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from live_program import PATIENCE_S, wait_until
from station_events import row, write_site
from test_relay import Receiver, Relay, certificate
from unlidar.events.site import Site
from unlidar.relay.mqtt import MqttSender
from unlidar.relay.output import Output
from unlidar.relay.sockets import StreamSender, UdpSender

RESET = struct.pack("ii", 1, 0)  # of SO_LINGER: closing says so at once, and drops what waits


@pytest.fixture(autouse=True)
def impatient(monkeypatch) -> None:
    monkeypatch.setattr("unlidar.relay.output._WAIT_S", (0.01, 0.02))
    monkeypatch.setattr("unlidar.relay.mqtt._GREET_S", 0.1)
    monkeypatch.setattr("unlidar.relay.sockets._SETTLE_S", 0.03)


@contextlib.contextmanager
def serving(talk: Callable[[socket.socket], None]) -> Iterator[int]:
    """The port of a server that talks with one client after the other."""
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve() -> None:
            with contextlib.suppress(ValueError):
                while listener.fileno() >= 0:
                    with contextlib.suppress(OSError):
                        client, _ = listener.accept()
                        with client:
                            talk(client)

        threading.Thread(target=serve, daemon=True).start()
        try:
            yield listener.getsockname()[1]
        finally:
            listener.shutdown(socket.SHUT_RDWR)


def sent(output: Output, messages: list, seconds: float = PATIENCE_S) -> None:
    """All of them are sent, or it fails."""

    async def run() -> None:
        running = asyncio.ensure_future(output.run())
        for message in messages:
            output.offer(message, spare=True)
        try:
            await asyncio.wait_for(output._emptied.wait(), seconds)
        finally:
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)

    asyncio.run(run())


class PoorBroker:
    """Acknowledges so many publications of a connection, then resets it; and what it refuses."""

    def __init__(self, most: int, refused: bytes = b"refused") -> None:
        self.got: list[tuple[str, bytes]] = []
        self._most, self._refused = most, refused

    def __call__(self, client: socket.socket) -> None:
        rest, left = b"", self._most
        while data := client.recv(65536):
            rest += data
            while (packet := self._first(rest)) is not None:
                kind, body, rest = packet
                if kind >> 4 == 1:
                    client.sendall(b"\x20\x02\x00\x00")
                elif kind >> 4 == 3:
                    size = struct.unpack(">H", body[:2])[0]
                    topic, text = body[2 : 2 + size].decode(), body[4 + size :]
                    if left == 0 or text == self._refused:
                        client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
                        return
                    left -= 1
                    self.got.append((topic, text))
                    client.sendall(b"\x40\x02" + body[2 + size : 4 + size])

    @staticmethod
    def _first(data: bytes) -> tuple[int, bytes, bytes] | None:
        length, used = 0, 1
        while True:
            if used >= len(data):
                return None
            length |= (data[used] & 127) << 7 * (used - 1)
            used += 1
            if data[used - 1] < 128:
                break
        if len(data) < used + length:
            return None
        return data[0], data[used : used + length], data[used + length :]

    def texts(self, topic: str = "unlidar/north/row") -> list[bytes]:
        return list(dict.fromkeys(text for name, text in self.got if name == topic))


def mqtt(port: int) -> Output:
    sender = MqttSender("127.0.0.1", port, Site(station="north"), None, None)
    return Output("mqtt", sender, 1000, sender.probe)


ROWS = [("unlidar/north/row", f"{i}", False) for i in range(30)]


@pytest.mark.parametrize("most", [1, 2, 3, 7])
def test_a_broker_lost_after_every_message_or_two_still_gets_all_in_order(most) -> None:
    broker = PoorBroker(most)
    with serving(broker) as port:
        output = mqtt(port)
        sent(output, ROWS)
    assert broker.texts() == [text.encode() for _, text, _ in ROWS]
    assert (output.sent, output.dropped) == (30, 0)


@pytest.mark.parametrize("refused", ["0", "17", "29"])
def test_what_a_broker_refuses_by_closing_alone_is_left_out(refused) -> None:
    broker = PoorBroker(1000, refused.encode())
    with serving(broker) as port:
        output = mqtt(port)
        sent(output, ROWS)
    assert broker.texts() == [text.encode() for _, text, _ in ROWS if text != refused]
    assert (output.sent, output.dropped) == (29, 1)
    assert ("unlidar/north/relay", b"online") in broker.got
    assert "unlidar/north/site" in {topic for topic, _ in broker.got}


EVENTS = [b"<event %03d/>" % i + b" " * 500 for i in range(70)]


class PoorServer:
    """Reads so many events of a connection, then closes it, or resets it."""

    def __init__(self, most: int, resets: bool, tls: ssl.SSLContext | None = None) -> None:
        self.got = b""
        self._most, self._resets, self._tls = most, resets, tls

    def __call__(self, client: socket.socket) -> None:
        if self._tls is not None:
            client = self._tls.wrap_socket(client, server_side=True)
        with client:
            left = self._most * len(EVENTS[0])
            while left and (data := client.recv(left)):
                self.got += data
                left -= len(data)
            if self._resets:
                client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)


# Reset after each event, a server may have read it or not: then it is sent until one is not.
@pytest.mark.parametrize(
    ("most", "resets"), [(1, False), (20, False), (64, False), (2, True), (20, True), (64, True)]
)
def test_a_server_that_reads_some_events_and_leaves_gets_all_of_them(most, resets) -> None:
    server = PoorServer(most, resets)
    with serving(server) as port:
        output = Output("cot", StreamSender("127.0.0.1", port, None), 1000)
        sent(output, EVENTS)
    assert output.dropped == 0
    assert all(event in server.got for event in EVENTS)
    first = [server.got.find(event) for event in EVENTS]
    assert first == sorted(first)


def test_also_by_tls_no_event_is_lost(tmp_path: Path) -> None:
    pem, key = certificate(tmp_path)
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    context.load_cert_chain(pem, key)
    server = PoorServer(20, resets=False, tls=context)
    trust = ssl.create_default_context(cafile=str(pem))
    with serving(server) as port:
        output = Output("cot", StreamSender("localhost", port, trust), 1000)
        sent(output, EVENTS)
    assert output.dropped == 0
    assert all(event in server.got for event in EVENTS)


def test_a_server_that_takes_nothing_more_has_nothing_that_counts_as_sent(monkeypatch) -> None:
    monkeypatch.setattr("unlidar.relay.sockets.DIAL_S", 0.3)
    done = threading.Event()

    def talk(client: socket.socket) -> None:
        done.wait(PATIENCE_S)

    with serving(talk) as port:
        output = Output("cot", StreamSender("127.0.0.1", port, None), 10_000)
        with pytest.raises(TimeoutError):
            sent(output, [b"x" * 100_000] * 500, 2.0)
        done.set()
    assert output.sent < 250
    assert output.sent + output.waiting == 500


def test_nothing_is_written_into_a_connection_that_the_other_side_has_left() -> None:
    async def check(port: int) -> None:
        sender = StreamSender("127.0.0.1", port, None)
        await sender.connect()
        assert sender._reader is not None
        await sender._reader.read()
        with pytest.raises(ConnectionError, match="closed"):
            await sender.send([b"<event/>"], lambda: pytest.fail("counts as sent"))
        await sender.close()

    with serving(lambda client: None) as port:
        asyncio.run(asyncio.wait_for(check(port), PATIENCE_S))


@pytest.mark.parametrize("host", ["fe80::1", "ff12::1"])
def test_datagrams_go_to_the_zone_of_an_ipv6_address(host: str, monkeypatch) -> None:
    known = []
    monkeypatch.setattr(
        socket.socket, "sendto", lambda own, data, to: known.append((data, to)), raising=False
    )

    async def send() -> None:
        sender = UdpSender(f"{host}%lo", 6969)
        await sender.connect()
        await sender.send([b"<event/>"], lambda: None)
        await sender.close()

    asyncio.run(send())
    assert known == [(b"<event/>", (host, 6969, 0, socket.if_nametoindex("lo")))]


def test_a_terminal_that_is_closed_lets_it_say_its_last_words(tmp_path) -> None:
    listener = Receiver()
    url = f"cot+tcp://127.0.0.1:{listener.port}"
    with Relay(
        "-", "--site", write_site(tmp_path), "--to", url, "--store", tmp_path / "s.db", stdin=True
    ) as relay:
        relay.feed(row(1, 0))
        wait_until(listener.events, "the row has come")
        code, said = relay.end(signal.SIGHUP)
    listener.close()
    assert code == 0
    assert "1 messages sent (sent: acknowledged by the other machine, by no program)" in said
    with contextlib.closing(sqlite3.connect(tmp_path / "s.db")) as db:
        assert db.execute("SELECT count(*) FROM row").fetchone() == (1,)
