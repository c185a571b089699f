"""Lines of events, independent of their source."""

import asyncio
import time
from collections.abc import AsyncIterator
from dataclasses import dataclass

from unlidar.events.event import MOST_BYTES
from unlidar.names import check_name

SKY = "sky"  # reserved name of the fused picture: its tracks are drones of all stations
QUIET_S = 1.0
_SLICE_S = 0.01  # then control returns to the event loop


@dataclass(frozen=True)
class Published:
    """A message of a broker: the topic, not the text, identifies the sender."""

    station: str
    text: bytes
    gone: bool  # the station's relay has left
    retained: bool  # from before the subscription


def check_station(name: object) -> str:
    """The name itself; ValueError unless it can be that of one of several stations."""
    if not isinstance(name, str) or check_name(name) == SKY:
        raise ValueError(f"station '{name}', expected another name"[:200])
    return name


@dataclass(frozen=True)
class Line:
    """A line of events; an empty one after each silent second, so that ages advance."""

    data: bytes | Published
    old: bool  # present before the start


class Lines:
    """Splits bytes into lines; a too long line is passed on once, truncated, to be rejected."""

    def __init__(self) -> None:
        self._rest = b""
        self._skipping = False

    def take(self, data: bytes) -> list[bytes]:
        """The completed, non-empty lines."""
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
    """A finite or endless series of lines."""

    many = False  # True if lines come from several stations and name them

    def __init__(self, name: str) -> None:
        self.name = name

    async def lines(self) -> AsyncIterator[Line]:
        """Iterates the lines, once; yields to the event loop regularly, also under load."""
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
        """Yields batches of lines as they arrive."""
        raise NotImplementedError
