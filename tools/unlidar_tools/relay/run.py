"""From a source of events to all outputs."""

import asyncio
import contextlib
import signal
import ssl
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any
from urllib.parse import SplitResult, parse_qs, unquote, urlsplit

from unlidar_tools.errors import ConfigError, UsageError, reason
from unlidar_tools.events.event import Row
from unlidar_tools.events.site import Output as Wanted
from unlidar_tools.events.site import Site, load_zones
from unlidar_tools.events.source import Source
from unlidar_tools.events.station import Message, Station
from unlidar_tools.relay.output import Output
from unlidar_tools.telling import note

_LAST_WORDS_S = 5.0
_LOCAL = ("localhost", "127.0.0.1", "::1")
_COT = {"cot+udp": None, "cot+tcp": None, "cot+tls": None}
_MQTT_PORTS = {"mqtt": 1883, "mqtts": 8883}
_SCHEMES = (*_COT, *_MQTT_PORTS, "ws")


@dataclass(frozen=True)
class Told:
    """What became of the messages for one output."""

    name: str
    sent: int
    dropped: int
    waiting: int


class Way:
    """An output with what it is told of a message."""

    def __init__(self, output: Output, encode: Callable[[Message], Any]) -> None:
        self.output, self._encode = output, encode

    def offer(self, message: Message) -> None:
        """Never waits."""
        encoded = self._encode(message)
        if encoded is not None:
            self.output.offer(encoded, spare=isinstance(message.event, Row))


def make_way(wanted: Wanted, site: Site) -> Way:
    """UsageError for an address that is none, ConfigError where the site lacks what it needs."""
    url, shown = _split(wanted.to)
    assert url.hostname is not None
    tls = _tls(wanted, shown) if url.scheme in ("cot+tls", "mqtts") else None
    if url.scheme in _COT:
        from unlidar_tools.relay.cot import Encoder, StreamSender, UdpSender

        if site.origin is None:
            raise ConfigError(f"{shown}: Cursor on Target needs the site's 'origin' (--site)")
        assert url.port is not None
        if url.scheme == "cot+udp":
            sender = UdpSender(url.hostname, url.port)
        else:
            sender = StreamSender(url.hostname, url.port, tls)
        encoder = Encoder(site.origin, wanted.every_s)
        return Way(Output(shown, sender, wanted.room), encoder.encode)
    if url.scheme in _MQTT_PORTS:
        from unlidar_tools.relay.mqtt import MqttSender, encode

        login = None
        if url.username:
            login = unquote(url.username), unquote(url.password) if url.password else None
        port = url.port or _MQTT_PORTS[url.scheme]
        sender = MqttSender(url.hostname, port, site, login, tls)
        return Way(Output(shown, sender, wanted.room), encode)
    from unlidar_tools.relay.web_socket import WebSocketSender

    token = parse_qs(url.query).get("token", [None])[0]
    if url.hostname not in _LOCAL and not token:
        raise UsageError(
            f"{shown}: an address that others reach needs a token: ws://HOST:PORT/?token=SECRET"
        )
    assert url.port is not None
    server = WebSocketSender(url.hostname, url.port, wanted.room, token, None)
    return Way(Output(shown, server, wanted.room), lambda message: message.text)


async def relay(
    source: Source,
    site: Site,
    ways: Sequence[Way],
    all_of_it: bool,
    keep: Callable[[Message], None],
) -> list[Told]:
    """Until the source or a signal ends it; then what waits has a few seconds to leave.

    What a file held before is kept, and not sent, unless `all_of_it`: it tells which tracks and
    alarms there are.
    """
    station = Station(site, load_zones(site), source.name, places=bool(ways))
    running = [asyncio.ensure_future(way.output.run()) for way in ways]

    async def take() -> None:
        async for line in source.lines():
            for message in station.take(line.data):
                keep(message)
                if not line.old or all_of_it:
                    for way in ways:
                        way.offer(message)

    try:
        taking = asyncio.ensure_future(take())
        await until_signal([taking, *running])
        if taking.done():
            taking.result()
        else:
            taking.cancel()
        await asyncio.gather(*(way.output.drain(_LAST_WORDS_S) for way in ways))
    finally:
        for task in running:
            task.cancel()
        await asyncio.gather(*running, return_exceptions=True)
    told = [Told(o.name, o.sent, o.dropped, o.waiting) for o in (way.output for way in ways)]
    for output in told:
        left = f", {output.waiting} not" if output.waiting else ""
        out = f", {output.dropped} left out" if output.dropped else ""
        note(f"{output.name}: {output.sent} messages sent{left}{out}")
    return told


async def until_signal(tasks: Sequence[asyncio.Future]) -> None:
    """Returns when one of the tasks is done, or at SIGINT or SIGTERM."""
    loop = asyncio.get_running_loop()
    stopped = asyncio.Event()
    stop = asyncio.ensure_future(stopped.wait())
    numbers = signal.SIGINT, signal.SIGTERM
    before = [signal.getsignal(number) for number in numbers]
    with contextlib.ExitStack() as undo:
        with contextlib.suppress(ValueError, RuntimeError):  # not the main thread: no signals here
            for number, handler in zip(numbers, before, strict=True):
                loop.add_signal_handler(number, stopped.set)
                undo.callback(signal.signal, number, handler)
                undo.callback(loop.remove_signal_handler, number)
        await asyncio.wait({stop, *tasks}, return_when=asyncio.FIRST_COMPLETED)
    stop.cancel()
    for task in tasks[1:]:
        if task.done():
            task.result()


def _split(text: str) -> tuple[SplitResult, str]:
    """An address, and how it is shown: without its secrets."""
    url = urlsplit(text)
    try:
        host, port = url.hostname, url.port
    except ValueError:
        host = port = None
    if url.scheme not in _SCHEMES or not host or (port is None and url.scheme not in _MQTT_PORTS):
        schemes = ", ".join(f"{scheme}://" for scheme in _SCHEMES)
        raise UsageError(f"'{text}', expected HOST:PORT after one of {schemes}")
    named = f"[{host}]" if ":" in host else host
    return url, f"{url.scheme}://{named}" + (f":{port}" if port is not None else "")


def _tls(wanted: Wanted, shown: str) -> ssl.SSLContext:
    from unlidar_tools.relay.cot import tls_context

    try:
        return tls_context(wanted)
    except (OSError, ssl.SSLError) as error:
        raise ConfigError(f"{shown}: certificate or key: {reason(error)}") from error
