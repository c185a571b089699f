"""Hours of a station's life, played fast, with all that happens to one drawn at random.

Three minutes here; UNLIDAR_WEEK_HOURS=24 plays a day in three quarters of an hour of processor
time. Every frame and every row is accounted for. A full disk has tests of its own:
test_live_follow.py.
"""

from __future__ import annotations

import json
import os
import signal
from bisect import bisect_left
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from live_program import Live, message, rows_of, unread_bytes, wait_until
from synthetic import drone_position_m, write_pcd

HOURS = float(os.environ.get("UNLIDAR_WEEK_HOURS", 0.05))
SEED = 1
BEGIN_S = 1_706_300_000.0
PERIOD_S = 0.1
MEAN_PEACE_S = 12.0  # from one fault to the next
CYCLE_S, FLIGHT_S = 45.0, 30.0  # a flight in each cycle
FAULTS = ("ahead", "far_back", "little_back", "astray", "cable", "swap", "kill")
RECOVERY_S = 10.0  # after it, what flies is tracked again
MOST_ROWS_AT_ONCE = 100  # of a track that is confirmed


@dataclass
class Sent:
    stamp_s: float
    time_s: float  # true
    has_drone: bool


@dataclass
class Run:
    """A life of the program, up to its end or to kill -9."""

    events: Path
    frames: int = 0
    was_killed: bool = False


@dataclass
class Week:
    folder: Path
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(SEED))
    sent: list[Sent] = field(default_factory=list)
    runs: list[Run] = field(default_factory=list)
    faults: list[tuple[float, str]] = field(default_factory=list)
    clock_s: float = BEGIN_S  # of the sensor, less the true time
    sensor: int = 0

    def frame(self, time_s: float) -> bytes:
        ground = self.rng.uniform([-20, -20, -2], [20, 20, -1.95], (150, 3))
        wall = self.rng.uniform([20, -10, -2], [20.05, 10, 4], (80, 3))
        has_drone = time_s % CYCLE_S > CYCLE_S - FLIGHT_S
        if has_drone:
            body = drone_position_m(time_s + self.rng.uniform(0, PERIOD_S, 7))
            wall = np.concatenate([wall, body + self.rng.uniform(-0.1, 0.1, (7, 3))])
        path = self.folder / "frame.pcd"
        write_pcd(path, np.concatenate([ground, wall]).astype(np.float32))
        # Clocks never jump by whole frames.
        stamp_s = round(time_s + self.clock_s, 6)
        self.sent.append(Sent(stamp_s, time_s, has_drone))
        return message(f"lidar{self.sensor}", f"{stamp_s:.6f}", path.read_bytes())

    def start(self) -> Live:
        self.runs.append(Run(self.folder / f"events{len(self.runs)}.jsonl"))
        return Live(
            *("--stdin", "--out", self.folder / "traj.csv", "--events", self.runs[-1].events),
            *("--rate", "10", "--set", "input.skip_bad_frames=true", "--quiet"),
            *("--set", "live.overload_s=600"),  # frames come as fast as they are read
        )

    def play(self, end_s: float) -> None:
        live, time_s, astray_s = self.start(), 0.0, 0.0
        peace_until_s = RECOVERY_S
        while time_s < end_s:
            if time_s > peace_until_s:
                fault = str(self.rng.choice(FAULTS))
                self.faults.append((time_s, fault))
                if fault == "ahead":
                    self.clock_s += self.rng.uniform(0.3, 3600)
                elif fault == "far_back":
                    self.clock_s -= self.rng.uniform(61, 3600)
                elif fault == "little_back":
                    self.clock_s -= self.rng.uniform(0.3, 5)
                elif fault == "astray":
                    astray_s = self.rng.uniform(61, 3600)
                elif fault == "cable":
                    time_s += self.rng.uniform(2.5, 20)
                elif fault == "swap":
                    self.sensor = (self.sensor + 1) % 8
                elif fault == "kill":
                    wait_until(lambda live=live: unread_bytes(live) == 0, "all was read")
                    live.end(signal.SIGKILL)
                    self.runs[-1].was_killed = True
                    live = self.start()
                peace_until_s = time_s + RECOVERY_S + self.rng.exponential(MEAN_PEACE_S)
            self.clock_s += astray_s
            live.send(self.frame(time_s))
            self.clock_s, astray_s = self.clock_s - astray_s, 0.0
            self.runs[-1].frames += 1
            time_s += PERIOD_S
        code, _, said = live.end()
        assert code == 0, said


