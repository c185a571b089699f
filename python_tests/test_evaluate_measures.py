"""Measures beyond the error: identities, consistency of sigmas, intervals, the challenge."""

import dataclasses
import json

import numpy as np
import pytest
from flights import BEGIN_S, join_tracks, join_truths, place, track_at, truth_at, write_result
from scipy.stats import chi2
from unlidar.cli import main
from unlidar.completion import complete
from unlidar.evaluation import Options, evaluate
from unlidar.evaluation.bootstrap import times_drawn
from unlidar.truth import Tracks, Truth

TIMES = np.arange(0, 10, 0.1)


def two_targets() -> Truth:
    return join_truths(truth_at(TIMES), truth_at(TIMES, target=1.0, away_m=15.0))


def test_percentile_mean_and_square_are_those_of_the_distances():
    error = np.random.default_rng(1).normal(0, 0.3, (len(TIMES), 3))
    away = np.linalg.norm(error, axis=1)
    m = evaluate(truth_at(TIMES), track_at(TIMES, error))
    assert m["p95"] == pytest.approx(np.percentile(away, 95), abs=1e-4)
    assert m["median"] == pytest.approx(np.median(away), abs=1e-4)
    assert m["ape"] == pytest.approx(away.mean(), abs=1e-4)
    assert m["mse"] == pytest.approx((away**2).mean(), abs=1e-4)
    assert m["mae_y"] == pytest.approx(np.abs(error[:, 1]).mean(), abs=1e-4)
    assert m["rmse"] ** 2 == pytest.approx(m["dx"] ** 2 + m["dy"] ** 2 + m["dz"] ** 2, abs=1e-3)


def test_each_of_two_targets_keeps_its_own_track():
    m = evaluate(two_targets(), join_tracks(track_at(TIMES), track_at(TIMES, [15.0, 0, 0], 1.0)))
    assert (m["identity_switches"], m["matched"], m["coverage"]) == (0, 1.0, 1.0)
    assert [t["rmse"] for t in m["targets"]] == [0.0, 0.0]


def test_a_track_that_serves_both_targets_covers_but_matches_only_one():
    near = join_truths(truth_at(TIMES), truth_at(TIMES, target=1.0, away_m=1.0))
    m = evaluate(near, track_at(TIMES, [0.5, 0, 0]))
    assert (m["coverage"], m["within1m"], m["matched"]) == (1.0, 1.0, 0.5)
    assert sorted(t["matched"] for t in m["targets"]) == [0.0, 1.0]


def test_an_uncovered_drone_is_not_charged_the_way_to_the_track_of_another():
    m = evaluate(two_targets(), track_at(TIMES, [0.3, 0, 0]))
    assert m["drones"] == 2
    assert (m["matched"], m["matched_rmse"], m["matched_rmse_unbiased"]) == (0.5, 0.3, 0.0)
    assert m["intervals"]["matched_rmse"] == [0.3, 0.3]
    assert m["intervals"]["matched"] == [0.5, 0.5]
    assert m["rmse"] == pytest.approx(np.sqrt((0.3**2 + 14.7**2) / 2), abs=1e-4)  # of the nearest
    found, missed = m["targets"]
    assert (found["matched"], found["matched_rmse"]) == (1.0, 0.3)
    assert missed["matched"] == 0.0
    assert "matched_rmse" not in missed


def test_nees_of_several_drones_is_that_of_their_own_tracks():
    sigma = np.full((len(TIMES), 3), 0.1)
    alone = evaluate(truth_at(TIMES), track_at(TIMES, [0.2, 0, 0], sigma_m=sigma))
    m = evaluate(two_targets(), track_at(TIMES, [0.2, 0, 0], sigma_m=sigma))
    assert m["nees"] == alone["nees"] == 4.0


