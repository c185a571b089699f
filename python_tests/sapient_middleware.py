"""A SAPIENT middleware that remembers what nodes sent, and when; and one without manners."""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator

from google.protobuf.message import Message
from live_program import wait_until
from sapient_msg.bsi_flex_335_v2_0.registration_ack_pb2 import RegistrationAck
from sapient_msg.bsi_flex_335_v2_0.sapient_message_pb2 import SapientMessage
from sapient_msg.bsi_flex_335_v2_0.task_pb2 import Task

MIDDLEWARE_ID = "5913c0f4-9f89-4c01-ab90-939099797c4f"
TASK_ID = "01H4R63D7NVN8444Z5M77WEBY6"


def framed(data: bytes) -> bytes:
    return struct.pack("<I", len(data)) + data


def message_of(kind: str, content: Message, to: str = "") -> bytes:
    message = SapientMessage(node_id=MIDDLEWARE_ID, **{kind: content})
    message.timestamp.GetCurrentTime()
    if to:
        message.destination_id = to
    return framed(message.SerializeToString())


def accepted(*reasons: str) -> bytes:
    ack = RegistrationAck(acceptance=not reasons, ack_response_reason=reasons)
    return message_of("registration_ack", ack)


def task(to: str = "", **more) -> bytes:
    known = {"task_id": TASK_ID, "control": Task.CONTROL_START} | more
    return message_of("task", Task(**known), to)


def received(client: socket.socket) -> Iterator[SapientMessage]:
    """The messages of a node until it leaves."""
    data = b""
    while piece := client.recv(65536):
        data += piece
        while len(data) >= 4 and len(data) >= 4 + (length := struct.unpack_from("<I", data)[0]):
            yield SapientMessage.FromString(data[4 : 4 + length])
            data = data[4 + length :]
    assert data == b""


class Middleware:
    """Accepts every registration; may be closed and opened again at its port."""

    def __init__(self, port: int = 0) -> None:
        self.messages: list[SapientMessage] = []
        self.received_s: list[float] = []
        self.sessions = 0
        self._clients: list[socket.socket] = []
        self._listener = socket.create_server(("127.0.0.1", port), reuse_port=True)
        self.port = self._listener.getsockname()[1]
        threading.Thread(target=self._serve, daemon=True).start()

    def __enter__(self) -> Middleware:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _serve(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                client, _ = self._listener.accept()
                self.sessions += 1
                self._clients.append(client)
                threading.Thread(target=self._talk, args=(client,), daemon=True).start()

    def _talk(self, client: socket.socket) -> None:
        with contextlib.suppress(OSError):
            for message in received(client):
                self.received_s.append(time.time())
                self.messages.append(message)
                if message.HasField("registration"):
                    client.sendall(accepted())

    def send(self, data: bytes) -> None:
        self._clients[-1].sendall(data)

    def kick(self) -> None:
        for client in self._clients:
            with contextlib.suppress(OSError):
                client.shutdown(socket.SHUT_RDWR)
            client.close()
        self._clients.clear()

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self.kick()

    def all(self, kind: str) -> list:
        return [getattr(m, kind) for m in self.messages if m.HasField(kind)]

    def wait_for(self, kind: str, count: int = 1) -> list:
        wait_until(lambda: len(self.all(kind)) >= count, f"{count} of {kind} came")
        return self.all(kind)

    def wait_until(self, kind: str, holds: Callable[[Message], bool]) -> Message:
        wait_until(lambda: any(map(holds, self.all(kind))), f"the {kind} came")
        return next(found for found in self.all(kind) if holds(found))
