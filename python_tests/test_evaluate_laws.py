"""Laws of the measures for any truth and any tracks, drawn at random."""

import dataclasses

import numpy as np
import pytest
from flights import BEGIN_S
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from unlidar.evaluation import FALSE_BEYOND_M, Options, evaluate
from unlidar.evaluation.association import identities
from unlidar.evaluation.bootstrap import LEVEL, times_drawn
from unlidar.truth import Tracks, Truth

ERRORS_OF_ROTATION = 2e-4  # measures have four places
SHARES = (
    "coverage",
    "within1m",
    "matched",
    "false",
    "rows_false",
    "nees_within95",
    "nees_unbiased_within95",
)
# Not of the shape of the errors, which a motion keeps, but of the axes that it turns.
OF_THE_AXES = ("dx", "dy", "dz", "mae_x", "mae_y", "mae_z", "bias", "rows_dx", "rows_dy", "rows_dz")
OF_THE_SIGMAS = [
    f"nees{about}{kind}" for about in ("", "_unbiased") for kind in ("", "_median", "_within95")
]


SEEDS = st.integers(0, 2**32 - 1)


@st.composite
def flights(draw) -> tuple[Truth, Tracks]:
    """Targets with gaps, and tracks that follow one of them more or less, or none."""
    rng = np.random.default_rng(draw(SEEDS))
    truths, tracks = [], []
    for target in range(draw(st.integers(1, 3))):
        time_s = _some(rng, 0.1, draw(st.integers(0, 40)), draw(st.sampled_from([0.0, 0.2, 0.8])))
        seen = rng.random(len(time_s)) < draw(st.sampled_from([1.0, 0.7, 0.0]))
        truths.append((time_s, np.full(len(time_s), float(target)), _path(target, time_s), seen))
    for track in range(draw(st.integers(0, 4))):
        time_s = _some(rng, 0.05, draw(st.integers(0, 90)), draw(st.sampled_from([0.0, 0.3])))
        away_m = draw(st.sampled_from([0.0, 0.01, 0.5, 2.0, 100.0]))
        xyz_m = _path(draw(st.integers(0, 2)), time_s) + rng.normal(0, away_m, (len(time_s), 3))
        sigma_m = rng.uniform(0.01, 2, (len(time_s), 3)) * (rng.random((len(time_s), 1)) < 0.9)
        tracks.append((time_s, np.full(len(time_s), 2.0 * track), xyz_m, sigma_m))
    tracks.append((np.zeros(0), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3))))
    return Truth(*map(np.concatenate, zip(*truths, strict=True))), Tracks(
        *map(np.concatenate, zip(*tracks, strict=True))
    )


def _some(rng: np.random.Generator, step_s: float, count: int, dropped: float) -> np.ndarray:
    """Stamps of a grid that begins somewhere, some of them missing."""
    stamps = np.arange(count) + rng.integers(-20, 20)
    return BEGIN_S + stamps[rng.random(count) >= dropped] * step_s


def _path(target: int, time_s: np.ndarray) -> np.ndarray:
    """Targets come within a metre of each other at times."""
    t = time_s - BEGIN_S
    return np.stack([3 * np.cos(t + target), 2 * np.sin(1.7 * t), 5 + target + 0.1 * t], axis=1)


def moved(xyz_m: np.ndarray, rotation: Rotation, shift_m: np.ndarray) -> np.ndarray:
    return rotation.apply(xyz_m) + shift_m if len(xyz_m) else xyz_m


def assert_alike(one: object, other: object, where: str = "") -> None:
    """Equal but for the last of four places."""
    if isinstance(one, dict):
        assert one.keys() == other.keys(), where
        for key in one:
            assert_alike(one[key], other[key], f"{where}.{key}")
    elif isinstance(one, list):
        assert len(one) == len(other), where
        for i, (a, b) in enumerate(zip(one, other, strict=True)):
            assert_alike(a, b, f"{where}[{i}]")
    elif isinstance(one, float):
        assert other == pytest.approx(one, rel=1e-5, abs=ERRORS_OF_ROTATION), where
    else:
        assert one == other, where


def decided_by_a_hair(truth: Truth, tracks: Tracks) -> bool:
    """True if rounding decides the result: a distance on a limit, or two tracks equally near."""
    for target in np.unique(truth.target):
        own = truth.xyz_m[truth.target == target]
        for limit in (1.0, FALSE_BEYOND_M):
            away = np.linalg.norm(own[:, None] - tracks.xyz_m[None], axis=2)
            if np.any(np.abs(away - limit) < 1e-6):
                return True
    return False


@given(flights())
def test_shares_are_shares_and_counts_add_up(flight) -> None:
    truth, tracks = flight
    m = evaluate(truth, tracks, Options(bootstrap=0))
    for name in SHARES:
        if m.get(name) is not None:
            assert 0 <= m[name] <= 1, name
    assert m["rows"] == len(tracks)
    if len(truth) == 0:
        return
    assert m["rows_judged"] + m["rows_unjudged"] == m["rows"]
    assert m["drones"] == len(np.unique(truth.target))
    if m["within1m"] is not None:
        assert m["within1m"] <= m["coverage"] + 1e-9
        assert m["matched"] <= m["coverage"] + 1e-9
    else:
        assert not truth.in_view.any()
    if "matched_rmse" in m:
        assert m["matched_rmse"] <= FALSE_BEYOND_M + 1e-4
        assert m["matched_rmse_unbiased"] <= m["matched_rmse"] + 1e-4
    if "rmse" in m:
        assert m["rmse_unbiased"] <= m["rmse"] + 1e-4
        assert m["median"] <= m["p95"]
        assert m["ape"] <= m["rmse"] + 1e-4


