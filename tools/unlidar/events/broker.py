"""Events of many stations from an MQTT broker, as `unlidar relay` publishes them."""

import asyncio
import contextlib
import threading
from collections.abc import AsyncIterator, Callable

import paho.mqtt.client as paho
from paho.mqtt.reasoncodes import ReasonCode

from unlidar.addresses import MQTT, read_address
from unlidar.errors import reason
from unlidar.events.event import MOST_BYTES
from unlidar.events.fair import FairQueue
from unlidar.events.lines import Line, Published, Source, check_station
from unlidar.events.mqtt import KEEPALIVE_S, make_client
from unlidar.events.site import Tls
from unlidar.events.tls import tls_context
from unlidar.reporting import RateLimitedNote

PREFIX = "unlidar"
RELAY, SITE = "relay", "site"  # topics of a relay's presence and of its station's place
OFFLINE = "offline"
_WAIT_S = 1.0, 15.0
_LAST_WORDS_S = 2.0
# Queue of one station; a relay that reconnects publishes 10,000 messages at once.
_MOST_WAITING, _MOST_WAITING_BYTES = 12_000, 8_000_000
_MOST_SENDERS = 256
_OVERHEAD_BYTES = 400  # memory of a message beside its text
_SHARE = 64  # messages passed on at once


class Broker(Source):
    """Subscribes to all stations of a broker; reconnects."""

    many = True

    def __init__(self, text: str, tls: Tls | None = None) -> None:
        """UsageError for an invalid address, ConfigError for unreadable TLS files."""
        address = read_address(text, MQTT, "mqtt[s]://[USER:PASSWORD@]HOST[:PORT]")
        super().__init__(address.name)
        self._address = address
        self._tls = tls_context(tls or Tls(), self.name) if address.scheme == "mqtts" else None

    async def _read(self) -> AsyncIterator[list[Line]]:
        """Yields messages for ever."""
        loop = asyncio.get_running_loop()
        filled = asyncio.Event()
        listener = _Listener(self, lambda: loop.call_soon_threadsafe(filled.set))
        listener.start()
        try:
            while True:
                await filled.wait()
                filled.clear()
                while messages := listener.queue.take(_SHARE):
                    yield [Line(message, old=message.retained) for message in messages]
        finally:
            listener.end()
            await loop.run_in_executor(None, listener.join, _LAST_WORDS_S)

    def call(self) -> paho.Client:
        """Returns a connected client. OSError, also for TLS."""
        client = make_client(self._address.login, self._tls)
        client.connect(self._address.host, self._address.port, KEEPALIVE_S)
        return client


class _Listener(threading.Thread):
    """Thread that receives from a broker, across malformed packets and lost connections."""

    def __init__(self, broker: Broker, filled: Callable[[], object]) -> None:
        super().__init__(daemon=True)
        self.queue: FairQueue[Published] = FairQueue(
            _MOST_SENDERS,
            _MOST_WAITING,
            _MOST_WAITING_BYTES,
            lambda station: self._dropped(f"{station}: more comes than can be taken in"),
        )
        self._broker, self._filled = broker, filled
        self._client: paho.Client | None = None
        self._ended = threading.Event()
        self._wait_s = _WAIT_S[0]
        self._why = ""
        self._lost = RateLimitedNote(f"{broker.name}: is tried again")
        self._dropped = RateLimitedNote(f"{broker.name}: a message is left out")

    def end(self) -> None:
        """Asks the thread to stop."""
        self._ended.set()
        if (client := self._client) is not None:
            client.disconnect()

    def run(self) -> None:
        """Receives until stopped."""
        while not self._ended.is_set():
            self._why = ""
            try:
                self._client = client = self._broker.call()
                client.on_connect = lambda c, _u, _f, code, _p: self._subscribe(c, code)
                client.on_subscribe = lambda c, _u, _m, codes, _p: self._subscribed(c, codes)
                client.on_disconnect = lambda _c, _u, _f, code, _p: self._leave(code)
                client.on_message = lambda _c, _u, message: self._take(message)
                client.loop_forever()
            except Exception as error:  # paho raises anything on malformed packets
                self._why = reason(error)
            if not self._ended.is_set():
                self._lost(self._why or "the connection was closed")
                self._ended.wait(self._wait_s)
                self._wait_s = min(2 * self._wait_s, _WAIT_S[1])

    def _subscribe(self, client: paho.Client, code: ReasonCode) -> None:
        if code.is_failure:
            self._why = f"refuses us: {code}"
            return
        self._wait_s = _WAIT_S[0]
        client.subscribe(f"{PREFIX}/+/#", qos=1)

    def _subscribed(self, client: paho.Client, codes: list[ReasonCode]) -> None:
        if any(code.is_failure for code in codes):
            self._why = f"does not let us read {PREFIX}/#"
            client.disconnect()

    def _leave(self, code: ReasonCode) -> None:
        if code.is_failure:
            self._why = self._why or str(code)

    def _take(self, message: paho.MQTTMessage) -> None:
        try:
            topic = message.topic
        except UnicodeDecodeError:
            self._dropped("its topic is no UTF-8")
            return
        _, _, rest = topic.partition("/")
        station, _, kind = rest.partition("/")
        gone = kind == RELAY and message.payload == OFFLINE.encode()
        if kind == RELAY and not gone:
            return
        if len(message.payload) > MOST_BYTES:
            self._dropped(f"{topic[:80]}: has {len(message.payload)} bytes")
            return
        try:
            told = Published(check_station(station), message.payload, gone, message.retain)
        except ValueError as error:
            self._dropped(str(error)[:200])
            return
        self.queue.put(station, told, len(message.payload) + _OVERHEAD_BYTES)
        with contextlib.suppress(RuntimeError):  # the event loop is closed
            self._filled()
