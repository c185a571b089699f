"""Types of command-line arguments that several sub-commands share."""

import argparse
import math

from unlidar.errors import UsageError
from unlidar.geodesy import Origin


def number(text: str) -> float:
    """A finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"'{text}', expected a number")
    return value


def positive(text: str) -> float:
    """A number above 0."""
    if (value := number(text)) <= 0:
        raise argparse.ArgumentTypeError(f"'{text}', expected a number above 0")
    return value


def not_negative(text: str) -> float:
    """A number from 0 on."""
    if (value := number(text)) < 0:
        raise argparse.ArgumentTypeError(f"'{text}', expected a number from 0 on")
    return value


def whole(text: str) -> int:
    """A whole number from 0 on."""
    return _whole_from(0, text)


def count(text: str) -> int:
    """A whole number from 1 on."""
    return _whole_from(1, text)


def origin(text: str) -> Origin:
    """`LAT,LON,HEIGHT` of --origin."""
    parts = [number(part) for part in text.split(",")]
    if len(parts) != 3:
        raise argparse.ArgumentTypeError(f"'{text}', expected LAT,LON,HEIGHT in degrees and metres")
    try:
        return Origin(*parts)
    except UsageError as error:
        raise argparse.ArgumentTypeError(f"'{text}', {error}") from error


def _whole_from(least: int, text: str) -> int:
    if not text.isdecimal() or int(text) < least:
        raise argparse.ArgumentTypeError(f"'{text}', expected a whole number from {least} on")
    return int(text)
