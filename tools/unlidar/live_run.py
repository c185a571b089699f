"""Live run of a recording, compared with the batch run of the same recording."""

import json
import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich import box
from rich.table import Table

from unlidar.errors import ProgramError
from unlidar.evaluation import evaluate
from unlidar.evaluation.markdown import percent
from unlidar.frame_clock import rate_of
from unlidar.output import clear_results
from unlidar.play import MessageSink, PlayedFrame, frames_in_order, play
from unlidar.program import NAME, SUMMARY, TRAJECTORY, find_program
from unlidar.record import RunRecord, read_finished, read_object
from unlidar.truth import read_tracks, read_truth

TRAJECTORY_LIVE, EVENTS_LIVE, SUMMARY_LIVE = "live.csv", "live_events.jsonl", "live_summary.json"


@dataclass(frozen=True)
class LiveTimes:
    """Latencies of a live run, in seconds of the recording; NaN if undefined."""

    # Median time to confirmation from the first evidence of a track, or from the end of the warm-up
    # if that is later.
    confirmation_s: float
    delay_s: float  # 99th percentile, of the rows of confirmed tracks
    wall_s: float  # of the whole run, frames sent as fast as they are taken


@dataclass(frozen=True)
class LiveRun:
    """Results of a live run and of the batch run."""

    trajectory: Path
    batch: dict | None  # measures of `evaluate`; None without truth
    live: dict | None
    times: LiveTimes


def run_live(run: Path) -> LiveRun:
    """Plays the recording of a finished `unlidar run` to the live program, with its options.

    Throws ProgramError with the program's own message and exit code if it fails.
    """
    record = read_finished(run)
    wall_s = stream_frames(run, record, run)
    trajectory = run / TRAJECTORY_LIVE
    truth = None if record.truth is None else read_truth(record.truth)
    batch, live = (
        None if truth is None else evaluate(truth, read_tracks(path))
        for path in (run / TRAJECTORY, trajectory)
    )
    return LiveRun(trajectory, batch, live, _times(run / EVENTS_LIVE, wall_s))


def stream_frames(run: Path, record: RunRecord, out: Path, options: Sequence[str] = ()) -> float:
    """Plays the frames of a finished run to the live program; returns how long that took.

    Trajectory, events and summary go to `out`. Throws ProgramError.
    """
    clear_results(out, (TRAJECTORY_LIVE, EVENTS_LIVE, SUMMARY_LIVE))
    command = [find_program(), "--stdin", "--out", out / TRAJECTORY_LIVE]
    command += ["--events", out / EVENTS_LIVE, "--summary", out / SUMMARY_LIVE]
    command += [*record.arguments, *options]
    config = read_object(run / SUMMARY).get("config", {})
    rates_hz = {name: rate_of(config, name) for name in record.frames}
    frames = frames_in_order(record.frames, rates_hz=rates_hz)
    return _send([str(part) for part in command], frames)


def live_table(result: LiveRun) -> Table:
    """Batch and live, a row each."""
    table = Table(title="recording and live", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column("run", no_wrap=True)
    for name in ("within 1 m", "cover", "RMSE", "false", "tracks", "confirm", "p99 delay"):
        table.add_column(name, justify="right", no_wrap=True)
    times = result.times
    for name, measures, told in (
        ("recording", result.batch, ("", "")),
        ("live", result.live, (_seconds(times.confirmation_s), _seconds(times.delay_s))),
    ):
        m = measures or {}
        table.add_row(
            name,
            percent(m.get("within1m")),
            percent(m.get("coverage")),
            f"{m['rmse']:.3f} m" if "rmse" in m else "-",
            percent(m.get("false")),
            str(m.get("tracks", "-")),
            *told,
        )
    return table


def _send(command: list[str], frames: Iterator[PlayedFrame]) -> float:
    with tempfile.TemporaryFile() as said:
        begin = time.perf_counter()
        process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=said, stderr=said)
        assert process.stdin is not None
        try:
            play(frames, MessageSink(process.stdin), rate=np.inf)
            process.stdin.close()
        except BrokenPipeError:  # the program exited; its messages say why
            pass
        except BaseException:
            process.terminate()
            process.wait()
            raise
        code = process.wait()
        wall_s = time.perf_counter() - begin
        if code != 0:
            said.seek(0)
            last = (said.read().decode(errors="replace").strip().splitlines() or ["no message"])[-1]
            text = last.removeprefix(f"{NAME}: ").removeprefix("error: ")
            raise ProgramError(f"{NAME} --stdin ended with code {code}: {text}", max(code, 1))
        return wall_s


def _times(events: Path, wall_s: float) -> LiveTimes:
    told = [json.loads(line) for line in events.read_text().splitlines()]
    waits, running = [], -np.inf
    for e in told:
        if e["event"] == "state" and e["state"] == "running":
            running = e["at"]
        elif e["event"] == "track":
            waits.append(e["at"] - max(e["first_evidence"], running))
    delays = [e["at"] - e["timestamp"] for e in told if e["event"] == "row" and not e["late"]]
    return LiveTimes(
        float(np.median(waits)) if waits else np.nan,
        float(np.percentile(delays, 99)) if delays else np.nan,
        wall_s,
    )


def _seconds(value: float) -> str:
    return "-" if np.isnan(value) else f"{value:.2f} s"
