"""Listening to a broker: whatever it says, who it is, and that it is heard again."""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
import ssl
import struct
import threading
import time
from collections.abc import Iterator

import pytest
from live_program import PATIENCE_S
from station_events import row, sensor, write_site
from test_relay import certificate
from unlidar.errors import ConfigError, UsageError
from unlidar.events.broker import Broker
from unlidar.events.lines import Published
from unlidar.events.site import Site, Tls, load_site
from unlidar.events.source import open_source
from unlidar.events.station import Station
from unlidar.relay.mqtt import encode

WELCOME, REFUSED, SUBSCRIBED = b"\x20\x02\x00\x00", b"\x20\x02\x00\x05", b"\x90\x03\x00\x01\x01"
ROW = row(1, 0.0).encode()


def packet(topic: bytes, payload: bytes, retained: bool = False) -> bytes:
    body = struct.pack(">H", len(topic)) + topic + payload
    length, rest = b"", len(body)
    while rest or not length:
        length += bytes([rest % 128 | (128 if rest > 127 else 0)])
        rest //= 128
    return (b"\x31" if retained else b"\x30") + length + body


class Saying:
    """Says this after a client has subscribed; and `then`, again and again, to those after it."""

    def __init__(self, said: bytes, then: bytes, tls: ssl.SSLContext | None, welcome: bytes):
        self._said, self._then, self._tls, self._welcome = said, then, tls, welcome
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self.calls = 0
        threading.Thread(target=self._serve, daemon=True).start()

    def close(self) -> None:
        self._listener.close()

    def _serve(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                client, _ = self._listener.accept()
                threading.Thread(target=self._talk, args=(client,), daemon=True).start()

    def _talk(self, client: socket.socket) -> None:
        with contextlib.suppress(OSError), client:
            if self._tls is not None:
                client = self._tls.wrap_socket(client, server_side=True)
            client.recv(4096)
            self.calls += 1
            client.sendall(self._welcome)
            client.recv(4096)
            client.sendall(SUBSCRIBED + (self._said if self.calls == 1 else b""))
            while True:
                time.sleep(0.1)
                client.sendall(self._then)


@contextlib.contextmanager
def saying(
    said: bytes = b"",
    then: bytes | None = None,
    tls: ssl.SSLContext | None = None,
    welcome: bytes = WELCOME,
) -> Iterator[Saying]:
    then = packet(b"unlidar/north/row", ROW) if then is None else then
    server = Saying(said, then, tls, welcome)
    try:
        yield server
    finally:
        server.close()


@pytest.fixture(autouse=True)
def impatient(monkeypatch) -> None:
    monkeypatch.setattr("unlidar.events.broker._WAIT_S", (0.05, 0.1))


def heard(source: Broker, count: int, seconds: float = PATIENCE_S) -> list[Published]:
    """So many messages, or those that came in time; quiet moments left out."""
    got: list[Published] = []

    async def listen() -> None:
        async for line in source.lines():
            got.extend([line.data] if line.data else [])
            if len(got) >= count:
                return

    async def run() -> None:
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(listen(), seconds)

    asyncio.run(run())
    return got


@pytest.mark.parametrize(
    "said",
    [
        packet(b"unlidar/\xff\xfe/row", b"{}"),
        packet(b"", ROW),
        packet(b"unlidar", ROW),
        packet(b"unlidar//row", ROW),
        packet(b"unlidar/\x00/row", ROW),
        packet(b"unlidar/north/row", b"x" * 20_000),
        b"\x30\x05\xff\xffabc",  # a topic longer than its packet
        b"\x30\x00",
        b"\x30\xff\xff\xff\xff\x7f",
        b"\xf0\x00",
        b"\x00\x00",
        b"\x20\x00",
        b"\x90\x00",
        b"\x40\x01\x00",
        b"\xd0\x05hello",
    ],
)
def test_whatever_a_broker_says_it_is_heard_again(said) -> None:
    with saying(said) as server:
        got = heard(Broker(f"mqtt://127.0.0.1:{server.port}"), 3)
    assert [p.text for p in got if p.station == "north"][-1] == ROW


def test_a_broker_that_refuses_us_is_said_with_its_reason(caplog) -> None:
    with saying(welcome=REFUSED) as server:
        assert heard(Broker(f"mqtt://user:hush@127.0.0.1:{server.port}"), 1, 1.0) == []
    assert any("refuses us: Not authorized" in said for said in caplog.messages)
    assert not any("hush" in said for said in caplog.messages)


def test_goodbyes_and_what_was_said_before_are_distinguished() -> None:
    said = packet(b"unlidar/north/relay", b"online") + packet(b"unlidar/north/relay", b"offline")
    said += packet(b"unlidar/north/state", b"{}", retained=True)
    with saying(said) as server:
        got = heard(Broker(f"mqtt://127.0.0.1:{server.port}"), 3)
    assert [(p.gone, p.retained) for p in got] == [(True, False), (False, True), (False, False)]


def test_a_broker_is_heard_by_tls_only_if_somebody_vouches_for_it(tmp_path, caplog) -> None:
    pem, key = certificate(tmp_path)
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    context.load_cert_chain(pem, key)
    site = load_site(write_site(tmp_path, tls={"ca_file": pem.name}))
    with saying(tls=context) as server:
        url = f"mqtts://localhost:{server.port}"
        assert len(heard(open_source(url, site.tls), 2)) == 2
        assert heard(open_source(url), 1, 0.7) == []
        assert any("certificate verify failed" in said for said in caplog.messages)
        caplog.clear()
        assert heard(Broker(f"mqtts://127.0.0.1:{server.port}", site.tls), 1, 0.7) == []  # its name
        assert any("certificate verify failed" in said for said in caplog.messages)
    with pytest.raises(ConfigError, match="certificate or key"):
        Broker(url, Tls(ca_file="/nowhere/ca.pem"))


@pytest.mark.parametrize("url", ["mqtt://", "mqtts://a:99999", "mqtt://a/b", "mqtt://:1"])
def test_an_address_that_is_none_is_refused(url) -> None:
    with pytest.raises(UsageError, match="expected mqtt"):
        open_source(url)


def test_silence_is_reported_every_second(tmp_path) -> None:
    async def first() -> bytes:
        lines = open_source(str(tmp_path / "events.jsonl")).lines()
        try:
            return (await anext(lines)).data
        finally:
            await lines.aclose()

    assert asyncio.run(asyncio.wait_for(first(), PATIENCE_S)) == b""


def test_others_have_their_turn_while_lines_wait(tmp_path) -> None:
    path = tmp_path / "events.jsonl"
    path.write_text((sensor("mid360", "ok") + "\n") * 3000)

    async def run() -> tuple[int, int]:
        turns = taken = 0

        async def other() -> None:
            nonlocal turns
            while True:
                turns += 1
                await asyncio.sleep(0)

        task = asyncio.ensure_future(other())
        lines = open_source(str(path)).lines()
        async for _ in lines:
            time.sleep(0.0002)  # work
            taken += 1
            if taken == 3000:
                break
        await lines.aclose()
        task.cancel()
        return turns, taken

    turns, taken = asyncio.run(run())
    assert taken == 3000
    assert turns >= 20  # one in 10 ms at least, of 600


def test_relays_of_one_name_can_be_distinguished() -> None:
    line = f'{row(1, 0.0)[:-1]},"instance":"of another","station":"x"}}'
    (message,) = Station(Site(station="north")).take(line)
    assert "instance" not in json.loads(message.text)
    topic, text, _ = encode(message)
    values = json.loads(text)
    assert topic == "unlidar/north/row"
    assert values["instance"].isalnum()
    assert values["station"] == "north"
    assert text.count('"instance"') == text.count('"station"') == 1
