"""The points of the 3-D view packed for the page: centimetres in 16 bits, in base64."""

import base64

import numpy as np

from unlidar_tools.report.data import ReportData
from unlidar_tools.report.lines import at_times
from unlidar_tools.report.sample import Sample

UNIT_M = 0.01


def pack_moments(data: ReportData, begin_s: float) -> dict:
    """What page.js needs to fill the clouds and to move them with the slider.

    `*_end` are the numbers of points up to and with each step; markers are per step and track.
    """
    sample = data.sample
    step_of = target_steps(sample)
    order = np.argsort(step_of, kind="stable")
    return {
        "unit": UNIT_M,
        "time": [round(float(t - begin_s), 3) for t in sample.steps_s],
        "overall": _packed(sample.overall_m),
        "steps": _packed(np.concatenate([np.zeros((0, 3)), *sample.steps_m])),
        "steps_end": np.cumsum([len(step) for step in sample.steps_m]).tolist(),
        "targets": _packed(sample.target_m[order]),
        "targets_begin": int((step_of < 0).sum()),
        "targets_end": [int((step_of <= i).sum()) for i in range(len(sample.steps_s))],
        "truth": _markers(data.truth.time_s, data.truth.target, data.truth.xyz_m, sample.steps_s),
        "estimate": _markers(
            data.tracks.time_s, data.tracks.track_id, data.tracks.xyz_m, sample.steps_s
        ),
    }


def target_steps(sample: Sample) -> np.ndarray:
    """The moment of each target return, (T,); -1 where its time is not known."""
    if len(sample.steps_s) == 0:
        return np.full(len(sample.target_s), -1)
    step = np.searchsorted(sample.edges_s, np.nan_to_num(sample.target_s), "right")
    return np.where(np.isnan(sample.target_s), -1, step)


def _packed(points_m: np.ndarray) -> str:
    limit = np.iinfo(np.int16).max
    whole = np.clip(np.rint(points_m / UNIT_M), -limit, limit).astype("<i2")
    return base64.b64encode(whole.tobytes()).decode()


def _markers(
    time_s: np.ndarray, group: np.ndarray, xyz_m: np.ndarray, steps_s: np.ndarray
) -> list[list[list[float]]]:
    """Per step the positions that are known then."""
    found = at_times(time_s, group, xyz_m, steps_s)
    return [
        [[round(float(v), 3) for v in at[i]] for at in found if np.isfinite(at[i]).all()]
        for i in range(len(steps_s))
    ]
