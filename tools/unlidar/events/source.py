"""Sources of events: a growing file, stdin, a TCP server, or a broker."""

import asyncio
import contextlib
import os
import stat
import sys
import threading
from collections.abc import AsyncIterator
from concurrent.futures import CancelledError
from pathlib import Path
from typing import BinaryIO

from unlidar.addresses import DIAL_S, Scheme, read_address
from unlidar.errors import InputError, reason
from unlidar.events.bygone import Bygone
from unlidar.events.lines import Line, Lines, Source
from unlidar.events.site import Tls
from unlidar.reporting import RateLimitedNote, note

_LOOK_S = 0.02  # polling interval of a file
_CHUNK = 1 << 18
_RETRY_S = 0.5, 15.0
_EXPECTED = "a file, -, tcp://HOST:PORT or mqtt[s]://HOST"


def open_source(text: str, tls: Tls | None = None, whole: bool = True) -> Source:
    """The source of a command line argument: `-`, tcp://HOST:PORT, mqtt[s]://HOST or a file.

    `tls`: for a broker; None: the system's trust store. Unless `whole`, what a file held before is
    read without what matters no more.

    UsageError for any other text, InputError for a file in a missing folder.
    """
    if text == "-":
        return _Stdin("stdin")
    if text.startswith(("mqtt://", "mqtts://")):
        from unlidar.events.broker import Broker  # needs the extra `station`

        return Broker(text, tls)
    if "://" in text:
        address = read_address(text, {"tcp": Scheme()}, _EXPECTED)
        return _Tcp(address.name, address.host, address.port)
    path = Path(text)
    if path.is_dir() or not path.parent.is_dir():
        raise InputError(f"{path}: is no file of events and cannot become one")
    if path.is_fifo():
        return _Fifo(text, path)
    return _File(text, path, whole)


def follow_file(path: Path) -> Source:
    """The file of a program that may not have been started yet, nor made its folder.

    InputError for what is no file.
    """
    if path.exists() and not path.is_file():
        raise InputError(f"{path}: is no file of events")
    return _File(str(path), path, whole=True)


class _File(Source):
    """Follows a file for ever, also across replacement (SIGHUP, logrotate).

    Waits for a file that does not exist yet.
    """

    def __init__(self, name: str, path: Path, whole: bool) -> None:
        super().__init__(name)
        self._path = path
        self._whole = whole
        self._failed = RateLimitedNote(f"{path}: cannot be read, it is tried again")

    async def _read(self) -> AsyncIterator[list[Line]]:
        # Content present at the start is old; a file that replaces it or appears later is new.
        old_bytes = self._path.stat().st_size if self._path.exists() else 0
        if self._path.exists():
            self._check()
        while True:
            try:
                file = self._open()
            except FileNotFoundError:
                await asyncio.sleep(_LOOK_S)
                continue
            except OSError as error:  # a replacement may not be readable yet
                self._failed(reason(error))
                await asyncio.sleep(_RETRY_S[0])
                continue
            with file:
                async for lines in self._of(file, old_bytes):
                    yield lines
            old_bytes = 0

    def _check(self) -> None:
        """InputError at the start, where an unreadable file is a mistake."""
        try:
            with self._open() as file:
                file.read(1)
        except FileNotFoundError:
            pass
        except OSError as error:
            raise InputError(f"{self._path}: cannot be read: {reason(error)}") from error

    def _open(self) -> BinaryIO:
        """Opens without blocking: the file may have been replaced by a pipe without a writer."""
        file = open(  # noqa: SIM115 - the caller's
            self._path, "rb", opener=lambda path, flags: os.open(path, flags | os.O_NONBLOCK)
        )
        if stat.S_ISFIFO(os.fstat(file.fileno()).st_mode):
            file.close()
            raise OSError("is a pipe")
        return file

    async def _of(self, file: BinaryIO, old_bytes: int) -> AsyncIterator[list[Line]]:
        """The lines of one file until it is replaced or truncated."""
        bygone = await self._bygone(file, old_bytes)
        cut, done = Lines(), 0
        while True:
            replaced = self._replaced(file, done)  # before reading, so the rest is read
            try:
                # Old and new content is never mixed in a piece.
                data = file.read(min(_CHUNK, old_bytes - done) if done < old_bytes else _CHUNK)
            except OSError as error:
                self._failed(reason(error))
                data = b""
            if data:
                done += len(data)
                is_old, lines = done <= old_bytes, cut.take(data)
                if is_old and bygone is not None:
                    lines = bygone.rest(lines)
                yield [Line(line, old=is_old) for line in lines]
                continue
            if replaced:
                return
            await asyncio.sleep(_LOOK_S)

    async def _bygone(self, file: BinaryIO, old_bytes: int) -> Bygone | None:
        if self._whole or not old_bytes:
            return None
        try:
            return await asyncio.to_thread(Bygone, file, old_bytes)
        except OSError as error:
            self._failed(reason(error))
            return None
        finally:
            file.seek(0)

    def _replaced(self, file: BinaryIO, done: int) -> bool:
        try:
            now = self._path.stat()
        except OSError:
            return False  # moved away, not replaced yet
        mine = os.fstat(file.fileno())
        return (now.st_dev, now.st_ino) != (mine.st_dev, mine.st_ino) or mine.st_size < done


class _Stdin(Source):
    """A pipe or a finite file, read without delay so that the engine never blocks."""

    def _open(self) -> BinaryIO:
        if sys.stdin is None:
            raise InputError("stdin: is not open")
        return sys.stdin.buffer

    async def _read(self) -> AsyncIterator[list[Line]]:
        loop = asyncio.get_running_loop()
        queue: asyncio.Queue[bytes | OSError] = asyncio.Queue(4)

        def read() -> None:
            # The event loop is closed, or takes nothing more.
            with contextlib.suppress(RuntimeError, CancelledError):
                try:
                    with self._open() as stream:
                        while data := os.read(stream.fileno(), _CHUNK):
                            asyncio.run_coroutine_threadsafe(queue.put(data), loop).result()
                    asyncio.run_coroutine_threadsafe(queue.put(b""), loop).result()
                except OSError as error:
                    asyncio.run_coroutine_threadsafe(queue.put(error), loop).result()

        # A daemon thread, not the loop's pool: a blocking read must not delay the exit.
        threading.Thread(target=read, daemon=True).start()
        cut = Lines()
        while data := await queue.get():
            if isinstance(data, OSError):
                raise InputError(f"{self.name}: cannot be read: {reason(data)}") from data
            yield _new(cut.take(data))
        yield _new(cut.take(b"\n"))


class _Fifo(_Stdin):
    """A named pipe; ends with its writer."""

    def __init__(self, name: str, path: Path) -> None:
        super().__init__(name)
        self._path = path

    def _open(self) -> BinaryIO:
        return self._path.open("rb", buffering=0)


class _Tcp(Source):
    """A TCP server that sends events; reconnects."""

    def __init__(self, name: str, host: str, port: int) -> None:
        super().__init__(name)
        self._host, self._port = host, port

    async def _read(self) -> AsyncIterator[list[Line]]:
        wait_s, told = _RETRY_S[0], False
        while True:
            try:
                dial = asyncio.open_connection(self._host, self._port)
                reader, writer = await asyncio.wait_for(dial, DIAL_S)
                try:
                    cut = Lines()
                    while data := await reader.read(_CHUNK):
                        wait_s, told = _RETRY_S[0], False
                        yield _new(cut.take(data))
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


def _new(lines: list[bytes]) -> list[Line]:
    return [Line(line, old=False) for line in lines]
