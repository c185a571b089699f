"""Reading of a store, concurrently with its writer."""

import sqlite3
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from unlidar.errors import InputError, reason
from unlidar.events.clock import AHEAD_S
from unlidar.events.site import Place
from unlidar.events.station import ALARM
from unlidar.history.schema import KIND, READABLE, Location

ROW = "x, y, z, vx, vy, vz, sigma_x, sigma_y, sigma_z, support, drone"
_LEAST_NS, _MOST_NS = -(1 << 63), (1 << 63) - 1  # range of SQLite
_PATIENCE_S = 10.0  # timeout for the store's lock


@dataclass(frozen=True)
class StoredTrack:
    """A track with its rows in the requested time span."""

    identity: int  # unique in the store; numbers of an engine may repeat
    station: str
    number: int
    rows: list[tuple]  # stamp_ns and the columns of a row


class Reader:
    """Unbounded access for commands; for bounded queries of pages see timeline.py."""

    def __init__(self, where: Path | Location) -> None:
        """InputError if there is no store."""
        location = where if isinstance(where, Location) else Location.of(where)
        self._name = str(location)
        if location.path is not None and not location.path.is_file():
            raise InputError(
                f"{location}: is no store, expected what 'unlidar watch --store' wrote"
            )
        try:
            self._db = location.connect("ro", _PATIENCE_S)
            kind, version = (
                self._db.execute(f"PRAGMA {name}").fetchone()[0]
                for name in ("application_id", "user_version")
            )
        except (sqlite3.Error, UnicodeError) as error:
            raise InputError(f"{location}: cannot be read as a store: {reason(error)}") from error
        if kind != KIND or version not in READABLE:
            raise InputError(f"{location}: is no store of this version")
        self._has_clock = version > 2

    def close(self) -> None:
        """Closes the database."""
        self._db.close()

    def tracks(
        self,
        since_ns: int | None = None,
        until_ns: int | None = None,
        station: str | None = None,
    ) -> Iterator[StoredTrack]:
        """Tracks with a row in the time span, in order of begin."""
        low = _LEAST_NS if since_ns is None else _bounded(since_ns)
        high = _MOST_NS if until_ns is None else _bounded(until_ns)
        chosen = self._all(
            "SELECT id, station, number FROM track WHERE newest_ns >= ? AND begin_ns <= ? "
            "AND (? IS NULL OR station = ?) ORDER BY begin_ns, id",
            (low, high, station, station),
        )
        for identity, name, number in chosen:
            rows = self._all(
                f"SELECT stamp_ns, {ROW} FROM row WHERE track = ? AND stamp_ns BETWEEN ? AND ? "
                "ORDER BY stamp_ns",
                (identity, low, high),
            )
            if not {type(value) for row in rows for value in row} <= {int, float, type(None)}:
                raise InputError(f"{self._name}: is damaged: a row of it has no numbers")
            if rows:
                yield StoredTrack(identity, name, number, rows)

    def newest_ns(self) -> int:
        """The newest stamp that is not in the future; 0 for an empty store."""
        clocks = self._all("SELECT time_ns FROM clock", ()) if self._has_clock else []
        # The system clock may have been set back since.
        now_ns = max(time.time_ns(), *(ns for (ns,) in clocks if type(ns) is int), 0)
        ((not_ahead, any_ns),) = self._all(
            "SELECT (SELECT max(newest_ns) FROM track WHERE newest_ns <= ?), "
            "(SELECT max(newest_ns) FROM track)",
            (min(now_ns, 1 << 62) + round(AHEAD_S * 1e9),),
        )
        return not_ahead or any_ns or 0

    def told(self, kind: str, since_ns: int, until_ns: int) -> list[str]:
        """Messages of one kind in a time span."""
        rows = self._all(
            "SELECT text FROM told WHERE kind = ? AND at_ns BETWEEN ? AND ? ORDER BY at_ns, rowid",
            (kind, since_ns, until_ns),
        )
        return [text for (text,) in rows]

    def alarms(self, since_ns: int, until_ns: int) -> list[str]:
        """Alarms raised or ended in a time span."""
        return self.told(ALARM, since_ns, until_ns)

    def place(self, station: str) -> Place | None:
        """A station's place, None if unknown."""
        found = self._all(
            "SELECT latitude_deg, longitude_deg, height_m, heading_deg FROM station "
            "WHERE name = ? AND latitude_deg IS NOT NULL",
            (station,),
        )
        names = "latitude_deg", "longitude_deg", "height_m", "heading_deg"
        return Place(**dict(zip(names, found[0], strict=True))) if found else None

    def stations(self) -> list[str]:
        """The names of all stations."""
        return [name for (name,) in self._all("SELECT DISTINCT station FROM track ORDER BY 1", ())]

    def _all(self, query: str, values: tuple) -> list[tuple]:
        try:
            return self._db.execute(query, values).fetchall()
        except (sqlite3.Error, UnicodeError) as error:
            raise InputError(f"{self._name}: cannot be read: {reason(error)}") from error


def _bounded(stamp_ns: int) -> int:
    return min(max(stamp_ns, _LEAST_NS), _MOST_NS)
