#!/usr/bin/env python3
"""Measures unlidar.Engine and unlidar.track against the program on the same frames.

Processor time of the same work takes turns; printed are the medians and the median of the ratios of
each turn. The program parses PCD files, which the arrays spare the engine, and starts anew; so does
a Python process, whose start is measured apart. Last, the wall clock: how much faster two engines
are in two threads than one after the other. Exit code 1 if an overhead is above 5 % or that is
below 1.8: on a machine that does other things meanwhile it means little.
"""

import argparse
import io
import resource
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

import unlidar
from unlidar.frames_io import find_sensors
from unlidar.program import find_program

_MOST_OVERHEAD = 1.05
_LEAST_SPEEDUP = 1.8


def cpu_of(work: Callable[[], object]) -> float:
    """Seconds of the processor, of this process and of those that it waits for."""
    begin = _cpu_s()
    work()
    return _cpu_s() - begin


def _cpu_s() -> float:
    used = [resource.getrusage(of) for of in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


def wall_of(work: Callable[[], object]) -> float:
    begin = time.perf_counter()
    work()
    return time.perf_counter() - begin


def stream(frames: list[unlidar.Frame]) -> None:
    engine = unlidar.Engine()
    for frame in frames:
        engine.add(*frame)
    engine.close()


def in_turn(frames: list[unlidar.Frame]) -> None:
    stream(frames)
    stream(frames)


def in_two_threads(frames: list[unlidar.Frame]) -> None:
    threads = [threading.Thread(target=stream, args=(frames,)) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


def compare(name: str, turns: int, ours: Callable[[], float], theirs: Callable[[], float]) -> float:
    """Prints and returns the median of ours / theirs."""
    pairs = [(ours(), theirs()) for _ in range(turns)]
    ratio = statistics.median(a / b for a, b in pairs)
    a, b = (statistics.median(column) for column in zip(*pairs, strict=True))
    print(f"{name}: {a:.3f} s, {b:.3f} s, ratio {ratio:.3f}", flush=True)
    return ratio


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("recording", type=Path, help="folder with a folder of PCD files a sensor")
    parser.add_argument("--turns", type=int, default=7)
    chosen = parser.parse_args()
    sensors = find_sensors(chosen.recording)
    frames = list(unlidar.read(chosen.recording))
    messages = io.BytesIO()
    paths = sorted((float(p.stem), n, p) for n, d in sensors.items() for p in d.glob("*.pcd"))
    for _, name, path in paths:
        pcd = path.read_bytes()
        messages.write(f"frame {name} {path.stem} {len(pcd)}\n".encode() + pcd)
    program = str(find_program())
    folders = [f"--frames={name}={directory}" for name, directory in sensors.items()]
    quiet = {"check": True, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}

    with tempfile.TemporaryDirectory() as folder:

        def piped() -> None:
            out = Path(folder) / "live.csv"
            out.unlink(missing_ok=True)
            command = [program, "--stdin", "--out", str(out)]
            subprocess.run(command, input=messages.getvalue(), **quiet)

        def recorded() -> None:
            command = [program, *folders, "--out", f"{folder}/traj.csv"]
            subprocess.run(command, stdin=subprocess.DEVNULL, **quiet)

        def imported() -> None:
            subprocess.run([sys.executable, "-c", "import unlidar; unlidar.Engine()"], check=True)

        print(f"{len(frames)} frames of {len(sensors)} sensors, {chosen.turns} turns")
        overheads = [
            compare(
                f"CPU, {name}", chosen.turns, lambda w=work: cpu_of(w), lambda t=theirs: cpu_of(t)
            )
            for name, work, theirs in (
                ("Engine and --stdin", lambda: stream(frames), piped),
                ("track and --frames", lambda: unlidar.track(frames), recorded),
            )
        ]
        print(
            f"CPU, start of Python: {statistics.median(cpu_of(imported) for _ in range(5)):.3f} s"
        )
        speedup = compare(
            "wall clock, two engines in turn and in two threads",
            chosen.turns,
            lambda: wall_of(lambda: in_turn(frames)),
            lambda: wall_of(lambda: in_two_threads(frames)),
        )
    if max(overheads) > _MOST_OVERHEAD or speedup < _LEAST_SPEEDUP:
        sys.exit(1)


if __name__ == "__main__":
    main()
