"""Time stamps as integer nanoseconds; a float loses the last digits of Unix time."""

import re
from decimal import ROUND_HALF_UP, Decimal

_UNSIGNED = r"([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]{1,3})?"
_STAMP, _SECONDS = re.compile(f"-?{_UNSIGNED}"), re.compile(f"[+-]?{_UNSIGNED}")
NS_PER_S = 1_000_000_000
_LIMIT_NS = 1 << 63
MOST_STAMP_NS = 4 * 10**18  # the program's limit: 126 years before and after 1970


def parse_stamp_ns(text: str) -> int:
    """A stamp by the program's rules: seconds with a point or exponent, else unit by magnitude.

    Whole numbers are seconds below 1e11, then milli-, micro- and from 1e17 nanoseconds.
    ValueError for anything else, and beyond 64 bits.
    """
    if not _STAMP.fullmatch(text):
        raise ValueError(f"'{text}' is not a time stamp")
    ns_per_unit = NS_PER_S
    if text.lstrip("-").isdigit():
        magnitude = len(text.lstrip("-0"))
        limits = ((11, NS_PER_S), (14, 10**6), (17, 10**3))
        ns_per_unit = next((unit for digits, unit in limits if magnitude <= digits), 1)
    return _to_ns(text, ns_per_unit)


def parse_seconds_ns(text: str) -> int:
    """Decimal seconds to the nearest nanosecond; ValueError if not a number."""
    if not _SECONDS.fullmatch(text.strip()):
        raise ValueError(f"'{text}' is not a number of seconds")
    return _to_ns(text.strip(), NS_PER_S)


def format_stamp(stamp_ns: int) -> str:
    """Decimal seconds with microseconds, or nanoseconds where they are needed."""
    text = format_stamp_ns(stamp_ns)
    return text.removesuffix("000")


def format_stamp_ns(stamp_ns: int) -> str:
    """Decimal seconds with all nine digits."""
    seconds, rest = divmod(abs(stamp_ns), NS_PER_S)
    return f"{'-' if stamp_ns < 0 else ''}{seconds}.{rest:09d}"


def _to_ns(text: str, ns_per_unit: int) -> int:
    stamp_ns = int((Decimal(text) * ns_per_unit).to_integral_value(ROUND_HALF_UP))
    if not -_LIMIT_NS <= stamp_ns < _LIMIT_NS:
        raise ValueError(f"'{text[:40]}' is not a time stamp: more than 292 years from 1970")
    return stamp_ns
