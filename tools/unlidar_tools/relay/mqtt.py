"""MQTT: topics unlidar/STATION/KIND at QoS 1, states retained, a last will."""

import asyncio
import contextlib
import json
import ssl
from collections.abc import Sequence
from dataclasses import asdict

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion
from paho.mqtt.reasoncodes import ReasonCode

from unlidar_tools.events.broker import OFFLINE, PREFIX, RELAY, SITE
from unlidar_tools.events.event import EngineState, SensorState
from unlidar_tools.events.site import Site
from unlidar_tools.events.station import Message

ONLINE = "online"
_QOS = 1
_ANSWER_S = 10.0
_KEEPALIVE_S = 15

Publication = tuple[str, str, bool]  # topic, text, retained


def encode(message: Message) -> Publication:
    """Who comes later still gets the states."""
    topic = f"{PREFIX}/{message.station}/{message.kind}"
    if isinstance(message.event, SensorState):
        return f"{topic}/{_level(message.event.name)}", message.text, True
    return topic, message.text, isinstance(message.event, EngineState)


class MqttSender:
    """A broker. What was published and not acknowledged is published again."""

    def __init__(
        self,
        host: str,
        port: int,
        site: Site,
        login: tuple[str, str | None] | None,
        tls: ssl.SSLContext | None,
    ) -> None:
        self._host, self._port, self._login, self._tls = host, port, login, tls
        self._state_topic = f"{PREFIX}/{site.station}/{RELAY}"
        self._first: list[Publication] = [(self._state_topic, ONLINE, True)]
        if site.origin is not None:
            told = {"event": SITE, "station": site.station, "origin": asdict(site.origin)}
            self._first.append((f"{PREFIX}/{site.station}/{SITE}", json.dumps(told), True))
        self._client: paho.Client | None = None
        self._lost: asyncio.Future[None] | None = None

    async def connect(self) -> None:
        """OSError where there is no broker or it refuses us."""
        loop = asyncio.get_running_loop()
        client = paho.Client(CallbackAPIVersion.VERSION2, reconnect_on_failure=False)
        client.max_inflight_messages_set(0)  # bounded by what `send` is given
        if self._login is not None:
            client.username_pw_set(*self._login)
        if self._tls is not None:
            client.tls_set_context(self._tls)
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
            with contextlib.suppress(RuntimeError):  # the loop has ended
                loop.call_soon_threadsafe(settle, future, code)

        client.on_connect = lambda _c, _u, _f, code, _p: tell(connected, code)
        client.on_disconnect = lambda _c, _u, _f, code, _p: tell(lost, code)
        self._client, self._lost = client, lost
        # Its own call waits for the name and the answer of the system.
        await loop.run_in_executor(
            None, lambda: client.connect(self._host, self._port, _KEEPALIVE_S)
        )
        client.loop_start()
        done, _ = await asyncio.wait(
            {connected, lost}, timeout=_ANSWER_S, return_when=asyncio.FIRST_COMPLETED
        )
        if not done:
            raise ConnectionError(f"no answer within {_ANSWER_S:g} s")
        (connected if connected.done() else lost).result()
        await self.send(self._first)

    async def send(self, messages: Sequence[Publication]) -> None:
        """Returns when the broker has acknowledged all."""
        assert self._client is not None
        waiting = [
            self._client.publish(topic, text, _QOS, retain) for topic, text, retain in messages
        ]
        end_s = asyncio.get_running_loop().time() + _ANSWER_S
        for info in waiting:
            # Acknowledged in order: when the last one is, nobody waits.
            while info.rc == paho.MQTT_ERR_SUCCESS and not info.is_published():
                if asyncio.get_running_loop().time() > end_s or not self._client.is_connected():
                    raise ConnectionError("did not acknowledge")
                await asyncio.sleep(0.002)
            if info.rc != paho.MQTT_ERR_SUCCESS:
                raise ConnectionError(paho.error_string(info.rc))

    async def lost(self) -> None:
        """When the broker leaves."""
        assert self._lost is not None
        await asyncio.shield(self._lost)

    async def close(self) -> None:
        """With a word to those who listen, where that is still possible."""
        client, self._client = self._client, None
        if client is None:
            return
        if client.is_connected():
            client.publish(self._state_topic, OFFLINE, _QOS, retain=True)
            client.disconnect()
        await asyncio.get_running_loop().run_in_executor(None, client.loop_stop)
        if self._lost is not None and self._lost.done():
            self._lost.exception()  # it was seen


def _level(name: str) -> str:
    """A name as a level of a topic."""
    return "".join("_" if c in "/+#\0" else c for c in name)
