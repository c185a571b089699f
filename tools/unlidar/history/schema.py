"""The store's file: tables, opening, migration, and replacement of damaged files."""

import itertools
import sqlite3
from dataclasses import dataclass
from pathlib import Path

from unlidar.errors import OutputError, reason
from unlidar.reporting import note

KIND = 0x554E4C44  # PRAGMA application_id: "UNLD"
VERSION = 3
READABLE = 1, 2, VERSION  # versions with the same tables for readers
_TABLES = f"""
PRAGMA application_id = {KIND};
PRAGMA user_version = 1;
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
# Time of storage: retention does not trust stamps.
_SINCE_VERSION_1 = """
ALTER TABLE track ADD COLUMN taken_ns INTEGER;
ALTER TABLE told ADD COLUMN taken_ns INTEGER;
CREATE INDEX track_taken ON track (taken_ns);
CREATE INDEX told_taken ON told (taken_ns);
CREATE INDEX told_kind ON told (kind, at_ns);
"""
# Pairs of store time, in which taken_ns is given, and system time: see ageing.py.
_SINCE_VERSION_2 = f"""
PRAGMA user_version = {VERSION};
CREATE TABLE clock (
  id INTEGER PRIMARY KEY CHECK (id = 1), time_ns INTEGER NOT NULL, date_ns INTEGER NOT NULL
);
"""
_SINCE = {1: _SINCE_VERSION_1 + _SINCE_VERSION_2, 2: _SINCE_VERSION_2}
_BUSY_S = 1.0
_REFUSED = {
    sqlite3.SQLITE_CANTOPEN,
    sqlite3.SQLITE_NOTADB,
    sqlite3.SQLITE_PERM,
    sqlite3.SQLITE_READONLY,
}
_IN_MEMORY = itertools.count(1)


@dataclass(frozen=True)
class Location:
    """A file, or a database in memory that lasts while a connection to it is open."""

    path: Path | None
    uri: str

    @classmethod
    def of(cls, path: Path | None) -> "Location":
        """The location of `path`; None: a new database in memory."""
        if path is None:
            return cls(None, f"file:/unlidar-{next(_IN_MEMORY)}?vfs=memdb&mode=")
        return cls(path, f"{path.absolute().as_uri()}?mode=")

    def __str__(self) -> str:
        return "memory" if self.path is None else str(self.path)

    def connect(self, mode: str, busy_s: float = _BUSY_S) -> sqlite3.Connection:
        """`mode` rwc or ro. For any thread, but one at a time. sqlite3.Error."""
        return sqlite3.connect(
            self.uri + mode, uri=True, isolation_level=None, timeout=busy_s, check_same_thread=False
        )


def open_for_writing(location: Location) -> sqlite3.Connection:
    """OutputError if the file is no store; sqlite3.Error if opening may succeed later.

    A store whose header is damaged is set aside and replaced.
    """
    try:
        return _opened(location)
    except sqlite3.Error as error:
        if is_damage(error) and set_aside(location):
            return _opened(location)
        if error_code(error) in _REFUSED:
            raise OutputError(f"{location}: cannot be a store: {reason(error)}") from error
        raise


def _opened(location: Location) -> sqlite3.Connection:
    path = location.path
    if path is not None and path.exists() and not path.is_file():
        raise OutputError(f"{path}: cannot be a store: is no file")
    db = location.connect("rwc")
    try:
        _prepare(db, location)
    except BaseException:
        db.close()
        raise
    return db


def _prepare(db: sqlite3.Connection, location: Location) -> None:
    kind, version, tables = (
        db.execute(query).fetchone()[0]
        for query in (
            "PRAGMA application_id",
            "PRAGMA user_version",
            "SELECT count(*) FROM sqlite_master",
        )
    )
    if tables and (kind != KIND or version not in READABLE):
        raise OutputError(f"{location}: is a database, but no store of this version")
    if not tables:
        db.execute("PRAGMA auto_vacuum = INCREMENTAL")
    db.execute("PRAGMA journal_mode = WAL")
    # A power cut may lose the last seconds, but never corrupts the file.
    db.execute("PRAGMA synchronous = NORMAL")
    if not tables:
        db.executescript(f"BEGIN IMMEDIATE; {_TABLES} {_SINCE[1]} COMMIT;")
    elif version < VERSION:
        db.executescript(f"BEGIN IMMEDIATE; {_SINCE[version]} COMMIT;")


def error_code(error: sqlite3.Error) -> int:
    """SQLite's primary code; -1 where Python has raised it."""
    return getattr(error, "sqlite_errorcode", -1) & 0xFF


def is_damage(error: sqlite3.Error) -> bool:
    """True for corrupt content, as opposed to a locked, full or unreachable store."""
    return error_code(error) in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)


def set_aside(location: Location) -> bool:
    """Renames a damaged store; False if the file is no store, which is left untouched.

    Only the newest such file is kept, so that a bad disk does not fill up.
    """
    path = location.path
    if path is None or not _is_ours(path):
        return False
    aside = path.with_name(f"{path.name}.damaged")
    for suffix in ("-wal", "-shm", ""):
        with_suffix = Path(f"{path}{suffix}")
        if with_suffix.exists():
            with_suffix.replace(f"{aside}{suffix}")
    note(f"{path}: is damaged; kept as {aside.name}, and a new store is begun")
    return True


def _is_ours(path: Path) -> bool:
    """True if the file header has the application id."""
    try:
        with path.open("rb") as file:
            head = file.read(100)
    except OSError:
        return False
    return head.startswith(b"SQLite format 3\0") and head[68:72] == KIND.to_bytes(4, "big")