def check_frames(run: Run) -> None:
    """Each was taken in or is among those that were dropped."""
    state = [e for e in events_of(run.events) if e["event"] == "state"][-1]
    assert state["frames"] + state["dropped"] == run.frames, run


def events_of(path: Path) -> list[dict]:
    whole = [line for line in path.read_text().splitlines(keepends=True) if line.endswith("\n")]
    return [json.loads(line) for line in whole]


def check_rows(week: Week) -> None:
    rows = [row.split(",") for row in rows_of(week.folder / "traj.csv")]
    written = Counter((int(row[1]), row[0]) for row in rows)
    assert max(written.values()) == 1  # none twice
    events = [event for run in week.runs for event in events_of(run.events)]
    told = Counter((e["track"], f"{e['timestamp']:.6f}") for e in events if e["event"] == "row")
    assert max(told.values()) == 1
    # A kill may come between the two files.
    kills = sum(run.was_killed for run in week.runs)
    rounded = Counter((track, f"{float(stamp):.6f}") for track, stamp in written)
    assert sum(((rounded - told) + (told - rounded)).values()) <= kills * MOST_ROWS_AT_ONCE

    # Tracks have numbers of their own, and their rows are in order of time.
    assert max(Counter(e["track"] for e in events if e["event"] == "track").values()) == 1
    last: dict[int, float] = {}
    for row in rows:
        track, stamp_s = int(row[1]), float(row[0])
        assert stamp_s > last.get(track, 0.0)
        last[track] = stamp_s


def check_places(week: Week) -> None:
    """Rows are where the drone was, and where it was in peace there are rows."""
    order = sorted(week.sent, key=lambda frame: frame.stamp_s)
    stamps = [frame.stamp_s for frame in order]
    tracked, strange = set(), 0
    rows = rows_of(week.folder / "traj.csv")
    for row in rows:
        values = np.array(row.split(","), float)
        # Clocks that jump may show one time more than once.
        near = slice(bisect_left(stamps, values[0] - 3), bisect_left(stamps, values[0] + 3))
        times_s = np.array([f.time_s + values[0] - f.stamp_s for f in order[near]])
        errors = np.linalg.norm(values[2:5] - drone_position_m(times_s), axis=1)
        allowed_m = max(1.0, 5 * float(np.linalg.norm(values[8:11])))
        strange += not len(errors) or errors.min() > allowed_m
        if len(errors):
            tracked.add(round(times_s[errors.argmin()] / PERIOD_S))
    assert strange <= 0.01 * len(rows)

    fault_times_s = [time_s for time_s, _ in week.faults]
    quiet = []
    for frame in week.sent:
        before = bisect_left(fault_times_s, frame.time_s)
        since_s = frame.time_s - (fault_times_s[before - 1] if before else 0.0)
        until_s = fault_times_s[before] - frame.time_s if before < len(fault_times_s) else 1e9
        in_flight_s = frame.time_s % CYCLE_S - (CYCLE_S - FLIGHT_S)
        if since_s > RECOVERY_S and until_s > 1.5 and 3 < in_flight_s < FLIGHT_S - 1:
            quiet.append(round(frame.time_s / PERIOD_S))
    found = sum(bool({k - 1, k, k + 1} & tracked) for k in quiet)
    print(f"{len(rows)} rows, {strange} strange, {found} of {len(quiet)} frames in peace tracked")
    assert found >= 0.95 * len(quiet)


def test_every_frame_and_every_row_of_a_simulated_week_is_accounted_for(tmp_path: Path) -> None:
    week = Week(tmp_path)
    week.play(3600 * HOURS)
    print(Counter(fault for _, fault in week.faults), f"{len(week.sent)} frames")
    for run in week.runs:
        if not run.was_killed:
            check_frames(run)
    check_rows(week)
    check_places(week)
