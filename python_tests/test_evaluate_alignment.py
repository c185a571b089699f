"""Corrections by `--align` and `--time-offset`, which are never applied silently."""

import dataclasses
import json

import numpy as np
import pytest
from flights import BEGIN_S, join_tracks, join_truths, track_at, truth_at, write_result
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation
from unlidar.cli import main
from unlidar.evaluate_options import ALIGNMENTS
from unlidar.evaluation import Options, evaluate
from unlidar.evaluation.alignment import fit_alignment
from unlidar.truth import Tracks

TIMES = np.arange(0, 10, 0.1)
LEVER = np.array([0.04, -0.09, -0.56])


def points(seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    from_m = rng.normal(0, [5, 3, 1], (40, 3)) + rng.normal(0, 20, 3)
    turn = Rotation.random(rng=rng).as_matrix() if seed % 2 else np.eye(3)
    return from_m, from_m @ turn.T + rng.normal(0, 0.3, (40, 3)) + rng.normal(0, 9, 3)


def residual(alignment, from_m: np.ndarray, to_m: np.ndarray) -> float:
    moved = from_m @ alignment.rotation.T + alignment.translation_m
    return float(((moved - to_m) ** 2).sum())


@pytest.mark.parametrize("seed", range(8))
def test_any_turn_is_that_of_scipy(seed):
    from_m, to_m = points(seed)
    found = fit_alignment("se3", from_m, to_m)
    centred = from_m - from_m.mean(axis=0), to_m - to_m.mean(axis=0)
    known, _ = Rotation.align_vectors(centred[1], centred[0])
    assert found.rotation == pytest.approx(known.as_matrix(), abs=1e-7)
    assert np.linalg.det(found.rotation) == pytest.approx(1.0)


@pytest.mark.parametrize("seed", range(8))
def test_a_turn_about_z_is_the_best_of_all_turns_about_z(seed):
    from_m, to_m = points(seed)
    found = fit_alignment("yaw", from_m, to_m)
    assert found.rotation[2] == pytest.approx([0, 0, 1])

    def left(angle: float) -> float:
        turned = from_m @ Rotation.from_euler("z", angle).as_matrix().T
        return float(((turned - to_m - (turned - to_m).mean(axis=0)) ** 2).sum())

    tried = np.linspace(-np.pi, np.pi, 73)
    start = tried[np.argmin([left(angle) for angle in tried])]
    best = minimize_scalar(left, bounds=(start - 0.1, start + 0.1), options={"xatol": 1e-10})
    assert residual(found, from_m, to_m) == pytest.approx(best.fun, rel=1e-9)


def test_more_freedom_never_leaves_more_error():
    for seed in range(8):
        from_m, to_m = points(seed)
        left = [residual(fit_alignment(kind, from_m, to_m), from_m, to_m) for kind in ALIGNMENTS]
        assert left == sorted(left, reverse=True)


def test_a_mirrored_flight_is_not_turned_into_a_mirror():
    from_m, _ = points(0)
    found = fit_alignment("se3", from_m, from_m * [1, 1, -1])
    assert np.linalg.det(found.rotation) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("kind", "turn"), [("yaw", [0, 0, 200]), ("se3", [20, -15, 200]), ("se3", [180, 0, 3])]
)
def test_a_station_in_another_frame_loses_all_its_error_and_the_turn_is_reported(kind, turn):
    rotation = Rotation.from_euler("xyz", turn, degrees=True).as_matrix()
    track = track_at(TIMES)
    track = dataclasses.replace(track, xyz_m=(track.xyz_m - LEVER) @ rotation)
    m = evaluate(truth_at(TIMES), track, Options(align=kind))
    assert m["rmse"] == 0.0
    assert np.array(m["align_rotation"]) == pytest.approx(rotation, abs=1e-5)
    assert m["align_translation_m"] == pytest.approx(LEVER, abs=1e-3)
    assert evaluate(truth_at(TIMES), track)["rmse"] > 1


def test_two_targets_share_one_alignment_also_where_the_nearest_track_was_the_wrong_one():
    apart = np.outer(2 + TIMES, [1.0, 0, 0])  # at first less than twice the offset
    second = truth_at(TIMES, target=1.0)
    truth = join_truths(truth_at(TIMES), dataclasses.replace(second, xyz_m=second.xyz_m + apart))
    offset = np.array([1.6, 0.2, 0])
    moved = join_tracks(track_at(TIMES, offset), track_at(TIMES, apart + offset, 1.0))
    m = evaluate(truth, moved, Options(align="translation"))
    assert m["rmse"] == 0.0
    assert m["align_translation_m"] == [-1.6, -0.2, 0.0]


def test_a_turn_that_the_flight_does_not_show_is_refused(tmp_path, fails):
    along = np.outer(TIMES, [1.0, 2.0, 0.5])
    line = dataclasses.replace(truth_at(TIMES), xyz_m=along)
    track = dataclasses.replace(track_at(TIMES), xyz_m=along + LEVER)
    folder = write_result(tmp_path / "line", line, track)
    files = folder / "ground_truth.csv", folder / "traj.csv"
    assert "--align se3" in fails(4, "evaluate", *files, "--align", "se3")
    assert main(["evaluate", *map(str, files), "--align", "yaw"]) == 0
    up = np.outer(TIMES, [0.0, 0.0, 0.5])
    folder = write_result(
        tmp_path / "up",
        dataclasses.replace(line, xyz_m=up),
        dataclasses.replace(track, xyz_m=up + LEVER),
    )
    files = folder / "ground_truth.csv", folder / "traj.csv"
    line = fails(4, "evaluate", *files, "--align", "yaw")
    assert "--align yaw" in line
    assert "traj.csv" in line


