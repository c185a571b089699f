"""Retention of a store when the system clock is set and stores are reopened."""

from __future__ import annotations

import contextlib
import sqlite3
import time
from dataclasses import replace

import pytest
from live_program import wait_until
from station_events import BEGIN_NS, row
from test_history import flight, messages
from test_keeper import DAY_NS, forged, keep, rows_kept
from unlidar.history.ageing import Ageing
from unlidar.history.keeper import Keeper
from unlidar.history.reader import Reader
from unlidar.history.store import Store


class Clocks:
    """A computer's clock, which may be set, and a steady one."""

    def __init__(self) -> None:
        self.wall_ns, self.steady_ns = time.time_ns(), 0
        self.ageing = Ageing(lambda: self.wall_ns, lambda: self.steady_ns)

    def pass_days(self, days: float) -> None:
        self.wall_ns += round(days * DAY_NS)
        self.steady_ns += round(days * DAY_NS)


def test_a_recording_of_another_year_is_kept_for_the_days_too(tmp_path) -> None:
    clocks = Clocks()
    store = Store(tmp_path / "sky.db", days=2, ageing=clocks.ageing)
    store.take(messages(tmp_path, *flight(7)))
    for days, kept in ((1.5, 1), (1.0, 0)):
        clocks.pass_days(days)
        store.tidy()
        assert len(list(store.reader().tracks())) == kept
    store.close()


def kept(store: Store) -> set[int]:
    return {track.number for track in store.reader().tracks()}


@pytest.mark.parametrize("days", [-400, -31, -3, 3, 31, 400])
def test_a_clock_that_is_set_while_it_runs_deletes_nothing_and_changes_no_order(
    days, tmp_path
) -> None:
    clocks = Clocks()
    store = Store(tmp_path / "sky.db", days=30, ageing=clocks.ageing)
    store.take(messages(tmp_path, *flight(1)))
    for number, jump in ((2, days), (3, -days), (4, days), (5, 0)):
        clocks.wall_ns += jump * DAY_NS
        for _ in range(2):
            clocks.pass_days(1.1)
            store.tidy()
        store.take(messages(tmp_path, *flight(number, 100.0 * number)))
    assert kept(store) == {1, 2, 3, 4, 5}
    taken = [ns for (ns,) in store._connection().execute("SELECT taken_ns FROM track ORDER BY id")]
    assert taken == sorted(taken)
    clocks.pass_days(24)  # 33 in all, of them 31 since the second flight
    store.tidy()
    assert kept(store) == {3, 4, 5}
    store.close()


@pytest.mark.parametrize(("days", "left"), [(400, {7, 8}), (-400, {7, 8}), (31, {7, 8}), (20, {8})])
def test_how_long_nobody_wrote_counts_where_the_clock_may_be_right(days, left, tmp_path) -> None:
    clocks = Clocks()
    store = Store(tmp_path / "sky.db", days=30, ageing=clocks.ageing)
    store.take(messages(tmp_path, *flight(7)))
    clocks.pass_days(15)
    store.take(messages(tmp_path, *flight(8, 100.0)))
    store.close()
    clocks = Clocks()
    clocks.wall_ns += (15 + days) * DAY_NS
    for _ in range(2):  # opened anew: that proves no date
        store = Store(tmp_path / "sky.db", days=30, ageing=clocks.ageing)
        store.tidy()
        assert kept(store) == {7, 8}
        store.close()
    store = Store(tmp_path / "sky.db", days=30, ageing=clocks.ageing)
    clocks.pass_days(1.1 / 24)
    store.tidy()
    assert kept(store) == left
    store.close()


def test_days_of_which_only_minutes_were_written_count_too(tmp_path) -> None:
    date_ns = Clocks().wall_ns
    for day in range(25):
        clocks = Clocks()
        clocks.wall_ns = date_ns + day * DAY_NS
        clocks.ageing = Ageing(lambda: clocks.wall_ns, lambda: clocks.steady_ns)  # noqa: B023
        store = Store(tmp_path / "sky.db", days=30, ageing=clocks.ageing)
        if day == 0:
            store.take(messages(tmp_path, *flight(7)))
        clocks.pass_days(0.01)
        store.tidy()
        if day < 24:
            store.close()
    for days, left in ((3, {7}), (4, set())):
        clocks.pass_days(days)
        store.tidy()
        assert kept(store) == left
    store.close()


def test_a_store_of_version_2_whose_clock_was_set_back_loses_nothing(tmp_path) -> None:
    path = tmp_path / "sky.db"
    before = Store(path)
    before.take(messages(tmp_path, *flight(7)))
    before.take(messages(tmp_path, *flight(8, 100.0)))
    before.close()
    with contextlib.closing(sqlite3.connect(path, isolation_level=None)) as db:  # as it was
        db.execute("DROP TABLE clock")
        db.execute("PRAGMA user_version = 2")
        db.execute("UPDATE track SET taken_ns = taken_ns + ? WHERE number = 7", (400 * DAY_NS,))
    assert len(list(Reader(path).tracks())) == 2
    after = Store(path, days=30)
    after.tidy()
    assert kept(after) == {7, 8}
    after.close()


def test_what_is_newest_is_reported_though_the_clock_was_set_back(tmp_path, monkeypatch) -> None:
    store = Store(tmp_path / "sky.db")
    store.take(messages(tmp_path, *flight(7)))
    (stray,) = messages(tmp_path, row(7, 1.0))
    long_ago_ns = BEGIN_NS - 500 * DAY_NS
    store.take([replace(stray, event=forged(stray.event, timestamp=long_ago_ns))])
    store.close()
    monkeypatch.setattr(time, "time_ns", lambda: BEGIN_NS - 400 * DAY_NS)
    assert Reader(tmp_path / "sky.db").newest_ns() == BEGIN_NS + round(4.9e9)


@pytest.mark.parametrize("values", [(1 << 62, 5), (-5, -5), ("x", b"y"), (1 << 63, 1)])
def test_a_damaged_clock_of_a_store_stops_nobody(values, tmp_path) -> None:
    path = tmp_path / "sky.db"
    Store(path).close()
    with contextlib.closing(sqlite3.connect(path, isolation_level=None)) as db:
        db.execute("DELETE FROM clock")
        db.execute(
            "INSERT INTO clock VALUES (1, ?, ?)", [float(v) if v == 1 << 63 else v for v in values]
        )
    keeper = Keeper(path)
    keep(keeper, tmp_path, *flight(7))
    wait_until(lambda: rows_kept(path) == 50, "it is kept")
    keeper.close()
    assert keeper._left_out.count == 0
    Reader(path).newest_ns()
