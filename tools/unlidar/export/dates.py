"""Dates of stamps, and the note where they cannot be those of a flight."""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from unlidar.reporting import note
from unlidar.stamps import format_stamp_ns

DATED = ("csv", "kml", "geojson", "courageous")  # the formats that have dates
_OLDEST_NS = 946_684_800 * 10**9  # the year 2000: no recording of a LiDAR is older


def utc(stamp_ns: int) -> str:
    """ISO 8601 with nanoseconds."""
    seconds, rest = divmod(int(stamp_ns), 1_000_000_000)
    return f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%dT%H:%M:%S}.{rest:09d}Z"


def note_dates(source: Path, stamps_ns: np.ndarray, what: str) -> None:
    """Notes stamps that are no Unix time, as those that count from a recording's begin.

    `what` has the dates, for the note.
    """
    oldest_ns = int(stamps_ns.min(initial=_OLDEST_NS))
    if oldest_ns < _OLDEST_NS:
        note(
            f"{source}: stamp {format_stamp_ns(oldest_ns)} is no Unix time, as of "
            f"{utc(oldest_ns)[:4]}: dates in {what} are not those of the flight"
        )