def test_of_several_drones_the_matched_error_is_reported_first(tmp_path, capsys):
    both = join_tracks(track_at(TIMES, [0.3, 0, 0]), track_at(TIMES[:50], [15.1, 0, 0], 1.0))
    folder = write_result(tmp_path / "two", two_targets(), both)
    assert main(["evaluate", str(folder / "ground_truth.csv"), str(folder / "traj.csv")]) == 0
    out = capsys.readouterr().out
    first, second = out.index("RMSE, matched"), out.index("RMSE, nearest track")
    assert out.index("75.0 %") < first < second
    assert "0.100 m, 50.0 %" in out
    assert main(["evaluate", str(folder)]) == 0
    assert "matched" in capsys.readouterr().out


def test_tracks_that_swap_their_targets_are_two_switches():
    late = TIMES >= 5
    swapped = np.where(late[:, None], [15.0, 0, 0], [0.0, 0, 0])
    other = np.where(late[:, None], [0.0, 0, 0], [15.0, 0, 0])
    m = evaluate(two_targets(), join_tracks(track_at(TIMES, swapped), track_at(TIMES, other, 1.0)))
    assert m["identity_switches"] == 2


def test_a_track_lost_and_found_under_another_number_is_one_switch_under_its_own_none():
    first, second = track_at(TIMES[:40]), track_at(TIMES[60:], track_id=1.0)
    assert evaluate(truth_at(TIMES), join_tracks(first, second))["identity_switches"] == 1
    same = dataclasses.replace(second, track_id=np.zeros(40))
    assert evaluate(truth_at(TIMES), join_tracks(first, same))["identity_switches"] == 0


def test_two_tracks_on_one_target_do_not_switch_with_every_wiggle():
    noise = np.random.default_rng(2).normal(0, 0.2, (2, len(TIMES), 3))
    both = join_tracks(track_at(TIMES, noise[0]), track_at(TIMES, noise[1], 1.0))
    assert evaluate(truth_at(TIMES), both)["identity_switches"] == 0


def test_as_many_targets_as_possible_are_matched():
    # Track 0 is nearest to both targets, track 1 reaches only target 0: each must get one.
    truth = join_truths(truth_at(TIMES), truth_at(TIMES, target=1.0, away_m=1.0))
    both = join_tracks(track_at(TIMES, [0.1, 0, 0]), track_at(TIMES, [-1.5, 0, 0], 1.0))
    assert evaluate(truth, both)["matched"] == 1.0


def test_matches_of_tiny_problems_are_the_best_of_all_ways_to_match():
    import itertools

    from unlidar.evaluation.association import _match

    rng = np.random.default_rng(5)
    for _ in range(200):
        away = rng.uniform(0, 2, rng.integers(1, 4, 2))
        away[rng.random(away.shape) < 0.4] = np.inf
        pairs = _match(away, [None] * len(away))
        ways = [
            {i: k for i, k in enumerate(way) if k is not None and np.isfinite(away[i, k])}
            for way in itertools.product([None, *range(away.shape[1])], repeat=len(away))
            if len(set(way) - {None}) == len([k for k in way if k is not None])
        ]
        best = min(ways, key=lambda w: (-len(w), sum(away[i, k] for i, k in w.items())))
        assert len(pairs) == len(best)
        cost = [sum(away[i, k] for i, k in w.items()) for w in (pairs, best)]
        assert cost[0] == pytest.approx(cost[1])


def test_nees_of_honest_sigmas_is_three_and_of_halved_ones_twelve():
    times = np.arange(0, 400, 0.1)
    rng = np.random.default_rng(3)
    sigma = rng.uniform(0.05, 0.5, (len(times), 3))
    error = rng.normal(0, sigma)
    honest = evaluate(truth_at(times), track_at(times, error, sigma_m=sigma), Options(bootstrap=0))
    assert honest["nees"] == pytest.approx(3.0, abs=0.15)
    assert honest["nees_median"] == pytest.approx(chi2.median(3), abs=0.15)
    assert honest["nees_within95"] == pytest.approx(0.95, abs=0.015)
    bold = evaluate(
        truth_at(times), track_at(times, error, sigma_m=sigma / 2), Options(bootstrap=0)
    )
    assert bold["nees"] == pytest.approx(4 * honest["nees"], rel=1e-3)


