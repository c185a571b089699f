"""Messages of many stations wait, and none takes the room or the turn of another."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st
from unlidar.events.fair import FairQueue


@given(st.lists(st.tuples(st.sampled_from("abcd"), st.integers(1, 50)), max_size=80))
def test_each_sender_has_a_turn_in_its_own_order(sent) -> None:
    queue: FairQueue[tuple[str, int]] = FairQueue(3, 10, 200)
    for sender in "abc":  # d was never heard
        assert queue.put(sender, (sender, -1), 1)
    assert len(queue.take(1000)) == 3
    waiting: dict[str, list[int]] = {}
    for number, (sender, size) in enumerate(sent):
        if queue.put(sender, (sender, number), size):
            waiting.setdefault(sender, []).append(number)
    assert all(len(numbers) <= 10 for numbers in waiting.values())
    taken = queue.take(1000)
    assert queue.take(1) == []
    assert queue._known_bytes == queue._hall_bytes == 0
    assert not queue._queues
    for sender, numbers in waiting.items():
        assert [number for who, number in taken if who == sender] == numbers
    turns = [who for who, _ in taken]
    fewest = min((len(numbers) for numbers in waiting.values()), default=0)
    for i in range(fewest):
        assert set(turns[i * len(waiting) : (i + 1) * len(waiting)]) == set(waiting)


def test_who_floods_leaves_the_room_of_others() -> None:
    queue: FairQueue[int] = FairQueue(8, 1000, 10_000)
    assert sum(queue.put("flood", i, 100) for i in range(5000)) == 100
    assert queue.put("north", 1, 100)
    assert queue.take(2) == [0, 1]


@pytest.mark.parametrize("liars", [256, 8])
def test_whoever_fills_the_queue_a_station_that_speaks_has_room(liars) -> None:
    lost: list[str] = []
    queue: FairQueue[str] = FairQueue(256, 12_000, 8000, lost.append)
    assert queue.put("south", "south", 10)
    queue.take(1)
    names = [f"liar{i}" for i in range(liars)]
    for lie in range(4):  # heard once, they fill all the room
        for name in names:
            queue.put(name, "lie", 8000 // 4 if liars == 8 else 8000 // 100)
        queue.take(100 if lie == 0 else 0)
    assert queue.put("south", "south", 100)
    assert queue.put("north", "north", 100) or "north" in lost
    assert set(lost) <= {*names, "north"}
    assert "south" in queue.take(1000)
    for flood in range(2):
        for i in range(500):
            queue.put(f"other{flood}.{i}", "lie", 10)
        queue.put("south", "south", 10)
    assert "south" in queue.take(20)


@pytest.mark.parametrize("before", [0, 100, 9_000, 10_000])
def test_a_newcomer_is_heard_though_ten_thousand_invented_names_wait(before) -> None:
    queue: FairQueue[str] = FairQueue(256, 12_000, 8_000_000)
    for i in range(10_001):
        name = "north" if i == before else f"invented{i}"
        assert queue.put(name, name, 700)
    turn = queue.take(20_000).index("north")
    assert turn == before  # who comes first is heard first
    for i in range(10_000):
        queue.put(f"another{i}", "lie", 700)
    assert queue.put("north", "north", 700)
    assert "north" in queue.take(2)  # and has a turn of its own from then on


def test_a_newcomer_that_goes_on_is_heard_beside_a_flood_that_never_ends() -> None:
    chance = random.Random(3)
    queue: FairQueue[str] = FairQueue(256, 12_000, 8_000_000)
    heard = 0
    for step in range(3000):
        for i in range(100):
            queue.put(f"invented{step}.{i}", "lie", 700)
        if chance.random() < 0.2:
            queue.put("north", "north", 700)
        heard += queue.take(50).count("north")
    assert heard > 100


def test_a_flood_of_names_stays_within_its_room() -> None:
    queue: FairQueue[str] = FairQueue(256, 12_000, 8000)
    for i in range(50_000):
        queue.put(f"invented{i}", "lie", 100)
        if i % 100 == 0:
            queue.take(10)
    assert queue._hall_bytes <= 2 * 8000
    assert len(queue._once) <= 16_384
    assert len(queue._queues) <= 16_384
