"""The store: one SQLite file in WAL mode, bounded by days and by size."""

import sqlite3
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from unlidar_tools.errors import InputError, OutputError, reason
from unlidar_tools.events.event import Row, TrackBegins, TrackEnds
from unlidar_tools.events.site import Place
from unlidar_tools.events.station import ALARM, Message
from unlidar_tools.history import DAYS, MEGABYTES
from unlidar_tools.telling import Often

_NS_PER_DAY = 86_400_000_000_000
_KIND = 0x554E4C44  # PRAGMA application_id: "UNLD"
_VERSION = 1
_SHARE = 0.05  # of what there is goes at a time when the size is reached
_SCHEMA = f"""
PRAGMA application_id = {_KIND};
PRAGMA user_version = {_VERSION};
CREATE TABLE station (
  name TEXT PRIMARY KEY, latitude_deg REAL, longitude_deg REAL, height_m REAL, heading_deg REAL
) WITHOUT ROWID;
CREATE TABLE track (
  id INTEGER PRIMARY KEY, station TEXT NOT NULL, number INTEGER NOT NULL,
  begin_ns INTEGER NOT NULL, newest_ns INTEGER NOT NULL, ended INTEGER NOT NULL DEFAULT 0
);
CREATE INDEX track_number ON track (station, number, id);
CREATE INDEX track_time ON track (newest_ns);
CREATE TABLE row (
  track INTEGER NOT NULL REFERENCES track (id), stamp_ns INTEGER NOT NULL,
  x REAL NOT NULL, y REAL NOT NULL, z REAL NOT NULL,
  vx REAL NOT NULL, vy REAL NOT NULL, vz REAL NOT NULL,
  sigma_x REAL NOT NULL, sigma_y REAL NOT NULL, sigma_z REAL NOT NULL,
  support REAL NOT NULL, drone REAL,
  PRIMARY KEY (track, stamp_ns)
) WITHOUT ROWID;
CREATE TABLE told (
  at_ns INTEGER NOT NULL, station TEXT NOT NULL, kind TEXT NOT NULL, text TEXT NOT NULL,
  UNIQUE (at_ns, station, kind, text)
);
"""
_ROW = "x, y, z, vx, vy, vz, sigma_x, sigma_y, sigma_z, support, drone"


@dataclass(frozen=True)
class StoredTrack:
    """A track and, of the time that was asked for, its rows."""

    identity: int  # unique in the store, where an engine's numbers may begin again
    station: str
    number: int
    rows: list[tuple]  # stamp_ns and the columns of a row


