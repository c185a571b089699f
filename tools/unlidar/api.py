"""The package as a library: paths in, dataclasses out. docs/python_api.md shows it at work.

Errors that a user can fix are UnlidarError: file, value and expectation in one line.
Notes go to the logger `unlidar`, stages with the level INFO.
"""

import dataclasses
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from unlidar import conversion, evaluation, pipeline
from unlidar.call_checks import (
    chosen_sensors,
    config_path,
    expect,
    expect_bool,
    expect_whole,
    options_of,
    path_of,
    pose_files_of,
    settings_of,
)
from unlidar.program import CLUSTERS, SUMMARY, TARGET_RETURNS
from unlidar.settings import assignments

AnyPath = str | os.PathLike[str]
ConvertOptions = conversion.Options
EvaluateOptions = evaluation.Options


@dataclass(frozen=True)
class Conversion:
    """The result of a conversion."""

    out: Path  # holds a folder of frames for each sensor
    kind: str  # of the recording
    frames: dict[str, int]  # how many, by sensor
    returns: dict[str, int]  # number of them in all frames, by sensor
    truth: Path | None  # ground_truth.csv, None if the recording has no truth
    truth_rows: int
    notes: tuple[str, ...]  # for the user
    broken: str | None  # why `out` ends before the recording does; None: it is complete


@dataclass(frozen=True)
class DroneMeasures:
    """The measures of one drone among several."""

    target: float  # its number in the truth
    coverage: float
    matched: float | None  # None: never in view
    rmse: float | None = None  # m
    matched_rmse: float | None = None  # m


@dataclass(frozen=True)
class Measures:
    """The measures of docs/evaluate.md, under the same names; None: not defined.

    Lengths are metres, shares 0 to 1.
    """

    tracks: int
    rows: int
    false: float
    drones: int = 0
    coverage: float | None = None
    within1m: float | None = None
    rmse: float | None = None
    rmse_unbiased: float | None = None
    mse: float | None = None  # m²
    ape: float | None = None
    median: float | None = None
    p95: float | None = None
    dx: float | None = None
    dy: float | None = None
    dz: float | None = None
    mae_x: float | None = None
    mae_y: float | None = None
    mae_z: float | None = None
    bias: tuple[float, float, float] | None = None
    matched: float | None = None
    matched_rmse: float | None = None
    matched_rmse_unbiased: float | None = None
    identity_switches: int | None = None
    targets: tuple[DroneMeasures, ...] = ()  # of several drones, one each
    nees: float | None = None
    nees_median: float | None = None
    nees_within95: float | None = None
    nees_unbiased: float | None = None
    nees_unbiased_median: float | None = None
    nees_unbiased_within95: float | None = None
    truth_is: str | None = None  # where it is known to be of another point than the returns'
    challenge_mse: float | None = None  # m²
    rows_judged: int | None = None
    rows_unjudged: int | None = None
    rows_false: float | None = None
    rows_rmse: float | None = None
    rows_rmse_unbiased: float | None = None
    rows_dx: float | None = None
    rows_dy: float | None = None
    rows_dz: float | None = None
    intervals: Mapping[str, tuple[float, float]] = dataclasses.field(default_factory=dict)
    align: str = "none"
    align_translation_m: tuple[float, float, float] | None = None
    align_rotation: tuple[tuple[float, ...], ...] | None = None  # 3 x 3
    time_offset_s: float = 0.0
    time_offset_estimated: bool = False
    time_offset_sigma_s: float | None = None


@dataclass(frozen=True)
class Run:
    """The result of tracking one recording, and the paths of its files."""

    out: Path
    frames: dict[str, Path]  # folder by sensor
    truth: Path | None
    trajectory: Path
    summary: Path
    target_returns: Path
    clusters: Path
    figure: Path | None  # None without report
    page: Path | None
    tracks: int
    measures: Measures | None  # None without truth
    messages: tuple[str, ...]  # of the program
    tracking_s: float


