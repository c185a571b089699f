"""Events `returns`: some of what each LiDAR sees, for a page beside the engine and nobody else."""

from __future__ import annotations

import asyncio
import base64
import json
import sqlite3
from pathlib import Path

import numpy as np
import pytest
from live_program import events_of, feed, messages
from station_events import returns, row
from synthetic import Flight, make_flight, write_frames
from unlidar.events.event import MOST_BYTES, Returns, decode
from unlidar.events.site import Site
from unlidar.events.station import Station
from unlidar.history.keeper import Keeper
from unlidar.watch.pages import Pages
from unlidar.watch.sky import Sky

MOST = 50


@pytest.fixture(scope="module")
def flight() -> Flight:
    return make_flight()


@pytest.fixture(scope="module")
def stream(flight, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return b"".join(messages(lidar=write_frames(tmp_path_factory.mktemp("f") / "lidar", flight)))


def points_of(event: Returns) -> np.ndarray:
    steps = np.frombuffer(base64.b64decode(event.xyz), "<i2").reshape(-1, 3)
    return steps * event.step_m


def test_they_are_returns_of_frames_and_change_nothing_else(
    stream: bytes, tmp_path: Path, flight
) -> None:
    plain, more = tmp_path / "plain.csv", tmp_path / "more.csv"
    _, without, _ = feed(stream, plain, "--events", "-")
    options = "--events", "-", "--event-returns", MOST
    code, out, said = feed(stream, more, *map(str, options))
    assert code == 0, said
    told = events_of(out)
    rest = [line for line in out.splitlines() if '"returns"' not in line]
    assert rest == without.splitlines()
    assert more.read_bytes() == plain.read_bytes()
    stamps = [e["timestamp"] for e in told if e["event"] == "returns"]
    assert np.diff(stamps).min() > 0.15
    assert len(stamps) == pytest.approx(5 * (max(stamps) - min(stamps)), abs=2)
    for line in out.splitlines():
        event = decode(line)[0]
        if isinstance(event, Returns):
            seen = flight.clouds[flight.stamps_ns.index(event.timestamp)]
            found = points_of(event)
            assert 0 < len(found) == min(MOST, len(seen))
            apart = np.linalg.norm(found[:, None] - seen[None], axis=2).min(axis=1)
            assert apart.max() <= 0.9 * event.step_m  # half the diagonal of a step


def test_in_a_file_of_their_own_they_are_the_same_and_no_events(
    stream: bytes, tmp_path: Path
) -> None:
    number = ("--event-returns", str(MOST))
    _, both, _ = feed(stream, tmp_path / "both.csv", "--events", "-", *number)
    own = tmp_path / "returns.jsonl"
    options = ("--events", "-", *number, "--event-returns-file", str(own))
    code, rest, said = feed(stream, tmp_path / "own.csv", *options)
    assert code == 0, said
    lines = both.splitlines()
    assert rest.splitlines() == [line for line in lines if '"returns"' not in line]
    assert own.read_text().splitlines() == [line for line in lines if '"returns"' in line]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--events", "-", "--event-returns", "0"), "--event-returns"),
        (("--events", "-", "--event-returns", "2001"), "--event-returns"),
        (("--event-returns", "10"), "--event-returns requires --events"),
        (("--events", "-", "--event-returns-file", "r"), "requires --event-returns"),
    ],
)
def test_a_number_that_no_line_holds_is_refused(options, said, tmp_path: Path) -> None:
    code, _, told = feed(b"", tmp_path / "t.csv", *options)
    assert code == 2
    assert said in told


