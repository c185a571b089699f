"""A connection to a middleware: messages with their length before them, and their stamps."""

import asyncio
import contextlib
import socket
import struct
import time
from collections.abc import Sequence
from itertools import islice

from google.protobuf.message import DecodeError, Message
from sapient_msg.bsi_flex_335_v2_0.error_pb2 import Error
from sapient_msg.bsi_flex_335_v2_0.sapient_message_pb2 import SapientMessage

from unlidar.addresses import DIAL_S
from unlidar.relay.deadline import deadline
from unlidar.relay.sapient.rules import faults
from unlidar.reporting import RateLimitedNote

_LENGTH = struct.Struct("<I")
_MOST_BYTES = 1 << 18  # of a message that comes; those for a node are far smaller
_MOST_FAULTS = 3  # that are told
_MOST_RETURNED = 4096  # of a message that is not understood, in the answer to it
_MOST_UNSENT = 4096  # bytes in the system that the other machine has no room for
_REST_S = 0.01  # between two messages that come, or as long as the last one took if that is more
_CLOCK_BACK_NS = 50_000_000  # a smaller step back is bridged
_LEAST_STEP_NS = 1000  # stamps are compared in microseconds


class Connection:
    """One connection. Every method may throw OSError."""

    def __init__(self, name: str, node_id: str) -> None:
        self._node_id = node_id
        self._reader: asyncio.StreamReader | None = None
        self._writer: asyncio.StreamWriter | None = None
        self._turn = asyncio.Lock()
        self._newest_ns = 0
        self._bad = RateLimitedNote(f"{name}: a message is not understood")

    async def open(self, host: str, port: int) -> None:
        """Connects. OSError, also if nobody answers."""
        async with deadline(DIAL_S, "no answer within"):
            self._reader, self._writer = await asyncio.open_connection(host, port)
        self._writer.transport.set_write_buffer_limits(high=0)  # what is sent survives a SIGKILL
        wire = self._writer.get_extra_info("socket")
        # A middleware without power would be missed by the system after a quarter of an hour.
        wire.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, round(DIAL_S * 1000))
        # Megabytes for one that hangs would be positions of minutes ago when it goes on.
        wire.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, _MOST_UNSENT)
        self._newest_ns = 0

    def now_ns(self) -> int:
        """The computer's time. ConnectionError if it is before that of messages."""
        now_ns = time.time_ns()
        if now_ns < self._newest_ns - _CLOCK_BACK_NS:
            raise ConnectionError("this computer's clock was set back")
        return now_ns

    def stamp_ns(self) -> int:
        """The time of a message, later than that of any before."""
        self._newest_ns = max(self.now_ns(), self._newest_ns + _LEAST_STEP_NS)
        return self._newest_ns

    async def send(
        self, contents: Sequence[Message], kind: str, to: str = "", stamp_ns: int | None = None
    ) -> None:
        """Sends messages of one kind and one stamp; returns when the system has taken them."""
        assert self._writer is not None
        async with self._turn:
            stamp_ns = self.stamp_ns() if stamp_ns is None else stamp_ns
            for content in contents:
                message = SapientMessage(node_id=self._node_id, **{kind: content})
                message.timestamp.FromNanoseconds(stamp_ns)
                if to:
                    message.destination_id = to
                data = message.SerializeToString()
                self._writer.write(_LENGTH.pack(len(data)) + data)
            async with deadline(DIAL_S, "took nothing for"):
                await self._writer.drain()

    async def receive(self) -> SapientMessage:
        """The next valid message; others are answered with their faults."""
        while True:
            data = await self._read()
            begin_s = time.monotonic()
            try:
                message = SapientMessage.FromString(data)
                found = "; ".join(islice(faults(message), _MOST_FAULTS))
            except (DecodeError, ValueError) as error:
                message, found = SapientMessage(), f"cannot be decoded: {error}"
            await asyncio.sleep(max(_REST_S, time.monotonic() - begin_s))
            if not found:
                return message
            self._bad(found[:200])
            if not message.HasField("error"):
                error = Error(packet=data[:_MOST_RETURNED], error_message=[found])
                await self.send([error], "error")

    async def _read(self) -> bytes:
        assert self._reader is not None
        try:
            (length,) = _LENGTH.unpack(await self._reader.readexactly(_LENGTH.size))
            if length > _MOST_BYTES:
                raise ConnectionError(
                    f"sent a message of {length:,} bytes, expected at most {_MOST_BYTES:,}"
                )
            async with asyncio.timeout(DIAL_S):
                return await self._reader.readexactly(length)
        except asyncio.IncompleteReadError as error:
            raise ConnectionError("the connection was closed") from error
        except TimeoutError as error:
            raise ConnectionError(f"sent no more of a message for {DIAL_S:g} s") from error

    async def close(self) -> None:
        """Closes; what was sent leaves before."""
        writer = self._writer
        self._reader = self._writer = None
        if writer is not None:
            writer.close()
            with contextlib.suppress(OSError, TimeoutError):
                async with asyncio.timeout(1.0):
                    await writer.wait_closed()