def test_nees_is_absent_without_sigmas_and_leaves_out_rows_whose_sigma_is_zero():
    assert "nees" not in evaluate(truth_at(TIMES), track_at(TIMES))
    sigma = np.ones((len(TIMES), 3))
    sigma[:50] = 0
    m = evaluate(truth_at(TIMES), track_at(TIMES, [2.0, 0, 0], sigma_m=sigma))
    assert m["nees"] == 4.0


def test_nees_does_not_change_with_the_frame_the_truth_is_given_in():
    rng = np.random.default_rng(4)
    sigma = np.tile([0.1, 0.2, 0.8], (len(TIMES), 1))
    track = track_at(TIMES, rng.normal(0, sigma), sigma_m=sigma)
    plain = evaluate(truth_at(TIMES), track, Options(align="se3", bootstrap=0))
    turned = truth_at(TIMES)
    axes = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
    turned = dataclasses.replace(turned, xyz_m=turned.xyz_m @ axes.T + 7)
    m = evaluate(turned, track, Options(align="se3", bootstrap=0))
    assert m["nees"] == pytest.approx(plain["nees"], abs=1e-3)


def test_the_challenge_counts_every_stamp_with_gaps_bridged_and_ends_held():
    line = Truth(
        BEGIN_S + TIMES, np.zeros(100), np.outer(TIMES, [1.0, 0, 0]), np.ones(100, dtype=bool)
    )
    kept = (TIMES >= 2) & (TIMES < 4) | (TIMES >= 7)
    ids = (TIMES >= 5).astype(float)
    tracks = Tracks(line.time_s[kept], ids[kept], line.xyz_m[kept])
    m = evaluate(line, tracks)
    before = np.mean(np.where(TIMES < 2, TIMES - 2, 0) ** 2)
    assert m["challenge_mse"] == pytest.approx(before, abs=1e-4)
    assert m["rmse"] < 0.05
    assert m["coverage"] < 0.7
    assert (
        evaluate(line, Tracks(*(np.zeros(0), np.zeros(0), np.zeros((0, 3)))))["challenge_mse"]
        is None
    )
    assert "challenge_mse" not in evaluate(two_targets(), track_at(TIMES))


def test_of_tracks_at_once_the_better_supported_answers():
    strong = dataclasses.replace(track_at(TIMES[:50]), support=np.full(50, 9.0))
    weak = dataclasses.replace(track_at(TIMES, [3.0, 0, 0], 1.0), support=np.full(100, 2.0))
    both = dataclasses.replace(
        join_tracks(strong, weak), support=np.concatenate([strong.support, weak.support])
    )
    answer = complete(both, BEGIN_S + TIMES) - place(TIMES)
    assert np.allclose(answer[:50], 0, atol=1e-5)
    assert np.allclose(answer[50:], [3, 0, 0], atol=1e-5)


def test_intervals_hold_the_measure_and_are_the_same_for_the_same_seed():
    noise = np.random.default_rng(6).normal(0, 0.3, (len(TIMES), 3))
    truth, track = truth_at(TIMES), track_at(TIMES, noise)
    m = evaluate(truth, track)
    for name in ("rmse", "mse", "ape", "median", "p95", "dx", "dy", "dz"):
        low, high = m["intervals"][name]
        assert low < m[name] < high, name
    assert m == evaluate(truth, track)
    assert m["intervals"] != evaluate(truth, track, Options(seed=1))["intervals"]
    assert "intervals" not in evaluate(truth, track, Options(bootstrap=0))


def test_measures_of_drawn_rows_are_those_of_the_rows_written_out():
    from unlidar.evaluation.bootstrap import _Weighted

    rng = np.random.default_rng(11)
    error = rng.normal(0, 0.6, (50, 3))
    error[rng.random(50) < 0.2] = np.nan
    weight = rng.integers(0, 4, 50)
    written = np.repeat(error, weight, axis=0)
    away = np.linalg.norm(written, axis=1)
    known = away[np.isfinite(away)]
    found = _Weighted(error, 1.0).of(weight.astype(float))
    assert found["coverage"] == pytest.approx(len(known) / len(away))
    assert found["within1m"] == pytest.approx((away < 1).mean())
    assert found["rmse"] == pytest.approx(np.sqrt((known**2).mean()))
    assert found["median"] == pytest.approx(np.median(known))
    assert found["p95"] == pytest.approx(np.percentile(known, 95))
    assert found["dz"] == pytest.approx(np.sqrt(np.nanmean(written[:, 2] ** 2)))


