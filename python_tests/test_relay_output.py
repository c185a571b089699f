"""The queue before somebody who may be away, as each output of `unlidar relay` has one."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Callable

import pytest
from live_program import PATIENCE_S
from unlidar.relay.output import Output


class Wire:
    """A way that is there or not, as the test wants."""

    reach = "got"

    def __init__(self) -> None:
        self.got: list[int] = []
        self.open = asyncio.Event()
        self.fail_after: int | None = None
        self.fail_every: int | None = None
        self.refused: set[int] = set()

    async def connect(self) -> None:
        if not self.open.is_set():
            raise ConnectionError("nobody there")

    async def send(self, messages, arrived) -> None:
        for message in messages:
            if message in self.refused or (
                self.fail_after is not None and len(self.got) >= self.fail_after
            ):
                self.fail_after = self.fail_every and len(self.got) + self.fail_every
                raise ConnectionError("cut")
            self.got.append(message)
            arrived()

    async def lost(self) -> None:
        await asyncio.Event().wait()

    async def close(self) -> None:
        pass


def test_room_is_bounded_the_oldest_rows_go_first_and_are_counted(caplog) -> None:
    async def check() -> None:
        wire = Wire()
        output = Output("wire", wire, 10)
        running = asyncio.ensure_future(output.run())
        for i in range(100):
            output.offer(i, spare=i != 3)  # 3 is an alarm
        assert (output.waiting, output.dropped) == (10, 90)
        wire.open.set()
        await output.drain(PATIENCE_S)
        running.cancel()
        assert wire.got == [3, *range(91, 100)]
        for i in range(20):  # nothing that one can spare: still bounded
            output.offer(i, spare=False)
        assert output.waiting == 10

    asyncio.run(check())
    said = [m for m in caplog.messages if "queue full" in m]
    assert 5 <= len(said) <= 9  # the first, second, fourth, ... time


@pytest.mark.parametrize("after", [0, 1, 5, 63, 64, 99])
def test_whenever_the_way_is_cut_all_comes_in_order(after, monkeypatch) -> None:
    monkeypatch.setattr("unlidar.relay.output._WAIT_S", (0.01, 0.02))

    async def check() -> None:
        wire = Wire()
        wire.open.set()
        wire.fail_after = after
        output = Output("wire", wire, 1000)
        running = asyncio.ensure_future(output.run())
        for i in range(100):
            output.offer(i, spare=True)
        await output.drain(PATIENCE_S)
        running.cancel()
        assert wire.got == list(range(100))
        assert output.dropped == 0

    asyncio.run(check())


@pytest.mark.parametrize("every", [1, 20])
def test_a_way_that_is_cut_again_and_again_goes_on_from_what_has_arrived(
    every, monkeypatch
) -> None:
    monkeypatch.setattr("unlidar.relay.output._WAIT_S", (0.001, 0.002))

    async def check() -> None:
        wire = Wire()
        wire.open.set()
        wire.fail_after = wire.fail_every = every
        output = Output("wire", wire, 1000)
        running = asyncio.ensure_future(output.run())
        for i in range(100):
            output.offer(i, spare=True)
        await asyncio.wait_for(output._emptied.wait(), PATIENCE_S)
        running.cancel()
        assert list(dict.fromkeys(wire.got)) == list(range(100))
        assert (output.sent, output.dropped) == (100, 0)

    asyncio.run(check())


@pytest.mark.parametrize("refused", [{0}, {5, 6}, {99}])
def test_a_message_that_the_other_side_does_not_bear_holds_up_no_other(
    refused, monkeypatch, caplog
) -> None:
    monkeypatch.setattr("unlidar.relay.output._WAIT_S", (0.001, 0.002))

    async def check() -> None:
        wire = Wire()
        wire.open.set()
        wire.refused = refused
        output = Output("wire", wire, 1000)
        running = asyncio.ensure_future(output.run())
        for i in range(100):
            output.offer(i, spare=False)
        await asyncio.wait_for(output._emptied.wait(), PATIENCE_S)
        running.cancel()
        assert list(dict.fromkeys(wire.got)) == [i for i in range(100) if i not in refused]
        assert (output.sent, output.dropped, output.waiting) == (
            100 - len(refused),
            len(refused),
            0,
        )

    asyncio.run(check())
    said = [m for m in caplog.messages if "a message is left out" in m]
    assert len(said) == len(refused)


class Link(Wire):
    """Carries anything, but breaks whenever `breaks(connection, place)`; also after the message.

    `place`: of a message in its connection, the first is 0.
    """

    def __init__(self, breaks: Callable[[int, int], bool], arrives: bool) -> None:
        super().__init__()
        self.open.set()
        self._breaks, self._arrives = breaks, arrives
        self._connection, self._place = -1, 0

    async def connect(self) -> None:
        self._connection, self._place = self._connection + 1, 0

    async def send(self, messages, arrived) -> None:
        for message in messages:
            place, self._place = self._place, self._place + 1
            is_broken = self._breaks(self._connection, place)
            if self._arrives or not is_broken:
                self.got.append(message)
            if is_broken:
                raise ConnectionError("cut")
            arrived()


CHANCE = random.Random(5)
LINKS = {
    "after every message": lambda connection, place: place == 1,
    "after two": lambda connection, place: place == 2,
    "every second connection at once": lambda c, place: c % 2 == 0 or place == 3,
    "two of three connections at once": lambda c, place: c % 3 > 0 or place == 1,
    "nineteen of twenty connections at once": lambda c, place: c % 20 > 0,
    "half of all messages": lambda connection, place: CHANCE.random() < 0.5,
    "nine of ten messages": lambda connection, place: CHANCE.random() < 0.9,
}


@pytest.mark.parametrize("arrives", [False, True], ids=["unsent", "unacknowledged"])
@pytest.mark.parametrize("link", LINKS)
def test_whenever_a_link_breaks_by_itself_nothing_is_left_out(link, arrives, monkeypatch) -> None:
    monkeypatch.setattr("unlidar.relay.output._WAIT_S", (0.0, 0.0))

    async def check() -> None:
        wire = Link(LINKS[link], arrives)
        output = Output("wire", wire, 1000, probe=-1)
        running = asyncio.ensure_future(output.run())
        for i in range(100):
            output.offer(i, spare=True)
        await asyncio.wait_for(output._emptied.wait(), PATIENCE_S)
        running.cancel()
        assert [i for i in dict.fromkeys(wire.got) if i >= 0] == list(range(100))
        assert (output.sent, output.dropped) == (100, 0)

    asyncio.run(check())


def test_who_accepts_and_takes_nothing_costs_no_message(monkeypatch) -> None:
    monkeypatch.setattr("unlidar.relay.output._WAIT_S", (0.0, 0.0))

    async def check() -> None:
        wire = Link(lambda connection, place: connection < 2000, arrives=False)
        output = Output("wire", wire, 1000, probe=-1)
        running = asyncio.ensure_future(output.run())
        for i in range(100):
            output.offer(i, spare=True)
        await asyncio.wait_for(output._emptied.wait(), PATIENCE_S)
        running.cancel()
        assert [i for i in dict.fromkeys(wire.got) if i >= 0] == list(range(100))
        assert output.dropped == 0

    asyncio.run(check())