class Store:
    """Open for writing; one process at a time writes, any number reads.

    Taking the same events in again changes nothing.
    """

    def __init__(self, path: Path | None, days: float = DAYS, megabytes: float = MEGABYTES) -> None:
        """`path` None: in memory. OutputError where it cannot be, or is something else."""
        self._path = path
        self._days_ns = round(days * _NS_PER_DAY)
        self._most_bytes = round(megabytes * 1e6)
        self._open_tracks: dict[tuple[str, int], tuple[int, int]] = {}  # -> id, begin
        self._newest_ns = 0
        self._failed = Often(f"{path}: cannot be written, what comes is not kept")
        try:
            self._db = sqlite3.connect(
                ":memory:" if path is None else path, isolation_level=None, timeout=10
            )
            self._prepare()
        except sqlite3.Error as error:
            raise OutputError(f"{path}: cannot be a store: {reason(error)}") from error

    def _prepare(self) -> None:
        db = self._db
        kind, version, tables = (
            db.execute(query).fetchone()[0]
            for query in (
                "PRAGMA application_id",
                "PRAGMA user_version",
                "SELECT count(*) FROM sqlite_master",
            )
        )
        if tables and (kind, version) != (_KIND, _VERSION):
            raise OutputError(f"{self._path}: is a database, but no store of this version")
        if not tables:
            db.execute("PRAGMA auto_vacuum = INCREMENTAL")
        db.execute("PRAGMA journal_mode = WAL")
        # A power cut may take the last seconds, and never the file.
        db.execute("PRAGMA synchronous = NORMAL")
        if not tables:
            db.executescript(f"BEGIN; {_SCHEMA} COMMIT;")
        self._newest_ns = (
            db.execute("SELECT coalesce(max(newest_ns), 0) FROM track").fetchone()[0] or 0
        )
        for identity, station, number, begin_ns in db.execute(
            "SELECT max(id), station, number, begin_ns FROM track WHERE NOT ended "
            "GROUP BY station, number"
        ):
            self._open_tracks[station, number] = identity, begin_ns

    def close(self) -> None:
        """Nothing is taken in any more."""
        self._db.close()

    def place(self, station: str, place: Place | None) -> None:
        """Where a station stands, for exports."""
        values = (None,) * 4
        if place is not None:
            values = place.latitude_deg, place.longitude_deg, place.height_m, place.heading_deg
        self._db.execute(
            "INSERT OR REPLACE INTO station VALUES (?, ?, ?, ?, ?)", (station, *values)
        )

    def take(self, messages: Sequence[Message]) -> None:
        """Keeps them, all or none; where the disk is full it is said and the next are tried."""
        known = dict(self._open_tracks)
        try:
            self._db.execute("BEGIN IMMEDIATE")
            try:
                for message in messages:
                    self._take(message)
                self._db.execute("COMMIT")
            except BaseException:
                self._db.execute("ROLLBACK") if self._db.in_transaction else None
                raise
        except sqlite3.Error as error:
            self._open_tracks = known
            self._failed(reason(error))

    def _take(self, message: Message) -> None:
        self._newest_ns = max(self._newest_ns, message.at_ns)
        event, station = message.event, message.station
        match event:
            case TrackBegins():
                self._track(station, event.track, event.first_evidence)
            case Row():
                identity = self._track(station, event.track, event.timestamp)
                self._db.execute(
                    f"INSERT OR IGNORE INTO row (track, stamp_ns, {_ROW}) "
                    "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
                    (
                        *(identity, event.timestamp, event.x, event.y, event.z),
                        *(event.vx, event.vy, event.vz),
                        *(event.sigma_x, event.sigma_y, event.sigma_z),
                        *(event.support, event.drone),
                    ),
                )
                self._db.execute(
                    "UPDATE track SET newest_ns = max(newest_ns, ?) WHERE id = ?",
                    (event.timestamp, identity),
                )
            case TrackEnds():
                found = self._open_tracks.pop((station, event.track), None)
                if found is not None:
                    self._db.execute("UPDATE track SET ended = 1 WHERE id = ?", (found[0],))
            case _:
                self._db.execute(
                    "INSERT OR IGNORE INTO told VALUES (?, ?, ?, ?)",
                    (message.at_ns, station, message.kind, message.text),
                )

    def _track(self, station: str, number: int, stamp_ns: int) -> int:
        """The track that goes on under this number; else one that has this instant; else new."""
        key = station, number
        if key in self._open_tracks and stamp_ns >= self._open_tracks[key][1]:
            return self._open_tracks[key][0]
        found = self._db.execute(
            "SELECT id, begin_ns FROM track WHERE station = ? AND number = ? AND begin_ns <= ? "
            "AND newest_ns >= ? ORDER BY id DESC LIMIT 1",
            (station, number, stamp_ns, stamp_ns),
        ).fetchone()
        if found is None:
            cursor = self._db.execute(
                "INSERT INTO track (station, number, begin_ns, newest_ns) VALUES (?, ?, ?, ?)",
                (station, number, stamp_ns, stamp_ns),
            )
            found = cursor.lastrowid, stamp_ns
        self._open_tracks[key] = found
        return found[0]

    def tidy(self) -> None:
        """Lets go what is older than the days, then the oldest until the size is kept.

        A track goes as a whole, by its newest row.
        """
        try:
            self._drop_before(self._newest_ns - self._days_ns)
            while self._bytes() > self._most_bytes:
                count = self._db.execute("SELECT count(*) FROM track").fetchone()[0]
                oldest = self._db.execute(
                    "SELECT newest_ns FROM track ORDER BY newest_ns LIMIT 1 OFFSET ?",
                    (int(_SHARE * count),),
                ).fetchone()
                if oldest is None:  # what the stations told of themselves is all there is
                    oldest = self._db.execute("SELECT avg(at_ns) FROM told").fetchone()
                if oldest[0] is None or not self._drop_before(int(oldest[0]) + 1):
                    break
            self._db.execute("PRAGMA incremental_vacuum").fetchall()
            self._db.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
        except sqlite3.Error as error:
            self._failed(reason(error))

    def _drop_before(self, stamp_ns: int) -> int:
        """How much went."""
        db = self._db
        db.execute("BEGIN IMMEDIATE")
        try:
            old = "SELECT id FROM track WHERE newest_ns < ?"
            db.execute(f"DELETE FROM row WHERE track IN ({old})", (stamp_ns,))
            gone = db.execute("DELETE FROM track WHERE newest_ns < ?", (stamp_ns,)).rowcount
            gone += db.execute("DELETE FROM told WHERE at_ns < ?", (stamp_ns,)).rowcount
            db.execute("COMMIT")
        except BaseException:
            db.execute("ROLLBACK") if db.in_transaction else None
            raise
        if gone:
            alive = {i for (i,) in db.execute("SELECT id FROM track WHERE NOT ended")}
            self._open_tracks = {k: v for k, v in self._open_tracks.items() if v[0] in alive}
        return gone

    def _bytes(self) -> int:
        """What is in use, without the pages that are free again."""
        pages, free, size = (
            self._db.execute(f"PRAGMA {name}").fetchone()[0]
            for name in ("page_count", "freelist_count", "page_size")
        )
        return (pages - free) * size

    def reader(self) -> "Reader":
        """Reads what this store holds, also one in memory; of this thread only."""
        return Reader(self._path, self._db)