@pytest.mark.parametrize("delay", [-0.413, -0.05, 0.0, 0.0321, 0.8])
def test_a_late_clock_is_found_also_beside_a_lever_arm(delay):
    """Stamps that lag by `delay` need it taken off; the lever arm must not be taken for it."""
    noise = np.random.default_rng(8).normal(0, 0.02, (len(TIMES), 3))
    truth = truth_at(np.arange(-2, 12, 0.02))
    late = track_at(TIMES, LEVER + noise)
    late = dataclasses.replace(late, time_s=late.time_s + delay)
    m = evaluate(truth, late, Options(time_offset="auto"))
    assert m["time_offset_s"] == pytest.approx(-delay, abs=3e-3)
    assert m["time_offset_estimated"] is True
    assert m["rmse_unbiased"] == pytest.approx(0.02 * np.sqrt(3), abs=8e-3)


def test_a_late_clock_is_found_in_a_flight_hardly_longer_than_the_offsets_tried():
    """Large offsets leave a few stamps whose errors are nearly alike: they must not win."""
    times = np.arange(0, 1.1, 0.05)
    noise = np.random.default_rng(10).normal(0, 0.03, (len(times), 3))
    late = track_at(times, LEVER + noise)
    late = dataclasses.replace(late, time_s=late.time_s + 0.1)
    m = evaluate(truth_at(times), late, Options(time_offset="auto"))
    assert m["time_offset_s"] == pytest.approx(-0.1, abs=0.04)


def test_the_sigma_of_the_offset_covers_its_error():
    """Drawn with errors that last about as long as they are taken to last."""
    truth, worst = truth_at(np.arange(-2, 32, 0.05)), []
    times = np.arange(0, 30, 0.1)
    for seed in range(6):
        coarse = np.random.default_rng(seed).normal(0, 0.3, (32, 3))
        error = np.stack([np.interp(times, np.arange(32), coarse[:, i]) for i in range(3)], axis=1)
        m = evaluate(truth, track_at(times, error), Options(time_offset="auto", bootstrap=0))
        worst.append(abs(m["time_offset_s"]) / m["time_offset_sigma_s"])
    assert max(worst) < 3
    assert max(worst) > 0.3


def test_a_late_clock_is_found_in_a_turned_frame():
    truth = truth_at(np.arange(-2, 12, 0.02))
    late = track_at(TIMES)
    turn = Rotation.from_euler("z", 130, degrees=True).as_matrix()
    late = Tracks(late.time_s + 0.25, late.track_id, late.xyz_m @ turn)
    m = evaluate(truth, late, Options(align="yaw", time_offset="auto"))
    assert m["time_offset_s"] == pytest.approx(-0.25, abs=2e-3)
    assert m["rmse"] < 0.02


def test_an_offset_as_given_is_added_and_said():
    truth = truth_at(np.arange(-2, 12, 0.02))
    late = track_at(TIMES)
    late = dataclasses.replace(late, time_s=late.time_s + 0.3)
    m = evaluate(truth, late, Options(time_offset=-0.3))
    assert m["rmse"] < 0.02
    assert (m["time_offset_s"], m["time_offset_estimated"]) == (-0.3, False)
    plain = evaluate(truth, late)
    assert "time_offset_s" not in plain
    assert plain["rmse"] > 0.5


def test_an_offset_that_cannot_be_found_is_an_error_and_not_a_guess(tmp_path, fails):
    still = dataclasses.replace(truth_at(TIMES), xyz_m=np.ones((100, 3)))
    track = dataclasses.replace(track_at(TIMES), xyz_m=np.ones((100, 3)) + LEVER)
    hover = np.random.default_rng(9).normal(0, 0.02, (100, 3))
    times = BEGIN_S + TIMES
    steady = dataclasses.replace(still, xyz_m=np.outer(TIMES, [1.0, 2, 0]))
    cases = {
        "still": (still, track),
        "hovers": (still, dataclasses.replace(track, xyz_m=track.xyz_m + hover)),
        "steady": (steady, Tracks(times, np.zeros(100), steady.xyz_m + LEVER + hover)),
        "far": (truth_at(TIMES), dataclasses.replace(track, time_s=track.time_s + 60)),
        "one": (truth_at(TIMES[:1]), track_at(TIMES)),
    }
    for name, (truth, tracks) in cases.items():
        folder = write_result(tmp_path / name, truth, tracks)
        files = folder / "ground_truth.csv", folder / "traj.csv"
        said = fails(4, "evaluate", *files, "--time-offset", "auto")
        assert ("no time in common" if name == "far" else "--time-offset auto") in said, name


def test_what_was_taken_off_is_printed(tmp_path, capsys):
    late = track_at(TIMES, LEVER)
    late = dataclasses.replace(late, time_s=late.time_s + 0.2)
    folder = write_result(tmp_path, truth_at(np.arange(-2, 12, 0.05)), late)
    files = [str(folder / "ground_truth.csv"), str(folder / "traj.csv")]
    assert main(["evaluate", *files, "--align", "se3", "--time-offset", "auto"]) == 0
    out = capsys.readouterr().out
    for said in ("tracks moved by", "turned by", "added to the stamps", "estimated", "-0.2"):
        assert said in out, said
    assert main(["evaluate", *files, "--time-offset", "-0.2", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["time_offset_s"] == -0.2
