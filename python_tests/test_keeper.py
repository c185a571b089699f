"""The store of a station where the disk is full, locked, damaged or gone, and stamps lie."""

from __future__ import annotations

import contextlib
import copy
import os
import sqlite3
import time
from dataclasses import replace
from pathlib import Path

import pytest
from live_program import wait_until
from station_events import BEGIN_NS, row, sensor, state
from test_history import flight, messages
from unlidar.errors import OutputError
from unlidar.history.keeper import _MOST_WAITING, Keeper
from unlidar.history.reader import Reader
from unlidar.history.schema import _SINCE_VERSION_1, _TABLES
from unlidar.history.store import Store

DAY_NS = 86_400_000_000_000


def forged(event: object, **values: object) -> object:
    """With values that no line of events can have."""
    other = copy.copy(event)
    for name, value in values.items():
        object.__setattr__(other, name, value)
    return other


def rows_kept(path: Path) -> int:
    """None of a store that is damaged, or not made yet."""
    try:
        with contextlib.closing(sqlite3.connect(path)) as db:
            return db.execute("SELECT count(*) FROM row").fetchone()[0]
    except sqlite3.Error:
        return 0


@pytest.fixture
def said(monkeypatch) -> list[str]:
    notes: list[str] = []
    monkeypatch.setattr("unlidar.reporting.note", notes.append)
    monkeypatch.setattr("unlidar.history.keeper.note", notes.append)
    monkeypatch.setattr("unlidar.history.schema.note", notes.append)
    return notes


@pytest.fixture
def keeper(tmp_path: Path):
    keeper = Keeper(tmp_path / "sky.db")
    yield keeper
    keeper.close()


def keep(keeper: Keeper, folder: Path, *lines: str) -> None:
    for message in messages(folder, *lines):
        keeper(message)


def test_a_stamp_of_another_century_deletes_nothing_and_hides_nothing(tmp_path) -> None:
    store = Store(tmp_path / "sky.db")
    store.take(messages(tmp_path, *flight(7)))
    (message,) = messages(tmp_path, sensor("mid360", "ok"))
    ahead_ns = 3_900_000_000_000_000_000
    store.take([replace(message, at_ns=ahead_ns)])
    (stray,) = messages(tmp_path, row(7, 1.0))
    event = forged(stray.event, timestamp=ahead_ns)
    store.take([replace(stray, at_ns=ahead_ns, event=event)])
    store.tidy()
    store.take(messages(tmp_path, *flight(8, 100.0)))
    store.tidy()
    reader = store.reader()
    found = {(t.number, len(t.rows)) for t in reader.tracks()}
    assert found == {(7, 50), (7, 1), (8, 50)}  # the stray is no part of the flight
    # Time is told back from what this computer's clock does not contradict.
    assert reader.newest_ns() == BEGIN_NS + round(104.9e9)
    store.close()


def test_a_store_of_version_1_opens_and_loses_nothing(tmp_path) -> None:
    path = tmp_path / "sky.db"
    before = Store(path)
    before.take(messages(tmp_path, state("running"), *flight(7)))
    before.close()
    with sqlite3.connect(path) as db:  # as it was
        db.execute("DROP TABLE clock")
        for index in ("track_taken", "told_taken", "told_kind"):
            db.execute(f"DROP INDEX {index}")
        for table in ("track", "told"):
            db.execute(f"ALTER TABLE {table} DROP COLUMN taken_ns")
        db.execute("PRAGMA user_version = 1")
        made = sqlite3.connect(":memory:")
        made.executescript(_TABLES)
        schema = "SELECT sql FROM sqlite_master WHERE sql IS NOT NULL ORDER BY name"
        assert [x.split() for (x,) in db.execute(schema)] == [
            x.split() for (x,) in made.execute(schema)
        ]
    assert len(list(Reader(path).tracks())) == 1  # also without being brought up to date
    after = Store(path)
    after.tidy()
    (found,) = after.reader().tracks()
    assert len(found.rows) == 50
    assert len(after.reader().told("state", 0, 1 << 62)) == 1
    after.close()
    assert "taken_ns" in _SINCE_VERSION_1


def test_a_number_that_no_database_holds_costs_its_own_message_alone(tmp_path, said) -> None:
    store = Store(tmp_path / "sky.db")
    good, bad = messages(tmp_path, row(1, 0.0), row(1, 0.1))
    spoilt = [
        replace(bad, event=forged(bad.event, track=2**63)),
        replace(bad, event=forged(bad.event, timestamp=1 << 80)),
        replace(bad, station="\ud800"),
        replace(bad, event=forged(bad.event, x=object())),
    ]
    store.take([*spoilt, good, *spoilt])
    assert [len(t.rows) for t in store.reader().tracks()] == [1]
    assert store._bad.count == 2 * len(spoilt)
    store.close()


