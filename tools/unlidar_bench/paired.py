"""Measurements by turns, so that their ratios hold where others use the machine too."""

from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

import numpy as np

T = TypeVar("T")


def by_turns(
    rounds: int, contestants: Mapping[str, Callable[[], T]], first: int = 0
) -> dict[str, list[T]]:
    """What each contestant gives in each round: all take their turn before the next round begins.

    The order is turned from round to round: nobody always has the machine as the same one left it.
    `first` is how far it is turned at the start.
    """
    found: dict[str, list[T]] = {name: [] for name in contestants}
    names = list(contestants)
    for turn in range(first, first + rounds):
        shift = turn % len(names)
        for name in names[shift:] + names[:shift]:
            found[name].append(contestants[name]())
    return found


def median(values: Sequence[float]) -> float:
    """NaN of nothing."""
    return float(np.median(values)) if len(values) else float("nan")


def mean_of_known(values: Sequence[float | None]) -> float | None:
    """Of those that are defined; None if none is."""
    known = [value for value in values if value is not None]
    return sum(known) / len(known) if known else None


def ratio(values: Sequence[float], reference: Sequence[float]) -> float:
    """The median of the ratios of each round."""
    return median([a / b for a, b in zip(values, reference, strict=True)])
