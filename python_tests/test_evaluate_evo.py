"""`unlidar evaluate` against evo (github.com/MichaelGrupp/evo) on the same files."""

from pathlib import Path

import numpy as np
import pytest
from evo.core import metrics, sync
from evo.tools import file_interface
from flights import place, track_at, truth_at, write_result
from synthetic import run_program
from unlidar.cli import main
from unlidar.evaluation import Options, evaluate_files
from unlidar.truth import read_truth


def ape(folder: Path, align: bool) -> dict[str, float]:
    """The absolute pose error by evo, translation part; `align`: Umeyama without scale."""
    truth = read_truth(folder / "ground_truth.csv")
    lines = [
        f"{t:.9f} {' '.join(map(repr, map(float, xyz)))} 0 0 0 1"
        for t, xyz in zip(truth.time_s, truth.xyz_m, strict=True)
    ]
    (folder / "truth.tum").write_text("\n".join(lines) + "\n")
    assert main(["export", str(folder / "traj.csv"), str(folder / "traj.tum")]) == 0
    ours = file_interface.read_tum_trajectory_file(str(folder / "traj.tum"))
    reference = file_interface.read_tum_trajectory_file(str(folder / "truth.tum"))
    reference, ours = sync.associate_trajectories(reference, ours, max_diff=1e-4)
    if align:
        ours.align(reference, correct_scale=False)
    error = metrics.APE(metrics.PoseRelation.translation_part)
    error.process_data((reference, ours))
    assert len(error.error) > 20
    return error.get_all_statistics()


def assert_agree(folder: Path) -> None:
    files = folder / "ground_truth.csv", folder / "traj.csv"
    for kind in ("none", "se3"):
        theirs = ape(folder, kind == "se3")
        ours = evaluate_files(*files, Options(align=kind))
        for name, outside in (("rmse", "rmse"), ("ape", "mean"), ("median", "median")):
            assert ours[name] == pytest.approx(theirs[outside], abs=6e-5), (kind, name)
        assert ours["mse"] == pytest.approx(theirs["rmse"] ** 2, abs=6e-5)


@pytest.mark.parametrize("seed", range(4))
def test_errors_with_and_without_alignment_are_those_of_evo(seed, tmp_path):
    rng = np.random.default_rng(seed)
    times = np.sort(rng.choice(np.arange(0, 12, 0.05), 150, replace=False))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    small = np.eye(3) + 0.1 * (turn - turn.T)  # neither a rotation nor far from one
    moved = place(times) @ np.linalg.qr(small)[0].T * 1.02 + rng.normal(0, 2, 3)
    error = moved + rng.normal(0, 0.2, (150, 3)) - place(times)
    assert_agree(write_result(tmp_path, truth_at(times), track_at(times, error)))


def test_errors_on_the_real_flight_are_those_of_evo(shared, program, tmp_path):
    recording = shared / "data/mmaud/val/seq0001"
    assert main(["convert", str(recording), str(tmp_path / "frames")]) == 0
    truth = tmp_path / "frames" / "ground_truth.csv"
    result = run_program(
        "--quiet", "--frames", tmp_path / "frames" / "lidar_360", "--at", truth,
        "--out", tmp_path / "traj.csv",
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    # evo pairs stamps and knows no half frame beyond a track's ends
    rows = [line.split(",")[0] for line in (tmp_path / "traj.csv").read_text().splitlines()]
    begin, end = float(rows[1]), float(rows[-1])
    head, *lines = truth.read_text().splitlines()
    inside = [line for line in lines if begin <= float(line.split(",")[0]) <= end]
    assert len(inside) >= len(lines) - 2
    (tmp_path / "ground_truth.csv").write_text("\n".join([head, *inside]))
    assert_agree(tmp_path)
