"""Numbers as a reader wants them."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Column:
    """What of a row stands below a title."""

    title: str
    key: str
    text: Callable[[Any], str] = str


def cell(column: Column, row: dict) -> str:
    """The text of a value; a dash where the row has none, or None or NaN."""
    value = row.get(column.key)
    missing = value is None or (isinstance(value, float) and math.isnan(value))
    return "-" if missing else column.text(value)


def markdown(columns: Sequence[Column], rows: Sequence[dict]) -> str:
    """A table, a line for each row."""
    lines = [
        [column.title for column in columns],
        ["---" if column.text is str else "---:" for column in columns],
        *([cell(column, row) for column in columns] for row in rows),
    ]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def digits(value: float) -> str:
    """Three of them."""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:#.3g}"


def whole(value: float) -> str:
    """Thousands apart."""
    return f"{value:,.0f}"


def times(value: float) -> str:
    """A ratio; the one of the reference itself is 1."""
    return f"{value:.3g}" if value >= 0.01 else f"{value:.1g}"


def percent(value: float) -> str:
    """Of a share."""
    return f"{100 * value:.1f} %"


def metres(value: float) -> str:
    """To the centimetre."""
    return f"{value:.2f}"
