"""SAPIENT: registers with a middleware, then tells of now; tasks are answered."""

import asyncio
import contextlib
import time

from sapient_msg.bsi_flex_335_v2_0.registration_ack_pb2 import RegistrationAck
from sapient_msg.bsi_flex_335_v2_0.sapient_message_pb2 import SapientMessage

from unlidar.addresses import Address
from unlidar.events.site import Place
from unlidar.events.station import Message
from unlidar.relay.deadline import deadline
from unlidar.relay.output import Backoff
from unlidar.relay.sapient.connection import Connection
from unlidar.relay.sapient.ids import lasting_node_id
from unlidar.relay.sapient.messages import Reporter
from unlidar.relay.sapient.picture import Health, Picture
from unlidar.relay.sapient.registration import STATUS_EVERY_S, registration
from unlidar.relay.sapient.tasks import answer
from unlidar.reporting import RateLimitedNote, note

_ANSWER_S = 10.0
_LASTS_S = 10.0  # a connection that lasts as long is a good one
# Middleware takes detections less apart than 80 ms for an error, but those of one stamp for a scan.
_LEAST_APART_S = 0.085
_LEAST_STATUS_S = 0.5  # between two changes
_LOOK_S = 0.02
_FAREWELL_S = 0.3  # the public middleware drops what it has not worked off when a node leaves
_MOST_REASON = 200
_MOST_TASKS = 16  # that wait for their answer; others wait in the connection


