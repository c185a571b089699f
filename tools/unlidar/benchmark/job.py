"""One scene with one seed: simulated if need be, tracked by every variant, measured."""

import dataclasses
import resource
import shutil
import signal
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from unlidar.benchmark.scenes import SceneSeed
from unlidar.benchmark.variants import Variant
from unlidar.errors import UnlidarError
from unlidar.evaluation import evaluate
from unlidar.frames_io import list_frames
from unlidar.output import clear_results, write_file
from unlidar.pipeline import RESULTS, Recording, prepare
from unlidar.program import run_program
from unlidar.record import RunRecord, write_measures, write_record
from unlidar.simulate import load_scenario, simulate
from unlidar.truth import TRUTH_NAME, Tracks, Truth, read_tracks, read_truth


@dataclass(frozen=True)
class Job:
    """The work of one process."""

    scene: SceneSeed
    variants: tuple[Variant, ...]
    out: Path
    time_limit_s: float  # of the program, in seconds of CPU


@dataclass(frozen=True)
class Result:
    """One variant on one recording."""

    scene: str
    seed: str
    variant: str
    measures: dict  # of `evaluate`; as without any track where the run failed
    failure: str | None
    cpu_s: float | None  # of the program, one thread
    duration_s: float  # of the recording


def do(job: Job) -> list[Result]:
    """The results of every variant; a run that fails is one of them."""
    with tempfile.TemporaryDirectory(prefix="unlidar-benchmark-") as temporary:
        try:
            recording = _recording(job, Path(temporary))
            truth = read_truth(recording.truth)
            duration_s = _duration_s(recording)
        except UnlidarError as error:
            return [_failed(job, variant, {}, 0.0, error) for variant in job.variants]
        return [_run(job, variant, recording, truth, duration_s) for variant in job.variants]


def folders(job: Job) -> list[Path]:
    """The output folder of each variant."""
    return [_folder(job) / variant.name for variant in job.variants]


def _folder(job: Job) -> Path:
    return job.out / "runs" / job.scene.scene / job.scene.seed


def _recording(job: Job, temporary: Path) -> Recording:
    scene = job.scene
    if scene.folder is not None:
        return prepare(scene.folder, temporary)
    frames = temporary / "frames"
    simulate(load_scenario(scene.scenario), frames, int(scene.seed))
    recording = prepare(frames, temporary)
    # Frames can be simulated again, the truth is kept to evaluate the results again.
    truth = _folder(job) / TRUTH_NAME
    write_file(truth, lambda work: shutil.copyfile(recording.truth, work))
    return dataclasses.replace(recording, truth=truth)


def _duration_s(recording: Recording) -> float:
    stamps = [f.stamp_ns for folder in recording.sensors.values() for f in list_frames(folder)]
    return (max(stamps) - min(stamps)) * 1e-9


def _run(
    job: Job, variant: Variant, recording: Recording, truth: Truth, duration_s: float
) -> Result:
    out = _folder(job) / variant.name
    options = [*variant.options, *recording.mountings, "--threads", "1", "--quiet"]
    record = RunRecord(
        f"{job.scene.scene} {job.scene.seed}".strip(),
        recording.frames,
        recording.sensors,
        recording.truth,
        options,
        recording.poses,
        notes=tuple(recording.notes),
        broken=recording.broken,
    )
    clear_results(out, RESULTS)
    write_record(out, record)
    begin = time.perf_counter()
    before = _children_cpu_s()
    try:
        with _cpu_limit(job.time_limit_s):
            outcome = run_program(recording.sensors, out, record.arguments)
    except UnlidarError as error:
        failure = error
        if f"signal {signal.SIGXCPU.value}" in str(error):
            failure = UnlidarError(f"took more than {job.time_limit_s:g} s of CPU time")
        nothing = evaluate(truth, Tracks(np.zeros(0), np.zeros(0), np.zeros((0, 3))))
        return _failed(job, variant, nothing, duration_s, failure)
    cpu_s = _children_cpu_s() - before
    measures = evaluate(truth, read_tracks(outcome.trajectory))
    write_measures(out, measures)
    write_record(
        out,
        dataclasses.replace(
            record,
            messages=outcome.messages,
            tracks=measures["tracks"],
            tracking_s=outcome.wall_s,
            total_s=time.perf_counter() - begin,
        ),
    )
    return Result(job.scene.scene, job.scene.seed, variant.name, measures, None, cpu_s, duration_s)


def _failed(
    job: Job, variant: Variant, measures: dict, duration_s: float, error: Exception
) -> Result:
    scene = job.scene
    return Result(scene.scene, scene.seed, variant.name, measures, str(error), None, duration_s)


@contextmanager
def _cpu_limit(seconds: float) -> Iterator[None]:
    """Child processes started in the block get SIGXCPU after `seconds` of CPU time."""
    # The limit applies to this process too; its handler is not inherited by the program.
    handler = signal.signal(signal.SIGXCPU, lambda *_: None)
    limits = resource.getrlimit(resource.RLIMIT_CPU)
    resource.setrlimit(resource.RLIMIT_CPU, (max(1, round(seconds)), limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_CPU, limits)
        signal.signal(signal.SIGXCPU, handler)


def _children_cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
