"""95 % intervals by block bootstrap, as consecutive errors are correlated."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from unlidar.evaluate_options import Options

LEVEL = 0.95
_OF_OWN = {"matched": "coverage", "matched_rmse": "rmse"}  # measures of the matched tracks


@dataclass(frozen=True)
class Drawn:
    """The population of the bootstrap: the in-view truth of one sequence, in order of time."""

    time_s: np.ndarray  # (N,)
    nearest_m: np.ndarray  # (N, 3) error of the nearest track, NaN where there is none
    own_m: np.ndarray  # (N, 3) error of the matched track, NaN where there is none


def intervals(
    sequences: Sequence[Drawn], within_m: float, options: Options
) -> dict[str, tuple[float, float]]:
    """Percentile intervals of the measures at the truth's stamps, by name.

    Circular blocks (Politis and Romano 1992): a replicate of a sequence of duration T is put
    together from ceil(T / block_s) stretches of block_s that begin anywhere; after its last row
    comes its first, so that every row is drawn equally often. With several sequences each
    replicate also resamples the sequences: flights differ more than blocks of one flight.
    """
    sequences = [one for one in sequences if len(one.time_s)]
    if not sequences:
        return {}
    rng = np.random.default_rng(options.seed)
    nearest = _Weighted(np.concatenate([one.nearest_m for one in sequences]), within_m)
    own = _Weighted(np.concatenate([one.own_m for one in sequences]), within_m)
    drawn: dict[str, list[float]] = {}
    for _ in range(options.bootstrap):
        chosen = rng.integers(len(sequences), size=len(sequences)) if len(sequences) > 1 else [0]
        weight = [np.zeros(len(one.time_s)) for one in sequences]
        for i in chosen:
            weight[i] += times_drawn(sequences[i].time_s, options.block_s, rng)
        weights = np.concatenate(weight)
        matched = own.of(weights)
        found = nearest.of(weights) | {
            name: matched[of_own] for name, of_own in _OF_OWN.items() if of_own in matched
        }
        for name, value in found.items():
            drawn.setdefault(name, []).append(value)
    tails = 50 * (1 - LEVEL), 50 * (1 + LEVEL)
    return {name: tuple(np.percentile(values, tails)) for name, values in drawn.items()}


def times_drawn(time_s: np.ndarray, block_s: float, rng: np.random.Generator) -> np.ndarray:
    """Multiplicity of each row, in order of time, in a replicate."""
    stamps = np.unique(time_s)
    if len(stamps) == 1:
        return np.ones(len(time_s))
    begin, end = stamps[0], stamps[-1]
    around = end - begin + np.median(np.diff(stamps))  # period of the circle
    block_s = min(block_s, around)
    starts = rng.uniform(begin, begin + around, int(np.ceil(around / block_s)))
    stops = starts + block_s
    beyond = stops[stops > begin + around] - around  # wrap around
    steps = np.zeros(len(time_s) + 1)
    np.add.at(steps, np.searchsorted(time_s, starts), 1)
    np.add.at(steps, np.searchsorted(time_s, stops), -1)
    steps[0] += len(beyond)
    np.add.at(steps, np.searchsorted(time_s, beyond), -1)
    return np.cumsum(steps)[:-1]


class _Weighted:
    """Measures of weighted rows, without repeating the rows in memory."""

    def __init__(self, error_m: np.ndarray, within_m: float) -> None:
        self._covered = np.isfinite(error_m).all(axis=1)
        self._squared = error_m[self._covered] ** 2
        self._distance = np.sqrt(self._squared.sum(axis=1))
        self._within = self._distance < within_m
        self._order = np.argsort(self._distance)
        self._sorted = self._distance[self._order]

    def of(self, weight: np.ndarray) -> dict[str, float]:
        found: dict[str, float] = {}
        if (drawn := weight.sum()) == 0:  # all blocks fell into gaps
            return found
        weight = weight[self._covered]
        total = weight.sum()
        found |= {"coverage": total / drawn, "within1m": _dot(weight, self._within) / drawn}
        if total == 0:
            return found
        squared = _dot(weight, self._squared) / total
        counts = np.cumsum(weight[self._order])
        return found | {
            "rmse": float(np.sqrt(squared.sum())),
            "mse": float(squared.sum()),
            "ape": float(_dot(weight, self._distance) / total),
            "median": self._quantile(counts, 0.5),
            "p95": self._quantile(counts, 0.95),
            **{f"d{axis}": float(np.sqrt(squared[i])) for i, axis in enumerate("xyz")},
        }

    def _quantile(self, counts: np.ndarray, share: float) -> float:
        """Weighted quantile, equal to np.percentile of the repeated rows."""
        rank = (counts[-1] - 1) * share
        below, above = np.searchsorted(counts, [np.floor(rank), np.ceil(rank)], side="right")
        low, high = self._sorted[below], self._sorted[above]
        return float(low + (rank - np.floor(rank)) * (high - low))


def _dot(weight: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Dot product without BLAS, whose threads cost more than such a small product."""
    return np.einsum("i,i...->...", weight, rows)