def test_the_most_returns_fit_a_line() -> None:
    # With a name that needs two characters for each of its own.
    line = returns('"' * 120, 0.0, np.zeros((2000, 3)))
    assert len(line) <= MOST_BYTES
    assert decode(line)[1] == line


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("xyz", '"AAAA"'),  # half a return
        ("xyz", '"AAAAAAA\\n"'), ("xyz", '"AAAAAAA="'), ("xyz", '"****AAAA"'), ("xyz", "0"),
        ("xyz", f'"{"AAAAAAAA" * 2001}"'),
        ("step_m", "0"), ("step_m", "-0.01"), ("step_m", "2"), ("step_m", "NaN"),
        ("step_m", '"1"'), ("name", '"\\n"'), ("timestamp", "1"),
    ],
)  # fmt: skip
def test_a_value_out_of_its_bounds_is_refused(key: str, value: str) -> None:
    line = returns("mid360", 0.5, [[1.0, 2.0, 3.0]])
    before, _, rest = line.partition(f'"{key}":')
    end = rest.find(",") if "," in rest else rest.find("}")
    with pytest.raises(ValueError, match=f"{key}: |NaN"):
        decode(f'{before}"{key}":{value}{rest[end:]}')


def test_they_are_never_kept(tmp_path: Path) -> None:
    keeper = Keeper(tmp_path / "sky.db", 1.0, 10.0)
    station = Station(Site())
    for line in (returns("mid360", 0.0, [[1.0, 2.0, 3.0]]), row(7, 0.0)):
        for message in station.take(line):
            keeper(message)
    keeper.close()
    with sqlite3.connect(tmp_path / "sky.db") as db:
        assert db.execute("SELECT count(*) FROM row").fetchone() == (1,)
        assert db.execute("SELECT count(*) FROM told").fetchone() == (0,)


def test_a_page_gets_the_newest_of_each_lidar_and_a_slow_one_none() -> None:
    async def check() -> None:
        pages, station = Pages(Sky()), Station(Site(), places=False)
        keen, slow = pages.told("{}"), pages.told("{}")
        for page in (keen, slow):
            await anext(page)
        waits = [asyncio.ensure_future(anext(page)) for page in (keen, slow)]
        await asyncio.sleep(0)
        pages.tell()
        assert all(b"snapshot" in batch for batch in await asyncio.gather(*waits))
        told: list[dict] = []
        for t in range(20):
            lines = [
                returns(f"l{i}", t + j / 10, np.full((9, 3), i)) for i in (1, 2) for j in (0, 5)
            ]
            for line in [row(1, float(t)), *lines]:
                for message in station.take(line):
                    pages.take(message)
            pages.tell()
            assert b'"row"' in await anext(keen)
            event, _, data = (await anext(keen)).decode().partition("\n")
            assert event == "event: returns"
            told += json.loads(data.removeprefix("data: "))
        assert [(e["name"], e["timestamp"] % 1 > 0.4) for e in told] == 20 * [
            ("l1", True), ("l2", True),
        ]  # fmt: skip
        late = [await anext(slow) for _ in range(20 + 2)]
        assert sum(b'"row"' in batch for batch in late) == 20
        assert sum(batch.startswith(b"event: returns") for batch in late) == 2

    asyncio.run(check())


def test_a_flood_of_them_hides_no_row() -> None:
    async def check() -> None:
        pages, station = Pages(Sky()), Station(Site(), places=False)
        page = pages.told("{}")
        await anext(page)
        waits = asyncio.ensure_future(anext(page))
        await asyncio.sleep(0)
        pages.tell()
        await waits
        for i in range(60):
            for message in station.take(returns(f"l{i}", 0.0, np.zeros((2000, 3)))):
                pages.take(message)
        for message in station.take(row(1, 0.0)):
            pages.take(message)
        pages.tell()
        assert b'"row"' in await anext(page)
        assert len(await anext(page)) < 250_000

    asyncio.run(check())


def test_those_of_before_the_start_are_not_shown() -> None:
    pages, station = Pages(Sky()), Station(Site(), places=False)
    pages._queues.add(asyncio.Queue())
    for message in station.take(returns("mid360", 0.0, [[1.0, 2.0, 3.0]])):
        pages.take(message, old=True)
    assert not pages._returns