def drawn_error(rng: np.random.Generator, memory: float, count: int) -> np.ndarray:
    error = rng.normal(0, 1, (count, 3))
    for i in range(1, count):
        error[i] = memory * error[i - 1] + np.sqrt(1 - memory**2) * error[i]
    return 0.2 * error


@pytest.mark.parametrize("block_s", [0.1, 0.7, 1.0, 3.3, 9.9, 30.0])
@pytest.mark.parametrize("targets", [1, 3])
def test_every_row_is_drawn_equally_often(block_s, targets):
    times = np.repeat(TIMES, targets)
    rng = np.random.default_rng(1)
    weight = np.array([times_drawn(times, block_s, rng) for _ in range(4000)])
    mean = weight.mean(axis=0)
    assert np.allclose(mean, mean.mean(), atol=5 * weight.std() / np.sqrt(4000))
    assert mean.mean() >= 1 - 1e-9
    assert (weight.sum(axis=1) >= min(block_s, 10.0) / 0.1 * targets - 1e-9).all()


def test_blocks_begin_in_the_last_block_length_too():
    error = np.zeros((len(TIMES), 3))
    error[-1, 0] = 5.0  # drawn by hardly any block that has to end with the recording
    m = evaluate(truth_at(TIMES), track_at(TIMES, error), Options(block_s=3.0))
    low, high = m["intervals"]["rmse"]
    assert low < m["rmse"] < high
    mirrored = evaluate(truth_at(TIMES), track_at(TIMES, error[::-1]), Options(block_s=3.0))
    assert mirrored["intervals"]["rmse"] == pytest.approx([low, high], abs=0.1)


def test_intervals_hold_the_true_rmse_about_as_often_as_they_claim():
    """Errors with a memory of half a second: single rows as blocks would claim too much."""
    rng = np.random.default_rng(7)
    times = np.arange(0, 40, 0.1)
    held = {1.0: 0, 0.1: 0}
    for _ in range(40):
        error = drawn_error(rng, 0.8, len(times))
        for block in held:
            options = Options(bootstrap=100, block_s=2 * block)
            low, high = evaluate(truth_at(times), track_at(times, error), options)["intervals"][
                "rmse"
            ]
            held[block] += low <= 0.2 * np.sqrt(3) <= high
    assert held[1.0] >= 32
    assert held[0.1] < held[1.0]


def test_switches_and_intervals_are_printed(tmp_path, capsys):
    sigma = np.full((len(TIMES), 3), 0.2)
    folder = write_result(tmp_path, truth_at(TIMES), track_at(TIMES, [0.3, 0, 0], sigma_m=sigma))
    files = [str(folder / "ground_truth.csv"), str(folder / "traj.csv")]
    assert main(["evaluate", *files]) == 0
    out = capsys.readouterr().out
    for said in ("identity switches", "95 % interval", "NEES", "UG2+ MSE", "95th percentile"):
        assert said in out, said
    assert main(["evaluate", *files, "--markdown"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 3
    assert len({line.count("|") for line in lines}) == 1
    assert "0.300" in lines[2]
    assert main(["evaluate", *files, "--json", "--seed", "4", "--bootstrap", "50"]) == 0
    assert json.loads(capsys.readouterr().out)["nees"] == pytest.approx(2.25, abs=1e-3)


@pytest.mark.parametrize(
    "wrong",
    [
        ["--bootstrap", "-1"],
        ["--block", "0"],
        ["--seed", "x"],
        ["--time-offset", "nan"],
        ["--align", "scale"],
        ["--json", "--markdown"],
    ],
)
def test_a_wrong_option_is_a_usage_error(wrong, fails):
    fails(2, "evaluate", "truth.csv", "traj.csv", *wrong)
