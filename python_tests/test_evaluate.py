"""`unlidar evaluate` against the measures' definitions and an independent implementation."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from scripts import load_script
from unlidar.cli import main
from unlidar.evaluation import Options, evaluate, evaluate_files
from unlidar.truth import Tracks, Truth

BEGIN_S = 1_706_300_000.0


def flight(time_s: np.ndarray) -> np.ndarray:
    return np.stack([5 * np.cos(time_s), 4 * np.sin(0.7 * time_s), 9 + 0.3 * time_s], axis=1)


def make_truth(duration_s: float = 6.0, targets: int = 1) -> Truth:
    t = np.tile(np.arange(0, duration_s, 0.02), targets)
    target = np.repeat(np.arange(targets), len(t) // targets)
    xyz = flight(t) + 12.0 * target[:, None]
    return Truth(BEGIN_S + t, target.astype(float), xyz, np.ones(len(t), dtype=bool))


def make_tracks(time_s: np.ndarray, offset_m=(0.0, 0.0, 0.0), track_id: float = 0.0) -> Tracks:
    xyz = flight(time_s) + np.array(offset_m)
    return Tracks(BEGIN_S + time_s, np.full(len(time_s), track_id), xyz)


def joined(*parts: Tracks) -> Tracks:
    return Tracks(
        np.concatenate([p.time_s for p in parts]),
        np.concatenate([p.track_id for p in parts]),
        np.concatenate([p.xyz_m for p in parts]),
    )


def write(folder: Path, truth: Truth, tracks: Tracks) -> tuple[Path, Path]:
    paths = folder / "truth.csv", folder / "traj.csv"
    with paths[0].open("w") as file:
        file.write("timestamp,target,x,y,z,in_view\n")
        for t, k, xyz, seen in zip(
            truth.time_s, truth.target, truth.xyz_m, truth.in_view, strict=True
        ):
            file.write(f"{t:.6f},{k:.0f},{','.join(f'{v:.4f}' for v in xyz)},{int(seen)}\n")
    with paths[1].open("w") as file:
        file.write("timestamp,track_id,x,y,z,vx,vy,vz,sigma_x,sigma_y,sigma_z,support\n")
        for t, k, xyz in zip(tracks.time_s, tracks.track_id, tracks.xyz_m, strict=True):
            file.write(f"{t:.9f},{k:.0f},{','.join(repr(float(v)) for v in xyz)},0,0,0,1,1,1,3\n")
    return paths


@pytest.fixture(scope="module")
def judge(shared):
    """The outside implementation of the same measures."""
    return load_script(shared / "scenes/score.py").score


def assert_agree(judge, truth: Path, tracks: Path) -> dict:
    ours = evaluate_files(truth, tracks)
    theirs = judge(str(truth), str(tracks))
    for name, value in theirs.items():
        if isinstance(value, float) and math.isnan(value):
            assert ours[name] is None, name
        else:
            assert ours[name] == value, name
    return ours


@pytest.mark.parametrize("seed", range(25))
def test_every_measure_agrees_with_the_outside_judge_on_random_tracks(seed, judge, tmp_path):
    rng = np.random.default_rng(seed)
    truth = make_truth(targets=int(rng.integers(1, 4)))
    truth = Truth(truth.time_s, truth.target, truth.xyz_m, rng.random(len(truth)) < rng.random())
    parts = []
    for k in range(int(rng.integers(0, 5))):
        begin = rng.uniform(-1, 4)
        times = np.sort(rng.uniform(begin, begin + rng.uniform(0.1, 5), rng.integers(1, 80)))
        offset = rng.normal(0, 1, 3) + 12.0 * rng.integers(0, 3)
        track = make_tracks(times, offset, float(k * 3))
        noise = rng.normal(0, 0.3, track.xyz_m.shape)
        parts.append(Tracks(track.time_s, track.track_id, track.xyz_m + noise))
    tracks = joined(*parts) if parts else make_tracks(np.zeros(0))
    order = rng.permutation(len(tracks))  # rows of several tracks need not be sorted
    tracks = Tracks(tracks.time_s[order], tracks.track_id[order], tracks.xyz_m[order])
    assert_agree(judge, *write(tmp_path, truth, tracks))


@pytest.mark.parametrize("scene", ["near", "two", "none"])
def test_every_measure_agrees_with_the_outside_judge_on_scenes(scene, shared, judge, tmp_path):
    module = load_script(shared / "scenes/make_scenes.py")
    no_clutter = {sensor: [np.zeros((0, 3))] for sensor in ("mid360", "avia")}
    module.make(scene, tmp_path, no_clutter, 3)
    truth = tmp_path / scene / "ground_truth.csv"
    rng = np.random.default_rng(1)
    lines = truth.read_text().splitlines()[1::5] or [f"{BEGIN_S},0,1,2,3,1"] * 2
    rows = np.array([line.split(",") for line in lines], dtype=float)
    with (tmp_path / "traj.csv").open("w") as file:
        file.write("timestamp,track_id,x,y,z\n")
        for t, k, *xyz, _ in rows:
            x, y, z = np.array(xyz) + rng.normal(0, 0.6, 3)
            file.write(f"{t:.9f},{k:.0f},{x},{y},{z}\n")
    measures = assert_agree(judge, truth, tmp_path / "traj.csv")
    assert measures["tracks"] == {"near": 1, "two": 2, "none": 1}[scene]


def test_the_real_truth_as_its_own_track_has_no_error(shared, judge, tmp_path):
    truth = shared / "data/mmaud/val/seq0001/ground_truth.csv"
    lines = truth.read_text().splitlines()
    rows = [lines[0] + ",track_id"] + [line + ",1" for line in lines[1:]]
    (tmp_path / "traj.csv").write_text("\n".join(rows))
    measures = assert_agree(judge, truth, tmp_path / "traj.csv")
    assert measures["rmse"] == measures["rows_rmse"] == 0.0
    assert measures["coverage"] == measures["within1m"] == 1.0


def test_a_constant_offset_is_the_rmse_and_vanishes_with_the_mean_offset_removed():
    times = np.arange(0, 6, 0.02)
    m = evaluate(make_truth(), make_tracks(times, (0.3, -0.4, 1.2)))
    assert m["rmse"] == m["median"] == m["rows_rmse"] == 1.3
    assert (m["dx"], m["dy"], m["dz"]) == (0.3, 0.4, 1.2)
    assert m["bias"] == [0.3, -0.4, 1.2]
    assert m["rmse_unbiased"] == m["rows_rmse_unbiased"] == 0.0
    assert m["within1m"] == 0.0
    assert m["coverage"] == 1.0
    aligned = evaluate(
        make_truth(), make_tracks(times, (0.3, -0.4, 1.2)), Options(align="translation")
    )
    assert aligned["rmse"] == 0.0
    assert aligned["within1m"] == 1.0
    assert aligned["align_translation_m"] == [-0.3, 0.4, -1.2]


def test_alignment_is_a_translation_and_nothing_else():
    times = np.arange(0, 6, 0.1)
    still = Tracks(BEGIN_S + times, np.zeros(len(times)), np.zeros((len(times), 3)))
    plain, aligned = (
        evaluate(make_truth(), still, Options(align=align)) for align in ("none", "translation")
    )
    assert aligned["rmse"] == pytest.approx(plain["rmse_unbiased"], abs=1e-4)
    assert aligned["rmse"] > 3


def test_dropping_hard_frames_costs_coverage():
    half = evaluate(make_truth(), make_tracks(np.arange(0, 3.0, 0.1)))
    assert half["coverage"] == pytest.approx(0.5, abs=0.02)
    assert half["within1m"] == pytest.approx(0.5, abs=0.02)
    assert half["rmse"] < 0.02


def test_a_gap_longer_than_six_tenths_of_a_second_is_not_covered():
    for gap_s, coverage in ((0.55, 1.0), (2.0, 1 - 2.0 / 6)):
        times = np.concatenate([np.arange(0, 2.0, 0.05), np.arange(2.0 + gap_s, 6, 0.05)])
        m = evaluate(make_truth(), make_tracks(times))
        assert m["coverage"] == pytest.approx(coverage, abs=0.02)


def test_rows_are_judged_at_their_own_stamps_with_truth_interpolated():
    truth = make_truth()
    coarse = Truth(*(a[::10] for a in (truth.time_s, truth.target, truth.xyz_m, truth.in_view)))
    m = evaluate(coarse, make_tracks(np.arange(0.1, 5.7, 0.2)))  # in the middle between samples
    assert m["rows_judged"] == m["rows"]
    assert m["rows_rmse"] < 0.03  # the nearest sample would be 0.5 m off


def test_rows_beyond_the_truth_are_not_judged_but_reported():
    m = evaluate(make_truth(3.0), make_tracks(np.arange(0, 6, 0.1)))
    assert m["rows_judged"] + m["rows_unjudged"] == m["rows"] == 60
    assert m["rows_unjudged"] == 30
    assert m["rows_rmse"] < 0.01
    assert m["rows_false"] == 0.0
    assert m["false"] > 0.3  # the judge's measure holds them against the last truth


def test_a_track_far_from_every_target_is_false_and_does_not_hide_in_the_rmse_at_own_stamps():
    times = np.arange(0, 5.9, 0.1)
    good, ghost = make_tracks(times), make_tracks(times, (30.0, 0.0, 0.0), 1.0)
    m = evaluate(make_truth(), joined(good, ghost))
    assert m["tracks"] == 2
    assert m["false"] == m["rows_false"] == 0.5
    assert m["rmse"] < 0.01
    assert m["rows_rmse"] == pytest.approx(30 / math.sqrt(2), rel=1e-3)


def test_each_target_is_matched_with_its_nearest_track():
    times = np.arange(0, 6, 0.05)
    tracks = joined(make_tracks(times, (12, 12, 12), 5.0), make_tracks(times, (0.1, 0, 0), 7.0))
    m = evaluate(make_truth(targets=2), tracks)
    assert m["coverage"] == m["within1m"] == 1.0
    assert m["rmse"] == pytest.approx(0.1 / math.sqrt(2), abs=2e-3)


def test_empty_truth_and_empty_trajectory_are_answers(tmp_path):
    none, some = make_tracks(np.zeros(0)), make_tracks(np.arange(0, 1, 0.1))
    sky = make_truth(0.0)
    assert evaluate(sky, none) == {"tracks": 0, "rows": 0, "false": 0.0}
    assert evaluate(sky, some) == {"tracks": 1, "rows": 10, "false": 1.0}
    missed = evaluate(make_truth(), none)
    assert (missed["coverage"], missed["within1m"], missed["false"]) == (0.0, 0.0, 0.0)
    assert "rmse" not in missed
    for truth in (sky, make_truth()):
        for tracks in (none, some):
            paths = write(tmp_path, truth, tracks)
            assert main(["evaluate", *map(str, paths)]) == 0
            assert main(["evaluate", *map(str, paths), "--align", "translation"]) == 0


def test_a_plain_truth_without_target_and_view_is_one_target_in_view(tmp_path):
    truth, tracks = write(tmp_path, make_truth(), make_tracks(np.arange(0, 6, 0.1)))
    full = evaluate_files(truth, tracks)
    rows = [line.split(",") for line in truth.read_text().splitlines()]
    truth.write_text("\n".join(",".join([r[0], *r[2:5]]) for r in rows))
    assert evaluate_files(truth, tracks) == full


def test_json_is_one_valid_line_with_all_measures(tmp_path, capsys):
    truth = make_truth()
    unseen = Truth(truth.time_s, truth.target, truth.xyz_m, np.zeros(len(truth), dtype=bool))
    for one in (truth, unseen):
        paths = write(tmp_path, one, make_tracks(np.arange(0, 6, 0.1)))
        assert main(["evaluate", *map(str, paths), "--json"]) == 0
        out = capsys.readouterr().out
        assert out.count("\n") == 1
        assert json.loads(out, parse_constant=pytest.fail) == evaluate_files(*paths)


def test_rmse_is_never_printed_without_coverage(tmp_path, capsys):
    paths = write(tmp_path, make_truth(), make_tracks(np.arange(0, 3, 0.1)))
    assert main(["evaluate", *map(str, paths)]) == 0
    out = capsys.readouterr().out
    assert "RMSE" in out
    assert "coverage" in out
    assert "rows_" not in out


def test_rows_of_several_drones_without_their_numbers_are_noted(tmp_path, capsys):
    def rows(columns: str, *places: str) -> str:
        lines = [f"{k},{place}" for k in range(9) for place in places]
        return "\n".join([columns, *lines, ""])

    one, two = tmp_path / "one.csv", tmp_path / "two.csv"
    one.write_text(rows("timestamp,x,y,z", "0,0,5"))
    for columns, places, is_noted in (
        ("timestamp,x,y,z", ("0,0,5", "9,0,5"), True),
        ("timestamp,x,y,z", ("0,0,5", "0.1,0,5"), False),  # stamps that were rounded
        ("timestamp,x,y,z,target,track_id", ("0,0,5,0,0", "9,0,5,1,1"), False),
    ):
        two.write_text(rows(columns, *places))
        for truth, trajectory in ((one, two), (two, one)):
            assert main(["evaluate", str(truth), str(trajectory), "--json"]) in (0, 2)
            said = f"{two}: 9 rows are at another place at the time of the row before, the first at"
            assert (said in capsys.readouterr().err) == is_noted


BROKEN = {
    "timestamp,x,y\n1,2,3\n": "has no column z",
    "": "has no column",
    "timestamp,x,y,z\n1,2,3,abc\n": ":2: z is 'abc'",
    "timestamp,x,y,z\n1,2,3,4\n1,2,3\n": ":3: 3 values, expected 4",
    "timestamp,x,y,z\n1,2,3,4\n\n1,2,3,4,5\n": ":4: 5 values, expected 4",
    "timestamp,x,y,z,speed\n1,2,3,4\n": ":2: 4 values, expected 5",
    "timestamp,x,y,z\n1,2,3,\n": ":2: z is ''",
    "timestamp,x,y,z\n1,2,nan,4\n": ":2: y is 'nan'",
}


@pytest.mark.parametrize("text", BROKEN)
def test_a_broken_file_is_refused_by_line_and_value(text, tmp_path, fails):
    good, broken = tmp_path / "good.csv", tmp_path / "broken.csv"
    good.write_text("timestamp,x,y,z\n1,2,3,4\n")
    broken.write_text(text)
    for arguments in ((good, broken), (broken, good)):
        line = fails(4, "evaluate", *arguments)
        assert BROKEN[text] in line
        assert "broken.csv" in line


def test_absent_and_binary_files_are_input_errors(tmp_path, fails):
    good = tmp_path / "good.csv"
    good.write_text("timestamp,x,y,z\n1,2,3,4\n")
    assert "absent.csv" in fails(4, "evaluate", good, tmp_path / "absent.csv")
    (tmp_path / "noise.csv").write_bytes(bytes(range(256)))
    fails(4, "evaluate", tmp_path / "noise.csv", good)
    fails(4, "evaluate", tmp_path, good)
    fails(2, "evaluate", good)
