"""From errors to measures, over one sequence or over several together."""

from collections.abc import Sequence

import numpy as np
from scipy.special import chdtri

from unlidar.evaluate_options import Options
from unlidar.evaluation.association import FALSE_BEYOND_M
from unlidar.evaluation.bootstrap import Drawn, intervals
from unlidar.evaluation.comparison import Comparison

WITHIN_M = 1.0
NEES_95 = float(chdtri(3, 0.05))


def measure(comparisons: Sequence[Comparison], options: Options) -> dict:
    """All measures by name, over all rows of all sequences together."""
    false = np.concatenate([_false_rows(one) for one in comparisons])
    result: dict = {"tracks": sum(one.tracks for one in comparisons), "rows": len(false)}
    with_truth = [one for one in comparisons if len(one.time_s)]
    if not with_truth:
        return result | {"false": 1.0 if len(false) else 0.0}
    result["drones"] = sum(one.drones for one in with_truth)
    result |= _at_truth_stamps(with_truth)
    result |= _identities(with_truth)
    result |= _nees(with_truth)
    result |= _challenge(with_truth)
    result |= {"false": _rounded(false.mean()) if len(false) else 0.0}
    result |= _at_own_rows(with_truth)
    if options.bootstrap:
        result |= {"intervals": _intervals(with_truth, options, result)}
    if len(comparisons) == 1:
        result |= _per_target(comparisons[0]) | _applied(comparisons[0])
    return result


def several_drones(measures: dict) -> bool:
    """True if there are several drones, for which matched errors are the relevant ones."""
    return measures.get("drones", 0) > 1


def _error_measures(error: np.ndarray, distance: np.ndarray) -> dict[str, float]:
    """Measures of the errors (K, 3) at covered rows, with lengths `distance` (K,)."""
    squared = error**2
    return {
        "rmse": float(np.sqrt(squared.sum(axis=1).mean())),
        "mse": float(squared.sum(axis=1).mean()),
        "ape": float(distance.mean()),
        "median": float(np.median(distance)),
        "p95": float(np.percentile(distance, 95)),
        **{f"d{axis}": float(np.sqrt(squared[:, i].mean())) for i, axis in enumerate("xyz")},
    }


def _false_rows(one: Comparison) -> np.ndarray:
    return one.rows.distance_m > FALSE_BEYOND_M


def _at_truth_stamps(comparisons: Sequence[Comparison]) -> dict:
    seen = np.concatenate([one.seen for one in comparisons])
    covered = np.concatenate([one.covered for one in comparisons])
    distance = np.concatenate([one.nearest.distance_m for one in comparisons])
    result: dict = {
        "coverage": _rounded(covered.sum() / max(1, seen.sum())),
        "within1m": _rounded((distance[seen] < WITHIN_M).mean()) if seen.any() else None,
    }
    if not covered.any():
        return result
    error = np.concatenate([one.nearest.error_m for one in comparisons])[covered]
    bias = error.mean(axis=0)
    return (
        result
        | {name: _rounded(v) for name, v in _error_measures(error, distance[covered]).items()}
        | {f"mae_{axis}": _rounded(np.abs(error[:, i]).mean()) for i, axis in enumerate("xyz")}
        | {"rmse_unbiased": _rmse(error - bias), "bias": [round(float(v), 3) for v in bias]}
    )


def _identities(comparisons: Sequence[Comparison]) -> dict:
    seen = np.concatenate([one.seen for one in comparisons])
    matched = np.concatenate([one.matched for one in comparisons])
    result: dict = {"matched": _rounded(matched[seen].mean()) if seen.any() else None}
    if matched.any():
        error = np.concatenate([one.own.error_m for one in comparisons])[matched]
        result["matched_rmse"] = _rmse(error)
        result["matched_rmse_unbiased"] = _rmse(error - error.mean(axis=0))
    return result | {"identity_switches": sum(one.switches for one in comparisons)}