class Reader:
    """Reads a store, also while another process writes it."""

    def __init__(self, path: Path | None, db: sqlite3.Connection | None = None) -> None:
        """InputError where there is no store."""
        self._path = path
        if db is not None:
            self._db = db
            return
        assert path is not None
        if not path.is_file():
            raise InputError(f"{path}: is no store, expected what 'unlidar watch --store' wrote")
        try:
            self._db = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True, timeout=10)
            kind, version = (
                self._db.execute(f"PRAGMA {name}").fetchone()[0]
                for name in ("application_id", "user_version")
            )
        except sqlite3.Error as error:
            raise InputError(f"{path}: cannot be read as a store: {reason(error)}") from error
        if (kind, version) != (_KIND, _VERSION):
            raise InputError(f"{path}: is no store of this version")

    def close(self) -> None:
        """Nothing is read any more."""
        self._db.close()

    def tracks(
        self,
        since_ns: int | None = None,
        until_ns: int | None = None,
        station: str | None = None,
    ) -> Iterator[StoredTrack]:
        """Those with a row in the time asked for, in the order of their begins."""
        low = -(1 << 63) if since_ns is None else since_ns
        high = (1 << 63) - 1 if until_ns is None else until_ns
        chosen = self._all(
            "SELECT id, station, number FROM track WHERE newest_ns >= ? AND begin_ns <= ? "
            "AND (? IS NULL OR station = ?) ORDER BY begin_ns, id",
            (low, high, station, station),
        )
        for identity, name, number in chosen:
            rows = self._all(
                f"SELECT stamp_ns, {_ROW} FROM row WHERE track = ? AND stamp_ns BETWEEN ? AND ? "
                "ORDER BY stamp_ns",
                (identity, low, high),
            )
            if rows:
                yield StoredTrack(identity, name, number, rows)

    def spans(self) -> list[tuple[str, int, int, int]]:
        """Station, number, first and newest stamp of each track."""
        return self._all(
            "SELECT station, number, begin_ns, newest_ns FROM track ORDER BY begin_ns", ()
        )

    def told(self, kind: str, since_ns: int, until_ns: int) -> list[str]:
        """Texts of one kind in a time."""
        rows = self._all(
            "SELECT text FROM told WHERE kind = ? AND at_ns BETWEEN ? AND ? ORDER BY at_ns, rowid",
            (kind, since_ns, until_ns),
        )
        return [text for (text,) in rows]

    def alarms(self, since_ns: int, until_ns: int) -> list[str]:
        """Alarms that were raised or ended in a time."""
        return self.told(ALARM, since_ns, until_ns)

    def place(self, station: str) -> Place | None:
        """Where a station stands, where that is known."""
        found = self._all(
            "SELECT latitude_deg, longitude_deg, height_m, heading_deg FROM station "
            "WHERE name = ? AND latitude_deg IS NOT NULL",
            (station,),
        )
        names = "latitude_deg", "longitude_deg", "height_m", "heading_deg"
        return Place(**dict(zip(names, found[0], strict=True))) if found else None

    def stations(self) -> list[str]:
        """Their names."""
        return [name for (name,) in self._all("SELECT DISTINCT station FROM track ORDER BY 1", ())]

    def _all(self, query: str, values: tuple) -> list[tuple]:
        try:
            return self._db.execute(query, values).fetchall()
        except sqlite3.Error as error:
            raise InputError(f"{self._path}: cannot be read: {reason(error)}") from error