def test_whoever_holds_the_lock_holds_up_nobody_and_all_is_kept(tmp_path, keeper, said) -> None:
    path = tmp_path / "sky.db"
    other = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
    other.execute("BEGIN IMMEDIATE")
    begin_s = time.monotonic()
    keep(keeper, tmp_path, *flight(7))
    assert time.monotonic() - begin_s < 10  # of handing over; the lock is held for ever
    wait_until(lambda: any("it is tried again" in text for text in said), "it is said")
    assert not keeper.is_behind  # nobody waits for what cannot be
    other.execute("ROLLBACK")
    wait_until(lambda: rows_kept(path) == 50, "all is kept")


def test_what_waits_for_a_store_is_bounded_and_counted(tmp_path, said) -> None:
    keeper = Keeper(tmp_path / "sky.db")
    other = sqlite3.connect(tmp_path / "sky.db", isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    (message,) = messages(tmp_path, row(1, 0.0))
    for _ in range(_MOST_WAITING + 100):
        keeper(message)
    assert keeper._left_out.count == 100
    (large,) = messages(tmp_path, sensor("mid360", "ok"))
    assert len(keeper._waiting) == _MOST_WAITING
    other.execute("ROLLBACK")
    wait_until(lambda: not keeper._waiting, "it is written")
    for _ in range(1200):
        keeper(replace(large, text="x" * 16_000))
    assert keeper._bytes <= 8_000_000
    keeper.close()


def test_a_store_that_is_damaged_while_it_is_written_is_set_aside(tmp_path, keeper, said) -> None:
    path = tmp_path / "sky.db"
    keep(keeper, tmp_path, *flight(7))
    wait_until(lambda: rows_kept(path) == 50, "it is kept")
    with contextlib.closing(sqlite3.connect(path)) as db:
        whole = "PRAGMA wal_checkpoint(TRUNCATE)"
        wait_until(lambda: db.execute(whole).fetchone()[0] == 0, "all is in the file itself")
    with path.open("r+b") as file:
        file.seek(100)
        file.write(os.urandom(path.stat().st_size - 100))
    keep(keeper, tmp_path, *flight(8, 100.0))

    wait_until((tmp_path / "sky.db.damaged").exists, "it is set aside")
    wait_until(lambda: rows_kept(path) == 50, "a new store has what came since")
    assert any("is damaged; kept as sky.db.damaged" in text for text in said)


def test_a_store_that_is_taken_away_is_made_anew(tmp_path, keeper) -> None:
    path = tmp_path / "sky.db"
    keep(keeper, tmp_path, *flight(7))
    wait_until(lambda: rows_kept(path) == 50, "it is kept")
    for file in tmp_path.glob("sky.db*"):
        file.unlink()
    keep(keeper, tmp_path, *flight(8, 100.0))
    wait_until(lambda: path.exists() and rows_kept(path) == 50, "the next is kept")


@pytest.mark.parametrize("kind", ["pipe", "device"])
def test_what_is_no_file_is_refused_as_a_store(kind, tmp_path) -> None:
    path = Path("/dev/null") if kind == "device" else tmp_path / "pipe"
    if kind == "pipe":
        os.mkfifo(path)
    with pytest.raises(OutputError, match="cannot be a store: is no file"):
        Keeper(path)


def test_who_reads_for_long_stops_no_writer(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("unlidar.history.keeper._TIDY_S", 0.0)  # the log is cut short often
    path = tmp_path / "sky.db"
    keeper = Keeper(path)
    keep(keeper, tmp_path, *flight(7))
    wait_until(lambda: rows_kept(path) == 50, "it is kept")
    other = sqlite3.connect(path, isolation_level=None)
    other.execute("BEGIN")
    other.execute("SELECT count(*) FROM row").fetchall()
    keep(keeper, tmp_path, *flight(8, 100.0))
    wait_until(lambda: rows_kept(path) == 100, "the next is kept")
    other.close()
    keeper.close()


def test_no_flood_of_one_station_displaces_rows_of_others(tmp_path) -> None:
    store = Store(tmp_path / "sky.db", megabytes=0.5)
    store.take(messages(tmp_path, *flight(7)))
    for i in range(60):
        flood = messages(tmp_path, *flight(i, 100.0 * i))
        store.take([replace(m, station="evil") for m in flood])
    assert store._bytes() <= 600_000  # at once, not only when it is tidied
    kept = {t.station for t in store.reader().tracks()}
    assert kept == {"north", "evil"}
    store.close()


def test_no_flood_of_states_takes_the_alarms(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("unlidar.history.store._MOST_TOLD", 50)
    store = Store(tmp_path / "sky.db")
    store.take(messages(tmp_path, *flight(7)))
    store.take(messages(tmp_path, *[sensor(f"s{i}", "ok") for i in range(300)]))
    reader = store.reader()
    assert len(reader.alarms(0, 1 << 62)) == 2
    assert len(reader.told("sensor", 0, 1 << 62)) <= 60
    store.close()