class SapientOutput:
    """A node of one middleware. Only the newest of each track is told, nothing waits in line."""

    reach = "taken by the system, of a node that is registered"

    def __init__(
        self, address: Address, station: str, place: Place, every_s: float, node_id: str | None
    ) -> None:
        self.name = address.name
        self._address = address
        self._station = station
        self.node_id = node_id or lasting_node_id(station)
        self._picture = Picture(self.node_id)
        self._reporter = Reporter(self.node_id, place)
        self._connection = Connection(self.name, self.node_id)
        self._apart_ns = round(max(every_s, _LEAST_APART_S) * 1e9)
        self._backoff = Backoff(self.name)
        self._changed = asyncio.Event()
        self._complaint = RateLimitedNote(f"{self.name}: answers with an error")
        self._tasks: asyncio.Queue[SapientMessage] = asyncio.Queue(_MOST_TASKS)
        self._is_registered = self._is_ending = self._is_introduced = False
        self._scan_ns = 0  # stamp of the newest detections
        self._status: Health | None = None  # as it was told last
        self._status_s = 0.0
        self.sent = 0
        self.dropped = 0  # positions while nobody was registered with

    @property
    def waiting(self) -> int:
        """Number of things that are not yet told."""
        return self._picture.waiting

    def learn(self, message: Message) -> None:
        """Takes in what was told before the start."""
        self._picture.learn(message)

    def learned(self) -> None:
        """Ends what `learn` began."""
        self._picture.learned()
        self._changed.set()

    def offer(self, message: Message, spare: bool) -> None:
        """Takes in a message without waiting."""
        tells_position = self._picture.take(message)
        if not self._is_registered:
            self.dropped += tells_position
        self._changed.set()

    async def run(self) -> None:
        """Tells for ever, across lost connections."""
        while True:
            began_s = time.monotonic()
            try:
                await self._connection.open(self._address.host, self._address.port)
                await self._register()
                self._backoff.reached(self.waiting)
                await self._tell_and_answer()
            except (OSError, ValueError) as error:
                if self._is_ending:
                    return
                self._backoff.failed(error)
            finally:
                self._is_registered = False
                await self._connection.close()
            if time.monotonic() - began_s > _LASTS_S:
                self._backoff.restart()
            await self._backoff.wait()

    async def drain(self, seconds: float) -> None:
        """Tells the rest and says goodbye, at most `seconds`; at once if nobody is there."""
        with contextlib.suppress(OSError, TimeoutError):
            async with asyncio.timeout(seconds):
                while self.waiting or not self._is_registered:
                    if self._backoff.is_away:
                        return
                    await asyncio.sleep(_LOOK_S)
                self._is_ending = True
                await self._send("status_report", self._reporter.goodbye())
                await asyncio.sleep(_FAREWELL_S)

    async def _register(self) -> None:
        """Registers and waits for the answer. ConnectionError if it is refused."""
        await self._send("registration", registration(self._station))
        async with deadline(_ANSWER_S, "no answer within"):
            while not (message := await self._connection.receive()).HasField("registration_ack"):
                self._complain(message)
        _check(message.registration_ack)
        self._status, self._scan_ns = None, 0
        self._picture.tell_again()
        self._is_registered = True
        if not self._is_introduced:
            note(f"{self.name}: is registered as node {self.node_id}")
        self._is_introduced = True

    async def _tell_and_answer(self) -> None:
        """Sends what changes, and the status now and then, until the connection is lost."""
        self._tasks = asyncio.Queue(_MOST_TASKS)
        listening = asyncio.ensure_future(self._listen())
        try:
            while True:
                self._changed.clear()
                await self._tell()
                changing = asyncio.ensure_future(self._changed.wait())
                await asyncio.wait(
                    {listening, changing},
                    timeout=self._pause_s(),
                    return_when=asyncio.FIRST_COMPLETED,
                )
                changing.cancel()
                if listening.done():
                    listening.result()
        finally:
            listening.cancel()
            await asyncio.wait({listening})
            listening.cancelled() or listening.exception()  # it was seen

    def _pause_s(self) -> float:
        """Time until something is to be sent, if nothing changes."""
        if self._picture.has_positions and not self._is_ending:
            passed_ns = self._connection.now_ns() - self._scan_ns
            return min(max((self._apart_ns - passed_ns) * 1e-9, 0.0), self._apart_ns * 1e-9)
        changed = self._status is not None and self._picture.health() != self._status
        return _LEAST_STATUS_S if changed else STATUS_EVERY_S / 5

    async def _tell(self) -> None:
        """Sends whatever is due."""
        if self._is_ending:
            return
        while not self._tasks.empty():
            await self._obey(self._tasks.get_nowait())
        await self._tell_status()
        for alert in self._picture.take_alerts():
            await self._send("alert", self._reporter.alert(alert))
        is_due = self._connection.now_ns() >= self._scan_ns + self._apart_ns
        if self._picture.has_positions and is_due:
            # One stamp for all, as of one scan.
            self._scan_ns = self._connection.stamp_ns()
            found = self._reporter.detections(self._picture.take_fresh(), time.monotonic())
            found += self._reporter.lost(self._picture.take_lost())
            await self._send("detection_report", *found, stamp_ns=self._scan_ns)

    async def _tell_status(self) -> None:
        health = self._picture.health()
        is_new = health != self._status
        passed_s = time.monotonic() - self._status_s
        is_due = passed_s >= (_LEAST_STATUS_S if is_new else STATUS_EVERY_S)
        if self._status is None or is_due:
            self._status, self._status_s = health, time.monotonic()
            await self._send("status_report", self._reporter.status(health, is_new))

    async def _listen(self) -> None:
        """Takes in tasks; OSError when the connection is lost."""
        while True:
            message = await self._connection.receive()
            if message.HasField("registration_ack"):
                _check(message.registration_ack)
            elif message.HasField("task"):
                await self._tasks.put(message)
                self._changed.set()
            else:
                self._complain(message)

    async def _obey(self, message: SapientMessage) -> None:
        if message.destination_id not in ("", self.node_id):
            self._complaint(f"a task for node {message.destination_id} came here")
            return
        reply, request = answer(message.task)
        await self._send("task_ack", reply, to=message.node_id)
        if request in ("Registration", "Reset"):
            await self._send("registration", registration(self._station))
            self._picture.tell_again()
        if request is not None:
            self._status = None  # told anew

    def _complain(self, message: SapientMessage) -> None:
        if message.HasField("error"):
            self._complaint("; ".join(message.error.error_message)[:_MOST_REASON])

    async def _send(
        self, kind: str, *contents: object, to: str = "", stamp_ns: int | None = None
    ) -> None:
        await self._connection.send(contents, kind, to, stamp_ns)
        self.sent += len(contents)


def _check(ack: RegistrationAck) -> None:
    if not ack.acceptance:
        why = "; ".join(ack.ack_response_reason)[:_MOST_REASON] or "it gives no reason"
        raise ConnectionError(f"refused the registration: {why}")
