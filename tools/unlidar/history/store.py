"""The store: one SQLite file in WAL mode, bounded by days, by size and by kind.

Retention goes by the time of storage, never by stamps: recordings of any year may be played into
a store.
"""

import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from unlidar.events.event import Now, Row, TrackBegins, TrackEnds
from unlidar.events.site import Place
from unlidar.events.station import Message
from unlidar.history import DAYS, MEGABYTES
from unlidar.history.ageing import Ageing, Mark
from unlidar.history.reader import ROW, Reader
from unlidar.history.schema import Location, open_for_writing
from unlidar.reporting import RateLimitedNote

_NS_PER_DAY = 86_400_000_000_000
_SHARE = 0.05  # share of a station's tracks dropped at once at the size limit
_AT_A_TIME = 500  # tracks per transaction, to keep the lock short
_GAP_NS = 600_000_000_000  # a larger gap means another track of the same number
_MOST_TOLD = 20_000  # per kind, so that a flood of one cannot displace another
# Errors of a single message, which is skipped; all others mean that the store cannot be written.
_BAD_VALUE = (
    ArithmeticError,
    TypeError,
    ValueError,
    sqlite3.DataError,
    sqlite3.InterfaceError,
    sqlite3.ProgrammingError,
)


@dataclass(frozen=True)
class Placed:
    """A station's place, for exports."""

    station: str
    place: Place | None