def _nees(comparisons: Sequence[Comparison]) -> dict:
    return {
        **_nees_measures("", np.concatenate([one.nees[one.covered] for one in comparisons])),
        **_nees_measures("_unbiased", np.concatenate([one.nees_unbiased for one in comparisons])),
    }


def _nees_measures(kind: str, nees: np.ndarray) -> dict:
    nees = nees[np.isfinite(nees)]
    if len(nees) == 0:
        return {}
    return {
        f"nees{kind}": _rounded(nees.mean()),
        f"nees{kind}_median": _rounded(np.median(nees)),
        f"nees{kind}_within95": _rounded((nees <= NEES_95).mean()),
    }


def _challenge(comparisons: Sequence[Comparison]) -> dict:
    """The challenge's measure, defined if every sequence has one target."""
    if any(len(np.unique(one.target)) > 1 for one in comparisons):
        return {}
    error = np.concatenate([one.completed_m for one in comparisons])
    if np.isnan(error).any():
        return {"challenge_mse": None}
    return {"challenge_mse": _rounded((error**2).sum(axis=1).mean())}


def _at_own_rows(comparisons: Sequence[Comparison]) -> dict:
    distance = np.concatenate([one.rows.judged_m for one in comparisons])
    ours = np.isfinite(distance)
    result: dict = {"rows_judged": int(ours.sum()), "rows_unjudged": int((~ours).sum())}
    if ours.any():
        error = np.concatenate([one.rows.error_m for one in comparisons])[ours]
        result["rows_false"] = _rounded((distance[ours] > FALSE_BEYOND_M).mean())
        result["rows_rmse"] = _rmse(error)
        result |= {f"rows_d{axis}": _rmse(error[:, [i]]) for i, axis in enumerate("xyz")}
        result["rows_rmse_unbiased"] = _rmse(error - error.mean(axis=0))
    return result


def _intervals(comparisons: Sequence[Comparison], options: Options, result: dict) -> dict:
    """Interval ends by name, widened to the estimate where few replicates leave it outside."""
    drawn = [
        Drawn(one.time_s[one.seen], one.nearest.error_m[one.seen], one.own.error_m[one.seen])
        for one in comparisons
    ]
    return {
        name: [min(_rounded(low), result[name]), max(_rounded(high), result[name])]
        for name, (low, high) in intervals(drawn, WITHIN_M, options).items()
    }


def _per_target(one: Comparison) -> dict:
    """Coverage and RMSE of each target, where there are several."""
    targets = np.unique(one.target)
    if len(targets) < 2:
        return {}
    found = []
    for target in targets:
        mine = one.target == target
        seen, covered = one.seen & mine, one.covered & mine
        entry: dict = {
            "target": float(target),
            "coverage": _rounded(covered.sum() / max(1, seen.sum())),
            "matched": _rounded(one.matched[seen].mean()) if seen.any() else None,
        }
        if covered.any():
            entry["rmse"] = _rmse(one.nearest.error_m[covered])
        if (matched := one.matched & mine).any():
            entry["matched_rmse"] = _rmse(one.own.error_m[matched])
        found.append(entry)
    return {"targets": found}


def _applied(one: Comparison) -> dict:
    result: dict = {}
    if one.align != "none":
        result["align"] = one.align
        result["align_translation_m"] = [round(float(v), 4) for v in one.alignment.translation_m]
        if one.align != "translation":
            result["align_rotation"] = [
                [round(float(v), 6) for v in row] for row in one.alignment.rotation
            ]
    estimated = one.time_offset_sigma_s is not None
    if one.time_offset_s or estimated:
        result["time_offset_s"] = round(one.time_offset_s, 4)
        result["time_offset_estimated"] = estimated
    if estimated:
        result["time_offset_sigma_s"] = round(one.time_offset_sigma_s, 4)
    return result


def _rmse(error_m: np.ndarray) -> float:
    return _rounded(np.sqrt((error_m**2).sum(axis=1).mean()))


def _rounded(value: float) -> float:
    return round(float(value), 4)
