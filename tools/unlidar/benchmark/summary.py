"""Means over the seeds with bootstrap intervals."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from unlidar.benchmark.job import Result
from unlidar.benchmark.variants import Variant
from unlidar.evaluation.bootstrap import LEVEL

MEASURES = ("within1m", "coverage", "matched", "matched_rmse", "rmse", "dx", "dy", "dz", "false")
ALL = "all"  # the name of the rows over all scenes
_RESAMPLES = 2000
_SEED = 1


@dataclass(frozen=True)
class Estimate:
    """A mean with the ends of its 95 % interval; None where nothing was measured.

    Of one seed there is no interval.
    """

    mean: float | None
    low: float | None = None
    high: float | None = None


@dataclass
class Row:
    """A variant on a scene, or on all."""

    scene: str
    variant: str
    seeds: list[str]
    estimates: dict[str, Estimate]
    differences: dict[str, Estimate]  # paired by seed, to the base of the variant
    tracks: list[int]
    tracks_in_empty_sky: tuple[int, int] | None  # runs with any track, runs without any drone
    cpu_s: float | None
    share_of_duration: float | None  # the largest CPU time over duration
    failures: list[str] = field(default_factory=list)


def summarise(results: list[Result], variants: list[Variant]) -> list[Row]:
    """A row per scene and variant in the order of the results, then one per variant over all.

    Seeds have equal weight, and so have scenes: the mean over all is the mean of the scene means.
    Intervals: percentile bootstrap over the seeds, drawn separately in each scene.
    """
    scenes = list(dict.fromkeys(result.scene for result in results))
    groups = [[scene] for scene in scenes] + ([scenes] if len(scenes) > 1 else [])
    return [_row(group, variant, results) for group in groups for variant in variants]


def _row(scenes: list[str], variant: Variant, results: list[Result]) -> Row:
    mine = [r for r in results if r.variant == variant.name and r.scene in scenes]
    of_base = {(r.scene, r.seed): r for r in results if r.variant == variant.base}
    cpu = [r.cpu_s for r in mine if r.cpu_s is not None]
    shares = [r.cpu_s / r.duration_s for r in mine if r.cpu_s is not None and r.duration_s > 0]
    empty = [r for r in mine if r.measures and "coverage" not in r.measures]
    differences = {}
    if of_base:
        differences = {
            name: _estimate(scenes, mine, _difference(name, of_base)) for name in MEASURES
        }
    return Row(
        scene=scenes[0] if len(scenes) == 1 else ALL,
        variant=variant.name,
        seeds=[r.seed for r in mine],
        estimates={
            name: _estimate(scenes, mine, _value(name, leave_out_empty=len(scenes) > 1))
            for name in MEASURES
        },
        differences=differences,
        tracks=[r.measures.get("tracks", 0) for r in mine],
        tracks_in_empty_sky=(
            (sum(r.measures["tracks"] > 0 for r in empty), len(empty)) if empty else None
        ),
        cpu_s=float(np.mean(cpu)) if cpu else None,
        share_of_duration=max(shares) if shares else None,
        failures=[f"{r.scene}, seed {r.seed or '-'}: {r.failure}" for r in mine if r.failure],
    )


def _value(name: str, leave_out_empty: bool) -> Callable[[Result], float | None]:
    """`false` is a share of rows over all scenes; in an empty sky it only says if there are any."""

    def value(result: Result) -> float | None:
        if leave_out_empty and "coverage" not in result.measures:
            return None
        return _measure(result, name)

    return value


def _difference(
    name: str, of_base: dict[tuple[str, str], Result]
) -> Callable[[Result], float | None]:
    def difference(result: Result) -> float | None:
        base = of_base.get((result.scene, result.seed))
        ours = _measure(result, name)
        theirs = _measure(base, name) if base else None
        return None if ours is None or theirs is None else ours - theirs

    return difference


def _measure(result: Result, name: str) -> float | None:
    """None where it is not defined; a drone that is never in view cannot be covered."""
    if name == "coverage" and result.measures.get("within1m") is None:
        return None
    return result.measures.get(name)


def _estimate(
    scenes: list[str], results: list[Result], value: Callable[[Result], float | None]
) -> Estimate:
    """Mean over the scenes of the means over their seeds."""
    rng = np.random.default_rng(_SEED)
    means, drawn, most = [], [], 0
    for scene in scenes:
        found = [value(r) for r in results if r.scene == scene]
        values = np.array([v for v in found if v is not None], dtype=float)
        if len(values) == 0:
            continue
        most = max(most, len(values))
        means.append(values.mean())
        drawn.append(values[rng.integers(0, len(values), (_RESAMPLES, len(values)))].mean(axis=1))
    if not means:
        return Estimate(None)
    tails = 50 * (1 - LEVEL), 50 * (1 + LEVEL)
    if most < 2:  # one seed has no bootstrap distribution
        return Estimate(float(np.mean(means)))
    low, high = np.percentile(np.mean(drawn, axis=0), tails)
    return Estimate(float(np.mean(means)), float(low), float(high))
