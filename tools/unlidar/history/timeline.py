"""Bounded queries of pages on the past."""

import asyncio
import json
import sqlite3
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from unlidar.errors import reason
from unlidar.events.station import ALARM, RAISED
from unlidar.history.reader import ROW
from unlidar.history.schema import Location

_MOST_SPANS = 2000  # more tracks are merged by time bins
_BINS = 720
_MOST_ALARMS = 1000  # the newest ones
_MOST_TRACKS = 200  # newest tracks in an answer with rows
_MOST_ROWS = 20_000  # of all tracks; thinned evenly beyond
_THREADS, _MOST_WAITING = 2, 16
_LIMIT_S = 1.0  # timeout of a query, and of the lock
_FRESH_S = 2.0  # lifetime of a cached answer
_STEPS = 2000  # SQLite instructions between timeout checks


class UnansweredError(Exception):
    """The store cannot be queried now; the page reports that and retries."""


def spans(db: sqlite3.Connection, since_ns: int, until_ns: int, station: str | None) -> dict:
    """Spans of tracks and raised alarms in a time span, in seconds.

    A span is station, number, first and newest stamp. Beyond _MOST_SPANS, number is None and a
    span merges all tracks that ended in a bin.
    """
    among = "FROM track WHERE newest_ns >= ? AND begin_ns <= ? AND (? IS NULL OR station = ?)"
    values = since_ns, until_ns, station, station
    found = db.execute(
        f"SELECT station, number, begin_ns, newest_ns {among} ORDER BY newest_ns LIMIT ?",
        (*values, _MOST_SPANS + 1),
    ).fetchall()
    if len(found) > _MOST_SPANS:
        bin_ns = max(1, (until_ns - since_ns) // _BINS)
        found = db.execute(
            f"SELECT min(station), NULL, max(min(begin_ns), ?), min(max(newest_ns), ?) {among} "
            "GROUP BY (newest_ns - ?) / ? ORDER BY 4 LIMIT ?",
            (since_ns, until_ns, *values, since_ns, bin_ns, _MOST_SPANS),
        ).fetchall()
    raised = db.execute(
        "SELECT json_extract(text, '$.station'), json_extract(text, '$.zone'), "
        "json_extract(text, '$.raised') FROM told WHERE kind = ? AND at_ns BETWEEN ? AND ? "
        "AND json_valid(text) AND json_extract(text, '$.state') = ? ORDER BY at_ns DESC LIMIT ?",
        (ALARM, since_ns, until_ns, RAISED, _MOST_ALARMS),
    ).fetchall()
    seconds = [[name, number, begin / 1e9, end / 1e9] for name, number, begin, end in found]
    return {"spans": seconds, "alarms": raised[::-1]}


def rows(db: sqlite3.Connection, since_ns: int, until_ns: int, station: str | None) -> dict:
    """Tracks with rows in a time span: s, m, m/s and returns, rounded to millimetres.

    `left_out`: number of tracks beyond the bound.
    """
    among = "FROM track WHERE newest_ns >= ? AND begin_ns <= ? AND (? IS NULL OR station = ?)"
    values = since_ns, until_ns, station, station
    ((count,),) = db.execute(f"SELECT count(*) {among}", values)
    chosen = db.execute(
        f"SELECT id, station, number {among} ORDER BY begin_ns DESC, id DESC LIMIT ?",
        (*values, _MOST_TRACKS),
    ).fetchall()
    sizes = {
        identity: db.execute(
            "SELECT count(*) FROM row WHERE track = ? AND stamp_ns BETWEEN ? AND ?",
            (identity, since_ns, until_ns),
        ).fetchone()[0]
        for identity, _, _ in chosen
    }
    step = max(1, -(-sum(sizes.values()) // _MOST_ROWS))
    tracks = []
    for identity, name, number in chosen[::-1]:
        if not sizes[identity]:
            continue
        found = db.execute(
            f"SELECT stamp_ns, {ROW} FROM (SELECT *, row_number() OVER (ORDER BY stamp_ns) AS n "
            "FROM row WHERE track = ? AND stamp_ns BETWEEN ? AND ?) WHERE (? - n) % ? = 0 "
            "ORDER BY stamp_ns",
            (identity, since_ns, until_ns, sizes[identity], step),
        ).fetchall()
        thinned = [[row[0] / 1e9, *(round(value, 3) for value in row[1:11])] for row in found]
        told = {"station": name, "track": number, "drone": found[-1][11], "rows": thinned}
        tracks.append(told)
    return {"tracks": tracks, "left_out": count - len(chosen)}


Question = Callable[[sqlite3.Connection, int, int, str | None], dict]


class Archive:
    """Queries the store in threads of its own; pages with equal queries share an answer."""

    def __init__(self, location: Location) -> None:
        self._location = location
        self._pool = ThreadPoolExecutor(_THREADS, "archive")
        self._answers: dict[tuple, tuple[float, asyncio.Future[bytes]]] = {}
        self._waiting = 0

    async def ask(
        self, question: Question, since_ns: int, until_ns: int, station: str | None
    ) -> bytes:
        """The answer as JSON. UnansweredError at a timeout, or if the store cannot be read."""
        key = question, since_ns, until_ns, station
        now_s = time.monotonic()
        self._answers = {
            k: (asked_s, answer)
            for k, (asked_s, answer) in self._answers.items()
            if not answer.done() or now_s - asked_s < _FRESH_S
        }
        if key not in self._answers:
            if self._waiting >= _MOST_WAITING:
                raise UnansweredError("too much is asked of the store")
            self._waiting += 1
            loop = asyncio.get_running_loop()
            answer = loop.run_in_executor(self._pool, self._answer, *key)
            answer.add_done_callback(self._answered)
            self._answers[key] = now_s, answer
        # A cancelled request does not cancel the shared answer.
        return await asyncio.shield(self._answers[key][1])

    def close(self) -> None:
        """Stops the threads."""
        self._pool.shutdown(wait=False, cancel_futures=True)

    def _answered(self, answer: asyncio.Future[bytes]) -> None:
        self._waiting -= 1
        answer.cancelled() or answer.exception()  # mark as retrieved, also without a waiting page

    def _answer(
        self, question: Question, since_ns: int, until_ns: int, station: str | None
    ) -> bytes:
        try:
            db = self._location.connect("ro", _LIMIT_S)
            try:
                until_s = time.monotonic() + _LIMIT_S
                db.set_progress_handler(lambda: time.monotonic() > until_s, _STEPS)
                db.execute("BEGIN")  # one snapshot for the whole answer
                told = question(db, since_ns, until_ns, station)
            finally:
                db.close()
        except (sqlite3.Error, TypeError, ValueError) as error:  # damage
            raise UnansweredError(f"the store cannot be asked: {reason(error)}") from error
        return json.dumps(told, separators=(",", ":")).encode()
