"""A folder as `unlidar run` leaves it, made without the program, for the tests of the report."""

import csv
import json
from pathlib import Path

import numpy as np
from synthetic import BEGIN_NS, PERIOD_NS, TRAJ_HEADER, drone_position_m, make_flight, seconds
from unlidar.frames_io import write_pcd
from unlidar.record import RunRecord, write_record

SIGMA_M = 0.1
OFFSET_M = np.array([0.3, -0.1, 0.2])  # of the estimate from the truth
DRONE_RETURNS_PER_FRAME = 4
CLUSTERS = 40


def make_run(
    run: Path,
    frames: int = 30,
    tracked: bool = True,
    truth: bool = True,
    title: str = "flight",
    pose: tuple[float, ...] = (0.0, 0.0, 0.0),
    stretch: int = 1,
    track_ids: tuple[int, ...] = (0,),
    method: str = "robust",
) -> Path:
    """A drone seen by one sensor that stands at `pose`; the estimate is off by OFFSET_M.

    The recording lasts `stretch` times longer; each of the tracks has its share of it.
    """
    directory = run / "frames" / "mid360"
    directory.mkdir(parents=True)
    rng = np.random.default_rng(3)
    flight = make_flight(frames=frames, drone=False)
    stamps_ns = [BEGIN_NS + stretch * (stamp_ns - BEGIN_NS) for stamp_ns in flight.stamps_ns]
    targets = []
    for stamp_ns, cloud in zip(stamps_ns, flight.clouds, strict=True):
        at = drone_position_m((stamp_ns - BEGIN_NS) * 1e-9)
        own = at + rng.normal(0, 0.1, (DRONE_RETURNS_PER_FRAME, 3))
        targets.append(own)
        write_pcd(directory / f"{seconds(stamp_ns)}.pcd", np.concatenate([cloud, own]) - pose)
    found = np.concatenate(targets) if tracked else np.zeros((0, 3))
    write_pcd(run / "target_returns.pcd", found)
    share = -(-frames // len(track_ids))
    of_track = dict(zip(stamps_ns, np.repeat(track_ids, share).tolist(), strict=False))
    _write_tables(run, of_track if tracked else {}, stamps_ns if truth else [])
    sensor = {"translation_m": list(pose), "rotation": [0, 0, 0, 1], "time_offset_s": 0.0}
    summary = {
        "version": "9.8.7",
        "inputs": [{"name": "mid360", "directory": str(directory), "frames": frames}],
        "config": {"method": method, "sensors": {"mid360": sensor}, "input": {"min": 0.5}},
        "counts": {"frames": frames, "returns": frames * 1026, "bad_frames": 3},
        "times_s": {"read": 0.25},
        "tracks": [
            {
                "track_id": track,
                "begin": seconds(BEGIN_NS),
                "rows": share,
                "kind": {"drone": 0.75, "bird_like": 0.0625, "unknown": 0.1875},
                "flight": {"hover_share": 0.375, "log_ratio": {"speed": -1.625}},
            }
            for track in track_ids
        ]
        if tracked
        else [],
    }
    (run / "summary.json").write_text(json.dumps(summary))
    path = run / "ground_truth.csv" if truth else None
    record = RunRecord(
        title, run, {"mid360": directory}, path, ["--threads", "2"],
        tracks=tracked * len(track_ids), tracking_s=1.5, total_s=2.5,
    )  # fmt: skip
    write_record(run, record)
    return run


def _write_tables(run: Path, of_track: dict[int, int], truth_ns: list[int]) -> None:
    with (run / "traj.csv").open("w") as file:
        print(TRAJ_HEADER, file=file)
        for stamp_ns, track in of_track.items():
            since_s = (stamp_ns - BEGIN_NS) * 1e-9
            place = drone_position_m(since_s) + OFFSET_M
            speed = (drone_position_m(since_s + 1e-4) - drone_position_m(since_s - 1e-4)) / 2e-4
            row = [seconds(stamp_ns), track, *place, *speed, *[SIGMA_M] * 3, 4]
            print(*row, sep=",", file=file)
    if truth_ns:
        with (run / "ground_truth.csv").open("w") as file:
            print("timestamp,x,y,z", file=file)
            for stamp_ns in range(truth_ns[0], truth_ns[-1] + 1, PERIOD_NS // 2):
                place = drone_position_m((stamp_ns - BEGIN_NS) * 1e-9)
                print(seconds(stamp_ns), *place, sep=",", file=file)
    with (run / "clusters.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["id", "rank", "size", "iou", "psi", "von_neumann_ratio"])
        for rank in range(1, CLUSTERS + 1):
            ratio = "inf" if rank == 2 else (rank * 7 % CLUSTERS) / 10
            writer.writerow([100 + rank, rank, 5 * rank, 0, 8 - rank / 10, ratio])
