"""Times from the names of a sensor's frames, stamps or numbers, by the program's rules."""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

from unlidar.csv_rows import csv_rows
from unlidar.errors import InputError
from unlidar.sanitize import printable
from unlidar.stamps import NS_PER_S, parse_stamp_ns

_RATES_HZ = 1e-3, 1e9  # up to numbers that are nanoseconds
_LEAST_UNIX_S = 10**8  # 1973: smaller integers are frame numbers
_MOST_UNIX_S = 10**11  # larger numbers are no seconds
_HOUR_S = 3600
# The median difference of numbers, from and to, and how many of these numbers make a second.
_UNITS = (
    (0, 19, 10, "the numbers of frames, 10 frames a second"),
    (20, 2_000, 10**3, "milliseconds"),
    (20_000, 2_000_000, 10**6, "microseconds"),
    (20_000_000, 2_000_000_000, 10**9, "nanoseconds"),
)


@dataclass(frozen=True)
class NamedTimes:
    """Times by name, in the order of the names, with the assumptions made."""

    stamps_ns: list[int | None]  # None: the name is no stamp
    are_numbers: bool
    note: str | None  # for the user, without the name of the folder


def times_of_names(where: object, names: Sequence[str], rate_hz: float | None = None) -> NamedTimes:
    """The times of the frames of one sensor by their names, without suffixes.

    Names that are whole and begin below 1e8 (or, as seconds, lie hours apart) are numbers, of which
    `rate_hz` make a second; without it that follows from their median difference, and is noted. All
    others are stamps. InputError, naming `where`, for numbers whose rate cannot be inferred.
    """
    known = [(name, stamp_ns) for name in names if (stamp_ns := _stamp_ns(name)) is not None]
    numbers = sorted(int(name) for name, _ in known if name.isdecimal())
    if not numbers or len(numbers) < len(known) or not _are_numbers(numbers):
        return NamedTimes([_stamp_ns(name) for name in names], False, None)
    if rate_hz and not _RATES_HZ[0] <= rate_hz <= _RATES_HZ[1]:
        raise InputError(
            f"{where}: {rate_hz:g} numbers a second (--rate), expected {_RATES_HZ[0]:g} to "
            f"{_RATES_HZ[1]:g}"
        )
    note, rate = None, Fraction(rate_hz or 0)
    if not rate_hz:
        step = _median_step(numbers)
        seen = (
            f"{numbers[0]}" if len(numbers) == 1 else f"{numbers[0]} to {numbers[-1]}, {step} apart"
        )
        unit = next((u for u in _UNITS if u[0] <= step <= u[1]), None)
        if unit is None:
            raise InputError(
                f"{where}: names are whole numbers ({seen}), neither numbers of frames nor times "
                "of a LiDAR, expected --rate: how many make a second"
            )
        rate = Fraction(unit[2])
        note = (
            f"names are whole numbers ({seen}), no stamps: taken as {unit[3]}; "
            "--rate says how many make a second"
        )
    stamps_ns = [
        _nearest(int(name) * NS_PER_S / rate) if name.isdecimal() else None for name in names
    ]
    return NamedTimes(stamps_ns, True, note)


def stamps_of_table(table: Path, paths: Sequence[Path]) -> list[int]:
    """The stamps of a sensor's files by a table `file,timestamp`, in the order of `paths`.

    The table takes precedence over names. InputError for a malformed table, a row without a
    file, and a file without a row or with an invalid stamp.
    """
    stamps_ns: dict[str, int] = {}
    known = {path.name for path in paths}
    for row in csv_rows(table, ("file", "timestamp")):
        name, text = row.values["file"].strip(), row.values["timestamp"].strip()
        if name not in known:
            raise InputError(
                f"{row.where}: '{printable(name)}' is no frame in this folder, expected the name "
                "of a file in it"
            )
        if name in stamps_ns:
            raise InputError(
                f"{row.where}: '{printable(name)}' is listed a second time, expected one stamp "
                "for each file"
            )
        if (stamp_ns := _stamp_ns(text)) is None:
            raise InputError(
                f"{row.where}: '{printable(text)}' of '{printable(name)}' is no time stamp"
            )
        stamps_ns[name] = stamp_ns
    if missing := next((path for path in paths if path.name not in stamps_ns), None):
        raise InputError(
            f"{table}: no stamp for '{printable(missing.name)}', expected one for every "
            f"{missing.suffix} file"
        )
    return [stamps_ns[path.name] for path in paths]


def rate_of(config: dict, sensor: str) -> float | None:
    """Numbers a second of a sensor's frames by the program's effective configuration, if given."""
    own = config.get("sensors", {}).get(sensor, {}).get("frame_rate_hz", 0)
    return own or config.get("input", {}).get("frame_rate_hz", 0) or None


def _stamp_ns(name: str) -> int | None:
    try:
        return parse_stamp_ns(name)
    except ValueError:
        return None


def _are_numbers(numbers: list[int]) -> bool:
    if numbers[0] < _LEAST_UNIX_S:
        return True
    return numbers[-1] < _MOST_UNIX_S and _median_step(numbers) > _HOUR_S


def _median_step(numbers: list[int]) -> int:
    steps = sorted(b - a for a, b in pairwise(numbers))
    return steps[(len(steps) - 1) // 2] if steps else 0


def _nearest(time_ns: Fraction) -> int:
    return int(time_ns + Fraction(1, 2))
