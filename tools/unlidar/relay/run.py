"""Forwarding from a source of events to all outputs."""

import asyncio
import contextlib
import signal
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from unlidar.addresses import LAST_WORDS_S, MQTT, Address, Scheme, read_address
from unlidar.errors import ConfigError, UsageError
from unlidar.events.event import Now, Returns, Row
from unlidar.events.site import Output as Wanted
from unlidar.events.site import Site, load_zones
from unlidar.events.source import Source
from unlidar.events.station import Message, Station
from unlidar.events.tls import tls_context
from unlidar.extras import need_station
from unlidar.relay.output import Output
from unlidar.reporting import note

if TYPE_CHECKING:
    from unlidar.relay.sapient.output import SapientOutput

_LOCAL = ("localhost", "127.0.0.1", "::1")
_COT = {"cot+udp": Scheme(), "cot+tcp": Scheme(), "cot+tls": Scheme()}
_SAPIENT = "sapient+tcp"
_SCHEMES = {**_COT, **MQTT, "ws": Scheme(token=True), _SAPIENT: Scheme()}
_EXPECTED = f"HOST:PORT after one of {', '.join(f'{scheme}://' for scheme in _SCHEMES)}"


@dataclass(frozen=True)
class Told:
    """Statistics of one output."""

    name: str
    reach: str  # meaning of "sent" for this output
    sent: int
    dropped: int
    waiting: int


class Way:
    """An output with its encoder."""

    def __init__(
        self,
        output: "Output | SapientOutput",
        encode: Callable[[Message], Any],
        learn: Callable[[Message], None] = lambda _: None,
        learned: Callable[[], None] = lambda: None,
    ) -> None:
        """`learn`: takes in what is not to be sent, as it is of before the start.

        `learned`: is called when that is over.
        """
        self.output, self._encode, self.learn, self.learned = output, encode, learn, learned

    def offer(self, message: Message) -> None:
        """Queues a message without waiting."""
        encoded = self._encode(message)
        if encoded is not None:
            self.output.offer(encoded, spare=isinstance(message.event, Row | Now))


def make_way(wanted: Wanted, site: Site) -> Way:
    """The output of an address. UsageError if invalid, ConfigError if the site lacks a key."""
    address = read_address(wanted.to, _SCHEMES, _EXPECTED)
    tls = tls_context(wanted, address.name) if address.scheme in ("cot+tls", "mqtts") else None
    if address.scheme in _COT:
        from unlidar.relay.cot import Encoder
        from unlidar.relay.sockets import StreamSender, UdpSender

        if site.origin is None:
            raise ConfigError(
                f"{address.name}: Cursor on Target needs the site's 'origin' (--site)"
            )
        if address.scheme == "cot+udp":
            sender = UdpSender(address.host, address.port)
        else:
            sender = StreamSender(address.host, address.port, tls)
        encoder = Encoder(site.origin, wanted.interval_s(address.scheme))
        return Way(Output(address.name, sender, wanted.room), encoder.encode)
    if address.scheme == _SAPIENT:
        return _sapient_way(address, wanted, site)
    if address.scheme in MQTT:
        from unlidar.relay.mqtt import MqttSender, encode

        sender = MqttSender(address.host, address.port, site, address.login, tls)
        return Way(Output(address.name, sender, wanted.room, sender.probe), encode)
    from unlidar.relay.web_socket import WebSocketSender

    if address.host not in _LOCAL and not address.token:
        raise UsageError(
            f"{address.name}: an address that others reach needs a token, expected /?token=SECRET "
            "behind it"
        )
    server = WebSocketSender(address.host, address.port, wanted.room, address.token, None)
    return Way(Output(address.name, server, wanted.room), lambda message: message.text)


def _sapient_way(address: Address, wanted: Wanted, site: Site) -> Way:
    need_station("relay", ("sapient_msg",))
    from unlidar.relay.sapient.output import SapientOutput

    if site.origin is None:
        raise ConfigError(f"{address.name}: SAPIENT needs the site's 'origin' (--site)")
    output = SapientOutput(
        address, site.station, site.origin, wanted.interval_s(address.scheme), wanted.node_id
    )
    return Way(output, lambda message: message, output.learn, output.learned)


async def relay(
    source: Source,
    site: Site,
    ways: Sequence[Way],
    all_of_it: bool,
    keep: Callable[[Message], None],
) -> list[Told]:
    """Forwards until the source ends or a signal arrives, then drains for a few seconds.

    Content of a file before the start sets up tracks and alarms but is not sent, unless
    `all_of_it`.
    """
    station = Station(site, load_zones(site), source.name, places=bool(ways))
    running = [asyncio.ensure_future(way.output.run()) for way in ways]

    async def take() -> None:
        is_learning = False
        async for line in source.lines():
            is_sent = all_of_it or not line.old
            if is_learning and is_sent:
                for way in ways:
                    way.learned()
            is_learning = not is_sent
            for message in station.take(line.data, placed=is_sent):
                keep(message)
                if isinstance(message.event, Returns):
                    continue  # for a page beside the engine
                if is_sent:
                    for way in ways:
                        way.offer(message)
                else:
                    for way in ways:
                        way.learn(message)

    try:
        taking = asyncio.ensure_future(take())
        await until_signal([taking, *running])
        if taking.done():
            taking.result()
        else:
            taking.cancel()
        await asyncio.gather(*(way.output.drain(LAST_WORDS_S) for way in ways))
    finally:
        for task in running:
            task.cancel()
        await asyncio.gather(*running, return_exceptions=True)
    told = [
        Told(o.name, o.reach, o.sent, o.dropped, o.waiting) for o in (way.output for way in ways)
    ]
    for output in told:
        left = f", {output.waiting} not" if output.waiting else ""
        out = f", {output.dropped} left out" if output.dropped else ""
        note(f"{output.name}: {output.sent} messages sent{left}{out} (sent: {output.reach})")
    return told


async def until_signal(tasks: Sequence[asyncio.Future]) -> None:
    """Returns when one of the tasks is done, or at SIGINT, SIGTERM or SIGHUP.

    Ignored signals stay ignored, as nohup expects of SIGHUP.
    """
    loop = asyncio.get_running_loop()
    stopped = asyncio.Event()
    stop = asyncio.ensure_future(stopped.wait())
    known = {n: signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    with contextlib.ExitStack() as undo:
        with contextlib.suppress(ValueError, RuntimeError):  # signals work in the main thread only
            for number, handler in known.items():
                if handler is signal.SIG_IGN:
                    continue
                loop.add_signal_handler(number, stopped.set)
                undo.callback(signal.signal, number, handler)
                undo.callback(loop.remove_signal_handler, number)
        await asyncio.wait({stop, *tasks}, return_when=asyncio.FIRST_COMPLETED)
    stop.cancel()
    for task in tasks[1:]:
        if task.done():
            task.result()