def convert(
    recording: AnyPath,
    out: AnyPath,
    *,
    sensors: Sequence[str] | None = None,
    force: bool = False,
    options: ConvertOptions | None = None,
) -> Conversion:
    """Converts a recording of any kind that `unlidar convert` reads to the folder `out`.

    `sensors` chooses among those of the recording, by default its LiDARs. `force` replaces an
    earlier conversion.
    """
    source, out, chosen = (
        path_of("recording", recording),
        path_of("out", out),
        chosen_sensors(sensors),
    )
    expect_bool("force", force)
    reading = options_of(ConvertOptions, "ConvertOptions", options)
    report = conversion.convert(source, out, chosen, force, reading)
    rows = report["truth_rows"]
    return Conversion(
        out=out,
        kind=report["kind"],
        frames=report["frames"],
        returns=report["returns"],
        truth=None if rows is None else out / conversion.TRUTH_NAME,
        truth_rows=rows or 0,
        notes=tuple(report["notes"]),
        broken=report["broken"],
    )


def run(
    recording: AnyPath,
    out: AnyPath,
    *,
    sensors: Sequence[str] | None = None,
    method: str | None = None,
    config: AnyPath | None = None,
    settings: Mapping[str, object] | None = None,
    threads: int | None = None,
    options: ConvertOptions | None = None,
    report: bool = True,
    poses: AnyPath | Mapping[str, AnyPath] | None = None,
) -> Run:
    """Converts one recording if need be, tracks, evaluates where there is truth, and reports.

    The first of the `sensors` gives the output times. `method` is "robust" or "paper", `config` a
    YAML file of the program, `settings` single values of it by their key, as
    {"robust.off_ground_m": 0.5}, which go before the file. `options` are those of the conversion.
    `poses` is a TUM file of the way of all LiDARs, or one for each that moves, by its name.
    """
    source, out = path_of("recording", recording), path_of("out", out)
    expect_bool("report", report)
    if threads is not None:
        expect_whole("threads", threads, 1)
    values = ({"method": method} if method is not None else {}) | settings_of(settings)
    file = config_path(config)
    chosen = [] if file is None else ["--config", file]
    for assignment in assignments(values):
        chosen += ["--set", assignment]
    chosen += [] if threads is None else ["--threads", str(threads)]
    names = chosen_sensors(sensors)
    reading = options_of(ConvertOptions, "ConvertOptions", options)
    files = pose_files_of(poses)
    found = pipeline.run(source, out, names, chosen, reading, report=report, poses=files)
    return Run(
        out=found.out,
        frames=found.record.frames,
        truth=found.record.truth,
        trajectory=found.trajectory,
        summary=found.out / SUMMARY,
        target_returns=found.out / TARGET_RETURNS,
        clusters=found.out / CLUSTERS,
        figure=found.figure if report else None,
        page=found.page if report else None,
        tracks=found.record.tracks or 0,
        measures=None if found.measures is None else _measures(found.measures),
        messages=found.record.messages,
        tracking_s=found.record.tracking_s or 0.0,
    )


def evaluate(
    truth: AnyPath,
    trajectory: AnyPath | Sequence[AnyPath],
    options: EvaluateOptions | None = None,
) -> Measures:
    """Compares a trajectory with a truth, each as CSV or TUM, as `unlidar evaluate` does.

    Several files are the tracks of one trajectory.
    """
    is_one = isinstance(trajectory, (str, bytes)) or not isinstance(trajectory, Iterable)
    files = [path_of("trajectory", one) for one in ([trajectory] if is_one else trajectory)]
    expect(bool(files), "trajectory", trajectory, "at least one file")
    chosen = options_of(EvaluateOptions, "EvaluateOptions", options)
    return _measures(evaluation.evaluate_files(path_of("truth", truth), files, chosen))


def _measures(found: dict[str, Any]) -> Measures:
    known = {name: _frozen(value) for name, value in found.items()}
    known["targets"] = tuple(DroneMeasures(**one) for one in found.get("targets", ()))
    intervals = found.get("intervals", {})
    known["intervals"] = {name: (low, high) for name, (low, high) in intervals.items()}
    return Measures(**known)


def _frozen(value: Any) -> Any:
    return tuple(_frozen(part) for part in value) if isinstance(value, list) else value
