"""95 % intervals that know that errors a moment apart are alike."""

from collections.abc import Sequence

import numpy as np

from unlidar_tools.evaluate_options import Options

LEVEL = 0.95


def intervals(
    sequences: Sequence[tuple[np.ndarray, np.ndarray]], within_m: float, options: Options
) -> dict[str, tuple[float, float]]:
    """Percentile intervals of the measures at the truth's stamps, by name.

    A sequence is the times (N,) and errors (N, 3) of its in-view truth, in order of time, NaN
    where not covered. Moving blocks (Kuensch 1989): a replicate of a sequence of duration T is
    put together from ceil(T / block_s) stretches of block_s that begin anywhere. With several
    sequences each replicate also draws the sequences anew, as flights differ more than moments.
    """
    sequences = [one for one in sequences if len(one[0])]
    if not sequences:
        return {}
    rng = np.random.default_rng(options.seed)
    measures = _Weighted(np.concatenate([error for _, error in sequences]), within_m)
    drawn: dict[str, list[float]] = {}
    for _ in range(options.bootstrap):
        chosen = rng.integers(len(sequences), size=len(sequences)) if len(sequences) > 1 else [0]
        weight = [np.zeros(len(time_s)) for time_s, _ in sequences]
        for i in chosen:
            weight[i] += _times_drawn(sequences[i][0], options.block_s, rng)
        for name, value in measures.of(np.concatenate(weight)).items():
            drawn.setdefault(name, []).append(value)
    tails = 50 * (1 - LEVEL), 50 * (1 + LEVEL)
    return {name: tuple(np.percentile(values, tails)) for name, values in drawn.items()}


class _Weighted:
    """Measures of rows that occur so many times each, without writing them out: an hour is long."""

    def __init__(self, error_m: np.ndarray, within_m: float) -> None:
        self._covered = np.isfinite(error_m).all(axis=1)
        self._squared = error_m[self._covered] ** 2
        self._distance = np.sqrt(self._squared.sum(axis=1))
        self._within = self._distance < within_m
        self._order = np.argsort(self._distance)
        self._sorted = self._distance[self._order]

    def of(self, weight: np.ndarray) -> dict[str, float]:
        found: dict[str, float] = {}
        if (drawn := weight.sum()) == 0:  # a block that fell between two stamps far apart
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
        """Linear between ranks, as np.percentile of the rows written out."""
        rank = (counts[-1] - 1) * share
        below, above = np.searchsorted(counts, [np.floor(rank), np.ceil(rank)], side="right")
        low, high = self._sorted[below], self._sorted[above]
        return float(low + (rank - np.floor(rank)) * (high - low))


def _dot(weight: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Without BLAS, whose threads cost more than such a small product."""
    return np.einsum("i,i...->...", weight, rows)


def _times_drawn(time_s: np.ndarray, block_s: float, rng: np.random.Generator) -> np.ndarray:
    """How often each row is in a replicate: as many whole blocks as the duration takes."""
    begin, end = time_s[0], time_s[-1]
    count = max(1, int(np.ceil((end - begin) / block_s)))
    starts = rng.uniform(begin, max(begin, end - block_s), count)
    steps = np.zeros(len(time_s) + 1)
    np.add.at(steps, np.searchsorted(time_s, starts, side="left"), 1)
    np.add.at(steps, np.searchsorted(time_s, starts + block_s, side="right"), -1)
    return np.cumsum(steps)[:-1]