class Store:
    """A store open for writing by one thread of one process; any number may read.

    Storing the same events again changes nothing. Every method may raise sqlite3.Error (locked,
    full, damaged) without any change, and can be retried.
    """

    def __init__(
        self,
        path: Path | None,
        days: float = DAYS,
        megabytes: float = MEGABYTES,
        ageing: Ageing | None = None,
    ) -> None:
        """`path` None: in memory. OutputError if it cannot be created, or is no store.

        `ageing`: the time base, kept across reopening.
        """
        self.location = Location.of(path)
        self._days_ns = round(days * _NS_PER_DAY)
        self._most_bytes = round(megabytes * 1e6)
        self._ageing = Ageing() if ageing is None else ageing
        self._going_on: dict[tuple[str, int], tuple[int, int, int]] = {}  # id, begin, newest stamp
        self._told = 0  # messages since the last count
        self._bad = RateLimitedNote(f"{self.location}: a message is left out")
        self._db: sqlite3.Connection | None = None
        self._inode = 0
        self.open()

    def open(self) -> None:
        """Opens, or reopens: the file may have been replaced."""
        self.close()
        self._db = open_for_writing(self.location)
        self._inode = self._inode_now()
        with self._transaction() as db:
            now_ns = self._ageing.now_ns()
            # Rows of version 1, or of older writers, get the current time: nothing expires by it.
            for table, stamp in (("track", "newest_ns"), ("told", "at_ns")):
                db.execute(
                    f"UPDATE {table} SET taken_ns = CASE WHEN {stamp} BETWEEN ? AND ? "
                    f"THEN {stamp} ELSE ? END WHERE taken_ns IS NULL",
                    (now_ns - self._days_ns, now_ns, now_ns),
                )
            mark = db.execute("SELECT time_ns, date_ns FROM clock").fetchone()
            if mark is None:
                mark = self._first_mark(db, now_ns)
        self._ageing.begin(mark, self._days_ns)

    def _first_mark(self, db: sqlite3.Connection, now_ns: int) -> Mark | None:
        """The mark of a version 2 store: its times are system times, perhaps in the future."""
        for table in ("track", "told"):
            db.execute(f"UPDATE {table} SET taken_ns = min(taken_ns, ?)", (now_ns,))
        newest = "SELECT max(taken_ns) AS at_ns FROM "
        (newest_ns,) = db.execute(
            f"SELECT max(at_ns) FROM ({newest} track UNION ALL {newest} told)"
        ).fetchone()
        return None if newest_ns is None else (newest_ns, newest_ns)

    def close(self) -> None:
        """Closes the store."""
        if self._db is not None:
            self._db.close()
            self._db = None

    def place(self, station: str, place: Place | None) -> None:
        """Stores a station's place."""
        self.take([Placed(station, place)])

    def take(self, messages: Sequence[Message | Placed]) -> None:
        """Stores all messages or none, except those with values out of range, which are skipped."""
        if self._inode != self._inode_now():
            self.open()
        mark = self._ageing.mark()
        self._going_on = {}  # the cache may be stale if another process wrote
        with self._transaction() as db:
            for message in messages:
                try:
                    self._take(db, message, mark[0])
                except _BAD_VALUE as error:
                    self._bad(" ".join(str(error).split())[:200])
            db.execute("INSERT OR REPLACE INTO clock VALUES (1, ?, ?)", mark)
        self._bound()

    def _take(self, db: sqlite3.Connection, message: Message | Placed, now_ns: int) -> None:
        if isinstance(message, Placed):
            values = (None,) * 4
            if (place := message.place) is not None:
                values = place.latitude_deg, place.longitude_deg, place.height_m, place.heading_deg
            db.execute(
                "INSERT OR REPLACE INTO station VALUES (?, ?, ?, ?, ?)", (message.station, *values)
            )
            return
        event, station = message.event, message.station
        match event:
            case TrackBegins():
                self._track(db, station, event.track, event.first_evidence, now_ns)
            case Row():
                identity = self._track(db, station, event.track, event.timestamp, now_ns)
                new = db.execute(
                    f"INSERT OR IGNORE INTO row (track, stamp_ns, {ROW}) "
                    "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
                    (
                        *(identity, event.timestamp, event.x, event.y, event.z),
                        *(event.vx, event.vy, event.vz),
                        *(event.sigma_x, event.sigma_y, event.sigma_z),
                        *(event.support, event.drone),
                    ),
                ).rowcount
                if new:
                    db.execute(
                        "UPDATE track SET newest_ns = max(newest_ns, ?), taken_ns = ? WHERE id = ?",
                        (event.timestamp, now_ns, identity),
                    )
            case TrackEnds():
                self._going_on.pop((station, event.track), None)
                db.execute(
                    "UPDATE track SET ended = 1 WHERE station = ? AND number = ? AND NOT ended",
                    (station, event.track),
                )
            case Now():
                pass  # the row of that instant follows, and is better
            case _:
                self._told += db.execute(
                    "INSERT OR IGNORE INTO told (at_ns, station, kind, text, taken_ns) "
                    "VALUES (?, ?, ?, ?, ?)",
                    (message.at_ns, station, message.kind, message.text, now_ns),
                ).rowcount

    def _track(
        self, db: sqlite3.Connection, station: str, number: int, stamp_ns: int, now_ns: int
    ) -> int:
        """The id of the track of this number at this time, of one within the gap, or a new one."""
        known = self._going_on.get((station, number))
        if known is not None and known[1] <= stamp_ns <= known[2] + _GAP_NS:
            identity, begin_ns, newest_ns = known
        else:
            found = db.execute(
                "SELECT id, begin_ns, newest_ns FROM track WHERE station = ? AND number = ? "
                "AND begin_ns <= ? AND newest_ns >= ? - (CASE WHEN ended THEN 0 ELSE ? END) "
                "ORDER BY newest_ns >= ? DESC, id DESC LIMIT 1",
                (station, number, stamp_ns, stamp_ns, _GAP_NS, stamp_ns),
            ).fetchone()
            if found is None:
                cursor = db.execute(
                    "INSERT INTO track (station, number, begin_ns, newest_ns, taken_ns) "
                    "VALUES (?, ?, ?, ?, ?)",
                    (station, number, stamp_ns, stamp_ns, now_ns),
                )
                found = cursor.lastrowid, stamp_ns, stamp_ns
            identity, begin_ns, newest_ns = found
        self._going_on[station, number] = identity, begin_ns, max(newest_ns, stamp_ns)
        return identity

    def tidy(self) -> None:
        """Drops data older than the retention, then enforces the size limit.

        Tracks are dropped whole, by the storage time of their newest row.
        """
        self._let_go(self._ageing.mark())
        self._told = _MOST_TOLD  # forces a count
        self._bound()
        self._connection().execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()

    def _let_go(self, mark: Mark) -> None:
        before_ns = mark[0] - self._days_ns
        while self._drop("SELECT id FROM track WHERE taken_ns < ? LIMIT ?", before_ns, _AT_A_TIME):
            pass
        with self._transaction() as db:
            db.execute("DELETE FROM told WHERE taken_ns < ?", (before_ns,))
            db.execute("INSERT OR REPLACE INTO clock VALUES (1, ?, ?)", mark)

    def _bound(self) -> None:
        """Enforces size and count limits at any input rate."""
        if self._told >= _MOST_TOLD // 10:
            self._told = 0
            with self._transaction() as db:
                for (kind,) in db.execute("SELECT DISTINCT kind FROM told").fetchall():
                    db.execute(
                        "DELETE FROM told WHERE kind = ? AND rowid <= (SELECT rowid FROM told "
                        "WHERE kind = ? ORDER BY rowid DESC LIMIT 1 OFFSET ?)",
                        (kind, kind, _MOST_TOLD),
                    )
        while self._bytes() > self._most_bytes and self._drop_oldest():
            pass

    def _drop_oldest(self) -> int:
        """Drops tracks of the station with the most, so that a flood displaces only its own."""
        db = self._connection()
        found = db.execute(
            "SELECT station, count(*) FROM track GROUP BY station ORDER BY 2 DESC LIMIT 1"
        ).fetchone()
        if found is not None:
            station, count = found
            return self._drop(
                "SELECT id FROM track WHERE station = ? ORDER BY taken_ns, id LIMIT ?",
                station,
                min(_AT_A_TIME, int(_SHARE * count) + 1),
            )
        with self._transaction():
            return db.execute(
                "DELETE FROM told WHERE rowid <= (SELECT min(rowid) FROM told) + ?", (_AT_A_TIME,)
            ).rowcount

    def _drop(self, which: str, *values: object) -> int:
        """Deletes tracks; returns their number."""
        with self._transaction() as db:
            chosen = [(identity,) for (identity,) in db.execute(which, values)]
            db.executemany("DELETE FROM row WHERE track = ?", chosen)
            db.executemany("DELETE FROM track WHERE id = ?", chosen)
        db.execute("PRAGMA incremental_vacuum").fetchall()
        return len(chosen)

    def _bytes(self) -> int:
        """Bytes in use, without free pages."""
        pages, free, size = (
            self._connection().execute(f"PRAGMA {name}").fetchone()[0]
            for name in ("page_count", "freelist_count", "page_size")
        )
        return (pages - free) * size

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        db = self._connection()
        db.execute("BEGIN IMMEDIATE")
        try:
            yield db
            db.execute("COMMIT")
        except BaseException:
            if db.in_transaction:
                db.execute("ROLLBACK")
            raise

    def _connection(self) -> sqlite3.Connection:
        if self._db is None:
            self._db = open_for_writing(self.location)
        return self._db

    def _inode_now(self) -> int:
        """The inode of the file, 0 if deleted: SQLite would go on writing to an unlinked file."""
        try:
            return 0 if self.location.path is None else self.location.path.stat().st_ino
        except OSError:
            return 0

    def reader(self) -> Reader:
        """A reader of this store, also of one in memory."""
        return Reader(self.location)
