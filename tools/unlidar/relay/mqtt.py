"""MQTT: topics unlidar/STATION/KIND at QoS 1, states retained, a last will."""

import asyncio
import contextlib
import json
import secrets
import ssl
from collections.abc import Callable, Sequence
from dataclasses import asdict

import paho.mqtt.client as paho
from paho.mqtt.reasoncodes import ReasonCode

from unlidar.events.broker import OFFLINE, PREFIX, RELAY, SITE
from unlidar.events.event import EngineState, SensorState, extended
from unlidar.events.mqtt import KEEPALIVE_S, Login, make_client
from unlidar.events.site import Site
from unlidar.events.station import INSTANCE, Message
from unlidar.names import topic_level

ONLINE = "online"
_INSTANCE = secrets.token_hex(8)  # distinguishes two relays of one name from one that reconnects
_QOS = 1
_ANSWER_S = 10.0
_GREET_S = 1.0

Publication = tuple[str, str, bool]  # topic, text, retained


def encode(message: Message) -> Publication:
    """The publications of a message; states are retained for later subscribers."""
    text = extended(message.text, {INSTANCE: _INSTANCE})
    topic = f"{PREFIX}/{message.station}/{message.kind}"
    if isinstance(message.event, SensorState):
        return f"{topic}/{topic_level(message.event.name)}", text, True
    return topic, text, isinstance(message.event, EngineState)


class MqttSender:
    """Publishes to a broker; unacknowledged messages are published again."""

    reach = "acknowledged by the broker"

    def __init__(
        self,
        host: str,
        port: int,
        site: Site,
        login: Login | None,
        tls: ssl.SSLContext | None,
    ) -> None:
        self._host, self._port, self._login, self._tls = host, port, login, tls
        self._state_topic = f"{PREFIX}/{site.station}/{RELAY}"
        told = {"event": SITE, "station": site.station, INSTANCE: _INSTANCE}
        if site.origin is not None:
            told["origin"] = asdict(site.origin)
        self.probe: Publication = self._state_topic, ONLINE, True
        self._greeting = [
            self.probe,
            (f"{PREFIX}/{site.station}/{SITE}", json.dumps(told), True),
        ]
        self._client: paho.Client | None = None
        self._lost: asyncio.Future[None] | None = None
        self._greet_later: asyncio.TimerHandle | None = None
        self._is_greeted = False
        self._broke = False  # True if the connection broke with the last message

    async def connect(self) -> None:
        """Connects. OSError if there is no broker or it refuses."""
        loop = asyncio.get_running_loop()
        client = make_client(self._login, self._tls)
        client.max_inflight_messages_set(0)  # bounded by the caller of `send`
        client.will_set(self._state_topic, OFFLINE, _QOS, retain=True)
        connected: asyncio.Future[None] = loop.create_future()
        lost: asyncio.Future[None] = loop.create_future()

        def settle(future: asyncio.Future[None], code: ReasonCode | int) -> None:
            if future.done():
                return
            if code == 0:
                future.set_result(None)
            else:
                future.set_exception(ConnectionError(f"{code}"))

        def tell(future: asyncio.Future[None], code: ReasonCode | int) -> None:
            with contextlib.suppress(RuntimeError):  # the event loop is closed
                loop.call_soon_threadsafe(settle, future, code)

        client.on_connect = lambda _c, _u, _f, code, _p: tell(connected, code)
        client.on_disconnect = lambda _c, _u, _f, code, _p: tell(lost, code)
        self._client, self._lost = client, lost
        # In a thread: paho's connect blocks on name resolution and connection.
        await loop.run_in_executor(
            None, lambda: client.connect(self._host, self._port, KEEPALIVE_S)
        )
        client.loop_start()
        done, _ = await asyncio.wait(
            {connected, lost}, timeout=_ANSWER_S, return_when=asyncio.FIRST_COMPLETED
        )
        if not done:
            raise ConnectionError(f"no answer within {_ANSWER_S:g} s")
        (connected if connected.done() else lost).result()
        self._is_greeted = False
        # Once: a link that breaks after a message or two would otherwise carry greetings only.
        if self._broke:
            self._greet_later = loop.call_later(_GREET_S, self._greet)
        else:
            self._greet()

    async def send(self, messages: Sequence[Publication], arrived: Callable[[], None]) -> None:
        """Publishes messages; returns when the broker has acknowledged all."""
        self._broke = True
        await self._publish(messages, arrived)
        self._broke = False
        self._greet()

    def _greet(self) -> None:
        """Publishes presence and place, once per connection; repeated if not acknowledged."""
        if self._client is not None and not self._is_greeted:
            self._is_greeted = True
            for topic, text, retain in self._greeting:
                self._client.publish(topic, text, _QOS, retain)

    async def _publish(self, messages: Sequence[Publication], arrived: Callable[[], None]) -> None:
        assert self._client is not None
        waiting = [
            self._client.publish(topic, text, _QOS, retain) for topic, text, retain in messages
        ]
        clock = asyncio.get_running_loop().time
        for info in waiting:
            # Acknowledgements are in order, so the last one completes the batch.
            end_s = clock() + _ANSWER_S
            while info.rc == paho.MQTT_ERR_SUCCESS and not info.is_published():
                if clock() > end_s or not self._client.is_connected():
                    raise ConnectionError("did not acknowledge")
                await asyncio.sleep(0.002)
            if info.rc != paho.MQTT_ERR_SUCCESS:
                raise ConnectionError(paho.error_string(info.rc))
            arrived()

    async def lost(self) -> None:
        """Returns when the connection is lost."""
        assert self._lost is not None
        await asyncio.shield(self._lost)

    async def close(self) -> None:
        """Publishes the absence, if still possible, and disconnects."""
        client, self._client = self._client, None
        if self._greet_later is not None:
            self._greet_later.cancel()
        if client is None:
            return
        if client.is_connected():
            client.publish(self._state_topic, OFFLINE, _QOS, retain=True)
            client.disconnect()
        await asyncio.get_running_loop().run_in_executor(None, client.loop_stop)
        if self._lost is not None and self._lost.done():
            self._lost.exception()  # mark the exception as retrieved
