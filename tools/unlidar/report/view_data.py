"""The 3-D view packed for the page: returns as centimetres in 16 bits, lines as floats."""

import base64

import numpy as np

from unlidar.colours import track_colours
from unlidar.report.data import ReportData
from unlidar.report.lines import at_times, rings_apart, tube
from unlidar.report.sample import Sample
from unlidar.report.trajectories import spans, track_trajectories, truth_trajectories

UNIT_M = 0.01


def pack_view(data: ReportData, begin_s: float) -> dict:
    """The point clouds and markers of page.js, by step of the time slider.

    `*_end` are the numbers of points up to and with each step; markers are per step and track,
    `colours` those of the estimates.
    """
    sample, tracks = data.sample, data.tracks
    truth = _markers(data.truth.time_s, data.truth.target, data.truth.xyz_m, sample.steps_s)
    estimate = _markers(tracks.time_s, tracks.track_id, tracks.xyz_m, sample.steps_s)
    colours = track_colours(tracks.track_id)
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
        "truth": [list(found.values()) for found in truth],
        "estimate": [list(found.values()) for found in estimate],
        "colours": [[colours[track] for track in found] for found in estimate],
    }


def target_steps(sample: Sample) -> np.ndarray:
    """(T,) time step of each target return; -1 if its time is unknown."""
    if len(sample.steps_s) == 0:
        return np.full(len(sample.target_s), -1)
    step = np.searchsorted(sample.edges_s, np.nan_to_num(sample.target_s), "right")
    return np.where(np.isnan(sample.target_s), -1, step)


def pack_trajectories(data: ReportData, begin_s: float, first_trace: int) -> list[dict]:
    """Lines and tubes of the 3-D view, which page.js draws as far as they lie in the time window.

    A line has its time at each point, a tube at each ring; their traces follow each other in the
    scene from `first_trace` on. Numbers are 32-bit floats in base64.
    """
    tracks, found = track_trajectories(data), []
    for trajectory in (*truth_trajectories(data), *tracks):
        points_m = trajectory.drawn.of(trajectory.xyz_m)
        time_s = trajectory.drawn.of(trajectory.time_s - begin_s)
        found.append(
            {
                "name": trajectory.name,
                "colour": trajectory.colour,
                "spans": [
                    [round(begin - begin_s, 3), round(end - begin_s, 3)]
                    for begin, end in spans(trajectory)
                ],
                "time": _floats(time_s),
                "points": _floats(points_m),
            }
        )
    if data.tracks.sigma_m is not None:
        every = rings_apart([trajectory.drawn for trajectory in tracks])
        for trajectory in tracks:
            corners, faces, rows = tube(
                trajectory.drawn.pieces, trajectory.xyz_m, 2 * data.tracks.sigma_m, every
            )
            found.append(
                {
                    "time": _floats(trajectory.time_s[rows] - begin_s),
                    "points": _floats(corners),
                    "faces": base64.b64encode(faces.astype("<u2").tobytes()).decode(),
                }
            )
    return [{"trace": first_trace + index} | one for index, one in enumerate(found)]


def _floats(values: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode()


def _packed(points_m: np.ndarray) -> str:
    limit = np.iinfo(np.int16).max
    whole = np.clip(np.rint(points_m / UNIT_M), -limit, limit).astype("<i2")
    return base64.b64encode(whole.tobytes()).decode()


def _markers(
    time_s: np.ndarray, group: np.ndarray, xyz_m: np.ndarray, steps_s: np.ndarray
) -> list[dict[float, list[float]]]:
    """Known positions by group, for each time step."""
    names = np.unique(group).tolist()
    found = dict(zip(names, at_times(time_s, group, xyz_m, steps_s), strict=True))
    return [
        {
            name: [round(float(v), 3) for v in at[i]]
            for name, at in found.items()
            if np.isfinite(at[i]).all()
        }
        for i in range(len(steps_s))
    ]
