"""Events of many stations from an MQTT broker, as `unlidar relay` publishes them."""

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator
from urllib.parse import unquote, urlsplit

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion

from unlidar_tools.errors import UsageError, reason
from unlidar_tools.events.event import MOST_BYTES
from unlidar_tools.events.source import Line, Source
from unlidar_tools.telling import Often, note

PREFIX = "unlidar"
RELAY, SITE = "relay", "site"  # topics of whether a relay is there, and of where its station stands
OFFLINE = "offline"
_PORT = 1883
_WAIT_S = 1, 15
_MOST_WAITING = 20_000


class Broker(Source):
    """Subscribes to every station; a broker that leaves is called again.

    A relay's good-bye becomes the line {"event":"gone","station":...}.
    """

    many = True

    def __init__(self, text: str) -> None:
        """UsageError for an address that is none."""
        url = urlsplit(text)
        try:
            self._host, self._port = url.hostname, url.port or _PORT
        except ValueError:
            self._host = None
        if not self._host or url.path.strip("/"):
            raise UsageError(f"'{text}', expected mqtt://[USER:PASSWORD@]HOST[:PORT]")
        super().__init__(f"mqtt://{self._host}:{self._port}")
        self._login = unquote(url.username or ""), unquote(url.password or "") or None

    async def lines(self) -> AsyncIterator[Line]:
        """For ever."""
        loop = asyncio.get_running_loop()
        queue: asyncio.Queue[bytes] = asyncio.Queue()
        dropped = Often(f"{self.name}: more comes than can be taken in, a message is left out")
        client = paho.Client(CallbackAPIVersion.VERSION2)
        client.reconnect_delay_set(*_WAIT_S)
        if self._login[0]:
            client.username_pw_set(*self._login)
        client.on_connect = lambda c, *_: c.subscribe(f"{PREFIX}/+/#", qos=1)
        client.on_disconnect = lambda _c, _u, _f, code, _p: (
            note(f"{self.name}: {code}; it is tried again") if code != 0 else None
        )

        def come(_client: paho.Client, _user: object, message: paho.MQTTMessage) -> None:
            line = _line(message.topic, message.payload)
            if queue.qsize() >= _MOST_WAITING:
                dropped(f"{_MOST_WAITING} wait")
            elif line is not None:
                with contextlib.suppress(RuntimeError):  # the loop has ended
                    loop.call_soon_threadsafe(queue.put_nowait, line)

        client.on_message = come
        try:
            client.connect_async(self._host, self._port)
            client.loop_start()
            while True:
                yield Line(await queue.get(), old=False)
        except (OSError, ValueError) as error:
            raise UsageError(f"{self.name}: {reason(error)}") from error
        finally:
            client.disconnect()
            await loop.run_in_executor(None, client.loop_stop)


def _line(topic: str, payload: bytes) -> bytes | None:
    """What is said of a station, None of what is of no use here."""
    station, _, kind = topic.removeprefix(f"{PREFIX}/").partition("/")
    if len(payload) > MOST_BYTES:
        return None
    if kind == RELAY:
        gone = {"event": "gone", "station": station}
        return json.dumps(gone).encode() if payload == OFFLINE.encode() else None
    return payload