@given(flights(), st.randoms(use_true_random=False))
def test_the_order_of_rows_does_not_matter(flight, random) -> None:
    truth, tracks = flight
    rows, order = list(range(len(truth))), list(range(len(tracks)))
    random.shuffle(rows)
    random.shuffle(order)
    rows, order = np.array(rows, dtype=int), np.array(order, dtype=int)
    shuffled = Truth(*(getattr(truth, f.name)[rows] for f in dataclasses.fields(Truth)))
    mixed = dataclasses.replace(
        tracks,
        time_s=tracks.time_s[order],
        track_id=tracks.track_id[order],
        xyz_m=tracks.xyz_m[order],
        sigma_m=None if tracks.sigma_m is None else tracks.sigma_m[order],
    )
    options = Options(bootstrap=20)
    assert_alike(evaluate(shuffled, mixed, options), evaluate(truth, tracks, options))


@given(
    flights(),
    st.tuples(*[st.floats(-3, 3)] * 3),
    st.tuples(*[st.integers(-1000, 1000)] * 3),
    st.integers(-(10**6), 10**6),
)
def test_a_motion_of_both_and_another_clock_for_both_change_no_error(
    flight, turn, shift_m, later_s
) -> None:
    truth, tracks = flight
    if decided_by_a_hair(truth, tracks):
        return
    rotation, shift = Rotation.from_rotvec(turn), np.array(shift_m, dtype=float)
    there = dataclasses.replace(
        truth, xyz_m=moved(truth.xyz_m, rotation, shift), time_s=truth.time_s + later_s
    )
    with_it = dataclasses.replace(
        tracks, xyz_m=moved(tracks.xyz_m, rotation, shift), time_s=tracks.time_s + later_s
    )
    here, elsewhere = (
        {
            key: value
            for key, value in evaluate(*pair, Options(bootstrap=0)).items()
            if key not in (*OF_THE_AXES, *OF_THE_SIGMAS)
        }
        for pair in (flight, (there, with_it))
    )
    assert_alike(here, elsewhere)


@given(flights(), st.integers(1, 40), st.sampled_from([0.05, 0.3, 1.0, 2.5, 100.0]))
def test_every_interval_holds_its_estimate(flight, replicates, block_s) -> None:
    m = evaluate(*flight, Options(bootstrap=replicates, block_s=block_s))
    for name, (low, high) in m.get("intervals", {}).items():
        assert low <= m[name] <= high, name


@given(flights(), st.sampled_from(["translation", "yaw", "se3"]))
def test_no_alignment_makes_the_mean_square_worse(flight, kind) -> None:
    from unlidar.errors import InputError

    truth, tracks = flight
    if len(np.unique(tracks.track_id)) > 1:
        return  # another track may become the nearest
    plain = evaluate(truth, tracks, Options(bootstrap=0))
    try:
        aligned = evaluate(truth, tracks, Options(align=kind, bootstrap=0))
    except InputError:
        return  # the flight leaves the turn open
    assert aligned.get("coverage") == plain.get("coverage")
    if "rmse" in plain:
        assert aligned["rmse"] <= plain["rmse"] + 1e-4
        assert aligned["rmse"] <= plain["rmse_unbiased"] + 1e-4


@given(
    st.lists(st.integers(0, 200), min_size=1, max_size=60),
    st.floats(0.05, 50),
    st.integers(0, 2**32 - 1),
)
@settings(max_examples=200)
def test_a_replicate_holds_rows_of_the_sequence_as_often_as_blocks_fall_on_them(
    stamps, block_s, seed
) -> None:
    times = np.sort(np.array(stamps)) * 0.1
    weight = times_drawn(times, block_s, np.random.default_rng(seed))
    assert weight.shape == times.shape
    assert (weight >= 0).all()
    assert np.array_equal(weight, np.round(weight))
    # Rows of one stamp are drawn together.
    for stamp in np.unique(times):
        assert len(set(weight[times == stamp])) == 1
    around = np.ptp(times) + (np.median(np.diff(np.unique(times))) if np.ptp(times) else 0)
    assert weight.max() <= max(1, np.ceil(around / block_s))


def test_the_level_of_the_intervals_is_the_stated_one() -> None:
    assert LEVEL == 0.95


@pytest.mark.parametrize("order", [[0, 1], [1, 0]])
def test_of_two_targets_that_had_one_track_the_later_keeps_it(order) -> None:
    """Target 0 has the track, then target 1; then both are there, as near to it as each other."""
    seen = np.array([[True, False, True], [False, True, True]])[order].ravel()
    target = np.repeat(np.array(order, dtype=float), 3)
    time_s = BEGIN_S + 0.1 * np.tile(np.arange(3.0), 2)
    middle_m = np.array([[0.0, 0, 5], [1, 0, 5], [2, 0, 5]])
    xyz_m = np.tile(middle_m, (2, 1)) + np.column_stack([np.zeros(6), target - 0.5, np.zeros(6)])
    own = identities(
        Truth(time_s, target, xyz_m, seen), Tracks(time_s[:3], np.zeros(3), middle_m)
    ).own
    matched = np.isfinite(own.distance_m)
    pairs = zip(target[matched], np.rint(10 * (time_s[matched] - BEGIN_S)), strict=True)
    assert set(pairs) == {(0.0, 0.0), (1.0, 1.0), (1.0, 2.0)}
