"""Time stamps as integer nanoseconds; a float loses the last digits of Unix time."""

import re
from decimal import ROUND_HALF_UP, Decimal

_NUMBER = re.compile(r"-?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,3})?")
_NS_PER_S = 1_000_000_000


def parse_stamp_ns(text: str) -> int:
    """By the program's rules: with a point or an exponent seconds, else the unit by magnitude.

    Whole numbers are seconds below 1e11, then milli-, micro- and from 1e17 nanoseconds.
    ValueError for anything else.
    """
    if not _NUMBER.fullmatch(text):
        raise ValueError(f"'{text}' is not a time stamp")
    value = Decimal(text)
    ns_per_unit = _NS_PER_S
    if text.lstrip("-").isdigit():
        ns_per_unit = next(
            (
                n
                for limit, n in ((11, _NS_PER_S), (14, 10**6), (17, 10**3))
                if abs(value) < 10**limit
            ),
            1,
        )
    return int((value * ns_per_unit).to_integral_value(ROUND_HALF_UP))


def seconds_to_ns(text: str) -> int:
    """Decimal seconds, of whatever size, to the nearest nanosecond."""
    return int((Decimal(text.strip()) * _NS_PER_S).to_integral_value(ROUND_HALF_UP))


def format_stamp(stamp_ns: int) -> str:
    """Decimal seconds with microseconds, or nanoseconds where they are needed."""
    seconds, rest = divmod(stamp_ns, _NS_PER_S)
    return f"{seconds}.{rest // 1000:06d}" if rest % 1000 == 0 else f"{seconds}.{rest:09d}"


def format_stamp_ns(stamp_ns: int) -> str:
    """Decimal seconds with all nine digits."""
    seconds, rest = divmod(stamp_ns, _NS_PER_S)
    return f"{seconds}.{rest:09d}"
