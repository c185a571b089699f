"""Where events come from: a file that grows, stdin, or a server by TCP."""

import asyncio
import contextlib
import os
import sys
import threading
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO
from urllib.parse import urlsplit

from unlidar_tools.errors import InputError, UsageError, reason
from unlidar_tools.events.event import MOST_BYTES
from unlidar_tools.telling import note

_LOOK_S = 0.1  # how often a file is looked at
_CHUNK = 1 << 18
_RETRY_S = 0.5, 15.0
_DIAL_S = 10.0


@dataclass(frozen=True)
class Line:
    """A line of events, or None where the source has nothing more for the moment."""

    data: bytes
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

    def lines(self) -> AsyncIterator[Line]:
        """To be iterated once."""
        raise NotImplementedError


def open_source(text: str) -> Source:
    """By what the command line says: `-`, tcp://HOST:PORT, mqtt://HOST or a file.

    UsageError for what is none of these, InputError for a file in a folder that is not there.
    """
    if text == "-":
        return _Stdin("stdin")
    if text.startswith("mqtt://"):
        from unlidar_tools.events.broker import Broker  # which needs a package of its own

        return Broker(text)
    if "://" in text:
        url = urlsplit(text)
        try:
            host, port = url.hostname, url.port
        except ValueError:
            host = port = None
        if url.scheme != "tcp" or not host or not port or url.path.strip("/"):
            raise UsageError(f"'{text}', expected a file, -, tcp://HOST:PORT or mqtt://HOST")
        return _Tcp(text, host, port)
    path = Path(text)
    if path.is_dir() or not path.parent.is_dir():
        raise InputError(f"{path}: is no file of events and cannot become one")
    if path.is_fifo():
        return _Fifo(text, path)
    return _File(text, path)


class _File(Source):
    """Followed for ever, also to the file that takes its place (SIGHUP, logrotate).

    A file that does not exist yet is waited for.
    """

    def __init__(self, name: str, path: Path) -> None:
        super().__init__(name)
        self._path = path

    async def lines(self) -> AsyncIterator[Line]:
        # What lies in the first file is old; what replaces it, or appears later, is new.
        old_bytes = self._path.stat().st_size if self._path.exists() else 0
        while True:
            file = self._open()
            if file is None:
                await asyncio.sleep(_LOOK_S)
                continue
            with file:
                async for line in self._of(file, old_bytes):
                    yield line
            old_bytes = 0

    def _open(self) -> BinaryIO | None:
        try:
            return self._path.open("rb")
        except FileNotFoundError:
            return None
        except OSError as error:
            raise InputError(f"{self._path}: cannot be read: {reason(error)}") from error

    async def _of(self, file: BinaryIO, old_bytes: int) -> AsyncIterator[Line]:
        """The lines of one file until another one, or a shorter one, is in its place."""
        cut, done = Lines(), 0
        while True:
            replaced = self._replaced(file, done)  # before reading: what came until then is read
            try:
                # A piece is either old or new.
                data = file.read(min(_CHUNK, old_bytes - done) if done < old_bytes else _CHUNK)
            except OSError as error:
                raise InputError(f"{self._path}: cannot be read: {reason(error)}") from error
            done += len(data)
            for line in cut.take(data):
                yield Line(line, old=done <= old_bytes)
            if data:
                await asyncio.sleep(0)
            elif replaced:
                return
            else:
                await asyncio.sleep(_LOOK_S)

    def _replaced(self, file: BinaryIO, done: int) -> bool:
        try:
            now = self._path.stat()
        except OSError:
            return False  # moved away: the next one has not come yet
        mine = os.fstat(file.fileno())
        return (now.st_dev, now.st_ino) != (mine.st_dev, mine.st_ino) or mine.st_size < done


class _Stdin(Source):
    """A pipe or a file that ends. It is read as fast as it comes: no engine waits for us."""

    def _open(self) -> BinaryIO:
        if sys.stdin is None:
            raise InputError("stdin: is not open")
        return sys.stdin.buffer

    async def lines(self) -> AsyncIterator[Line]:
        loop = asyncio.get_running_loop()
        queue: asyncio.Queue[bytes | OSError] = asyncio.Queue(4)

        def read() -> None:
            # RuntimeError: nobody waits any more.
            with contextlib.suppress(RuntimeError):
                try:
                    with self._open() as stream:
                        while data := os.read(stream.fileno(), _CHUNK):
                            asyncio.run_coroutine_threadsafe(queue.put(data), loop).result()
                    asyncio.run_coroutine_threadsafe(queue.put(b""), loop).result()
                except OSError as error:
                    asyncio.run_coroutine_threadsafe(queue.put(error), loop).result()

        # Not of the loop's pool: at the end nobody must wait for what cannot be interrupted.
        threading.Thread(target=read, daemon=True).start()
        cut = Lines()
        while data := await queue.get():
            if isinstance(data, OSError):
                raise InputError(f"{self.name}: cannot be read: {reason(data)}") from data
            for line in cut.take(data):
                yield Line(line, old=False)
        for line in cut.take(b"\n"):
            yield Line(line, old=False)


class _Fifo(_Stdin):
    """A named pipe: ends when its writer leaves."""

    def __init__(self, name: str, path: Path) -> None:
        super().__init__(name)
        self._path = path

    def _open(self) -> BinaryIO:
        return self._path.open("rb", buffering=0)


class _Tcp(Source):
    """A server that sends events; one that leaves is called again."""

    def __init__(self, name: str, host: str, port: int) -> None:
        super().__init__(name)
        self._host, self._port = host, port

    async def lines(self) -> AsyncIterator[Line]:
        wait_s, told = _RETRY_S[0], False
        while True:
            try:
                dial = asyncio.open_connection(self._host, self._port)
                reader, writer = await asyncio.wait_for(dial, _DIAL_S)
                try:
                    cut = Lines()
                    while data := await reader.read(_CHUNK):
                        wait_s, told = _RETRY_S[0], False
                        for line in cut.take(data):
                            yield Line(line, old=False)
                    lost = "the connection was closed"
                finally:
                    writer.close()
            except (TimeoutError, OSError) as error:
                lost = reason(error)
            if not told:
                note(f"{self.name}: {lost}; it is tried again")
            told = True
            await asyncio.sleep(wait_s)
            wait_s = min(2 * wait_s, _RETRY_S[1])
