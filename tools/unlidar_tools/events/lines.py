"""Lines of events, wherever they come from."""

import asyncio
import time
from collections.abc import AsyncIterator
from dataclasses import dataclass

from unlidar_tools.events.event import MOST_BYTES
from unlidar_tools.names import check_name

SKY = "sky"  # the name of the station that no one is: its tracks are drones of all
QUIET_S = 1.0
_SLICE_S = 0.01  # then others in the loop have their turn


@dataclass(frozen=True)
class Published:
    """A message of a broker: whose topic it is tells who speaks, whatever the text says."""

    station: str
    text: bytes
    gone: bool  # the station's relay has left
    retained: bool  # said before we came


def check_station(name: object) -> str:
    """The name itself; ValueError unless it can be that of one of several stations."""
    if not isinstance(name, str) or check_name(name) == SKY:
        raise ValueError(f"station '{name}', expected another name"[:200])
    return name


@dataclass(frozen=True)
class Line:
    """A line of events; empty where none has come for a second, as time passes all the same."""

    data: bytes | Published
    old: bool  # it was there before we came


class Lines:
    """Cuts bytes into lines; one that is too long is handed on once, cut short, to be refused."""

    def __init__(self) -> None:
        self._rest = b""
        self._skipping = False

    def take(self, data: bytes) -> list[bytes]:
        """The lines that are whole now; empty ones are left out."""
        *whole, self._rest = (self._rest + data).split(b"\n")
        if whole and self._skipping:
            self._skipping = False
            whole[0] = b""
        if len(self._rest) > MOST_BYTES:
            if not self._skipping:
                whole.append(self._rest[: MOST_BYTES + 1])
            self._skipping = True
            self._rest = b""
        return [line for line in whole if line.strip()]


class Source:
    """An endless or ending series of lines."""

    many = False  # the lines name their stations, of which there are several

    def __init__(self, name: str) -> None:
        self.name = name

    async def lines(self) -> AsyncIterator[Line]:
        """To be iterated once. Leaves the loop to others again and again, however much waits."""
        read = self._read()
        coming = asyncio.ensure_future(anext(read))
        try:
            begun_s = time.monotonic()
            while True:
                if not (await asyncio.wait({coming}, timeout=QUIET_S))[0]:
                    yield Line(b"", old=False)
                    continue
                try:
                    lines = coming.result()
                except StopAsyncIteration:
                    return
                coming = asyncio.ensure_future(anext(read))
                for line in lines:
                    yield line
                    if time.monotonic() - begun_s > _SLICE_S:
                        await asyncio.sleep(0)
                        begun_s = time.monotonic()
        finally:
            coming.cancel()
            await asyncio.wait({coming})
            await read.aclose()

    def _read(self) -> AsyncIterator[list[Line]]:
        """Some lines at a time, as they come."""
        raise NotImplementedError
