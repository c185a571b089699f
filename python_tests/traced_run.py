"""A finished run and the trace of its program, made by hand, a second at a time."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation
from synthetic import TRAJ_HEADER, seconds
from unlidar.frames_io import write_pcd
from unlidar.program import Outcome
from unlidar.record import RunRecord, write_record

BEGIN_NS = 1_700_000_000_000_000_000
SECOND_NS = 1_000_000_000
FRAMES_PER_S = 4
DRONE_M = (10.0, 0.0, 5.0)
FAR_M = (-30.0, 20.0, 1.0)
THRESHOLD = 16.0


@dataclass
class TracedRun:
    """One sensor and a target that stays at `DRONE_M`, in whole seconds."""

    folder: Path
    translation_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    yaw_deg: float = 0.0
    time_offset_s: float = 0.0
    method: str = "robust"
    lines: list[dict] = field(default_factory=list)
    rows: list[tuple] = field(default_factory=list)
    truth: list[tuple] | None = field(default_factory=list)
    told: list[str] = field(default_factory=list)  # the options of the last call

    def __post_init__(self) -> None:
        self.frames = self.folder / "frames/lidar"
        self.frames.mkdir(parents=True)
        header = {"version": "1.0", "method": self.method, "sensors": ["lidar"]}
        self.lines.append({"trace": "header", **header})

    @property
    def rotation(self) -> Rotation:
        return Rotation.from_euler("z", self.yaw_deg, degrees=True)

    def second(
        self,
        index: int,
        returns: bool = False,
        body: bool = False,
        detected: bool = False,
        path: str | None = "none",  # or the rule that refused it, or None for a track
        score: float = 20.0,
        row_m: tuple[float, float, float] | None = None,
        at_m: tuple[float, float, float] = DRONE_M,
    ) -> None:
        """The frames of a second, a path through it and rows in it; and the truth at `DRONE_M`."""
        detections = []
        for k in range(FRAMES_PER_S):
            stamp_ns = BEGIN_NS + index * SECOND_NS + k * SECOND_NS // FRAMES_PER_S
            middle_ns = stamp_ns + 50_000_000
            cloud_m = np.array([FAR_M, *([at_m] * 2 if returns else [])])
            cloud_m = self.rotation.inv().apply(cloud_m - self.translation_m)
            own_ns = stamp_ns - round(self.time_offset_s * 1e9)
            write_pcd(self.frames / f"{seconds(own_ns)}.pcd", cloud_m)
            found = {"returns": 2, "height_m": 5.0, "log_clutter": -10.5, "unsupported": True}
            found |= dict(zip("xyz", at_m, strict=True))
            self.lines.append({
                "trace": "frame", "sensor": "lidar", "stamp": seconds(stamp_ns),
                "middle": seconds(middle_ns), "returns": len(cloud_m),
                "bodies": [at_m] if body else [], "detections": [found] if detected else [],
            })  # fmt: skip
            detections.append([seconds(middle_ns), *at_m])
            if row_m is not None:
                self.rows.append((seconds(stamp_ns + 50_000_000), 0, *row_m))
        if path != "none":
            self.lines.append({
                "trace": "path", "first": detections[0][0], "last": detections[-1][0],
                "log_likelihood_ratio": score, "crowding_penalty": 0.0, "threshold": THRESHOLD,
                "rejection": path, "detections": detections,
            })  # fmt: skip

    def every_stage(self) -> list[str]:
        """A second for each stage; returns their names."""
        seen = {"returns": True}
        found = seen | {"detected": True}
        self.second(0)
        self.second(1, **seen)
        self.second(2, **seen, body=True)
        self.second(3, **found)
        self.second(4, **found, path="below_threshold", score=12.5)
        self.second(5, **found, path="near_ground")
        self.second(6, **found, path=None, row_m=FAR_M)
        self.second(7, **found, path=None, row_m=DRONE_M)
        self.add_truth(8)
        return ["no return", "structure", "body", "detection", "path", "gate near_ground",
                "track", "found"]  # fmt: skip

    def add_truth(self, duration_s: float, at_m: tuple = DRONE_M, target: int = 0) -> None:
        """A row every half second that lies in view."""
        for k in range(int(2 * duration_s) + 1):
            self.truth.append((seconds(BEGIN_NS + k * SECOND_NS // 2), *at_m, target, 1))

    def write(self) -> Path:
        """The folder as `unlidar run` leaves it."""
        truth = None
        if self.truth is not None:
            truth = self.folder / "ground_truth.csv"
            _write_table(truth, "timestamp,x,y,z,target,in_view", self.truth)
        self._write_summary(self.folder / "summary.json")
        write_record(
            self.folder,
            RunRecord("flight", self.folder, {"lidar": self.frames}, truth, ["--threads", "1"],
                      tracks=1, tracking_s=0.1),
        )  # fmt: skip
        return self.folder

    def program(self, sensors: dict[str, Path], out: Path, options: list[str]) -> Outcome:
        """In place of `run_program`."""
        self.told = options
        trace = Path(options[options.index("--trace") + 1])
        trace.write_text("".join(json.dumps(line) + "\n" for line in self.lines))
        self._write_summary(out / "summary.json")
        rows = [(*row, *[0.1] * 6, 1) for row in self.rows]
        _write_table(out / "traj.csv", TRAJ_HEADER, rows)
        return Outcome(out / "traj.csv", out / "summary.json", out / "p.pcd", "", (), 0.1)

    def _write_summary(self, path: Path) -> None:
        pose = {
            "translation_m": self.translation_m,
            "rotation": self.rotation.as_quat().tolist(),
            "time_offset_s": self.time_offset_s,
        }
        limits = {"min_range_m": 0.5, "max_range_m": 200.0, "scale_m": 1.0}
        config = {"method": self.method, "sensors": {"lidar": pose}, "input": limits}
        path.write_text(json.dumps({"config": config}))


def _write_table(path: Path, head: str, rows: list[tuple]) -> None:
    path.write_text("\n".join([head, *(",".join(map(str, row)) for row in rows)]) + "\n")
