"""TUM files as truth and as trajectories; the format is told by content, not by name."""

import json
from pathlib import Path

import numpy as np
import pytest
from flights import join_tracks, track_at, truth_at, write_result
from synthetic import BEGIN_NS, make_flight, track, truth_m, with_opposite_drone, write_frames
from unlidar.cli import main
from unlidar.evaluation import evaluate_files
from unlidar.truth import is_tum, read_all_tracks, read_tracks, read_truth

TIMES = np.arange(0, 6, 0.1)
LEFT_OUT = [  # need sigmas, which TUM has not
    f"nees{about}{kind}" for about in ("", "_unbiased") for kind in ("", "_median", "_within95")
]


@pytest.fixture
def result(tmp_path) -> Path:
    """Two tracks, one of them twice as long, with the truth of the first."""
    both = join_tracks(track_at(TIMES, [0.3, 0, 0]), track_at(TIMES[:30], [9.0, 0, 0], 4.0))
    return write_result(tmp_path / "run", truth_at(TIMES), both)


def as_tum(folder: Path) -> list[Path]:
    """The tracks of a result, a file each, by `unlidar export`."""
    assert main(["export", str(folder / "traj.csv"), str(folder / "t.tum")]) == 0
    return [folder / "t.tum", folder / "t_track4.tum"]


def same_but_sigmas(one: dict, other: dict) -> bool:
    return {k: v for k, v in one.items() if k not in LEFT_OUT} == {
        k: v for k, v in other.items() if k not in LEFT_OUT
    }


def test_tum_files_give_the_measures_of_the_csv_they_come_from(result) -> None:
    truth = result / "ground_truth.csv"
    assert same_but_sigmas(
        evaluate_files(truth, as_tum(result)), evaluate_files(truth, result / "traj.csv")
    )


def test_what_a_comment_of_a_tum_file_says_does_not_matter(result) -> None:
    path, *_ = as_tum(result)
    told = result / "told.tum"
    told.write_text('# poses of,"drone, track_id\n' + path.read_text())
    truth = result / "ground_truth.csv"
    assert evaluate_files(truth, [told]) == evaluate_files(truth, [path])


def test_a_truth_may_be_tum_whatever_its_name(result) -> None:
    truth = result / "ground_truth.csv"
    rows = [line.split(",") for line in truth.read_text().splitlines()[1:]]
    lines = [f"{t}\t{x}  {y} {z} 0 0 0 1" for t, _, x, y, z, _ in rows]
    as_text = result / "truth.csv"
    as_text.write_text("# a comment, with commas\n\n" + "\n".join(lines) + "\n# the end\n")
    assert is_tum(as_text)
    assert evaluate_files(as_text, result / "traj.csv") == evaluate_files(
        truth, result / "traj.csv"
    )


def test_tracks_of_several_files_keep_numbers_of_their_own(result) -> None:
    tracks = read_all_tracks([*as_tum(result), result / "traj.csv"])
    sizes = [int((tracks.track_id == k).sum()) for k in np.unique(tracks.track_id)]
    assert sizes == [60, 30, 60, 30]
    assert tracks.sigma_m is None
    assert tracks.stamp_ns.dtype == np.int64
    alone = read_tracks(result / "traj.csv")
    assert np.array_equal(read_all_tracks([result / "traj.csv"]).track_id, alone.track_id)


def test_a_track_that_was_not_named_is_reported(result, capsys) -> None:
    best, other = as_tum(result)
    assert main(["evaluate", str(result / "ground_truth.csv"), str(best), "--json"]) == 0
    said = capsys.readouterr()
    assert "t_track4.tum" in said.err
    assert json.loads(said.out.splitlines()[-1])["tracks"] == 1
    assert main(["evaluate", str(result / "ground_truth.csv"), str(best), str(other)]) == 0
    said = capsys.readouterr()
    assert said.err == ""
    assert "t_track4.tum" in said.out.replace("\n", "")  # a long path takes two lines


def test_what_the_program_writes_as_tum_is_judged_as_its_csv(program, tmp_path) -> None:
    two_drones = write_frames(tmp_path / "frames", with_opposite_drone(make_flight()))
    track(two_drones, tmp_path / "t.csv")
    track(two_drones, tmp_path / "t.tum", "--format", "tum")
    time_s = np.arange(0, 6, 0.05) + BEGIN_NS * 1e-9
    rows = [
        f"{t:.9f},{','.join(map(str, xyz))}" for t, xyz in zip(time_s, truth_m(time_s), strict=True)
    ]
    (tmp_path / "truth.csv").write_text("timestamp,x,y,z\n" + "\n".join(rows))
    files = sorted(tmp_path.glob("*.tum"), key=lambda path: len(path.name))
    assert len(files) == 2
    assert same_but_sigmas(
        evaluate_files(tmp_path / "truth.csv", files),
        evaluate_files(tmp_path / "truth.csv", tmp_path / "t.csv"),
    )


def test_a_file_without_a_track_is_none(tmp_path) -> None:
    (tmp_path / "t.tum").write_text("# timestamp tx ty tz qx qy qz qw\n")
    assert len(read_tracks(tmp_path / "t.tum")) == 0
    assert len(read_truth(tmp_path / "t.tum")) == 0


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1 2 3 4 0 0 0 1\n1 2 3 4 0 0 0\n", ":2: 7 values, expected timestamp tx"),
        ("#\n1 2 x 4 0 0 0 1\n", ":2: y is 'x'"),
        ("1 2 nan 4 0 0 0 1\n", ":1: y is 'nan'"),
        ("1e300 2 3 4 0 0 0 1\n", ":1: timestamp is '1e300'"),
        ("1 2 3 4 5 6 7\n", "has no column timestamp"),
    ],
)
def test_a_broken_tum_file_is_refused_by_line_and_value(text, said, tmp_path, fails) -> None:
    (tmp_path / "t.tum").write_text(text)
    (tmp_path / "good.csv").write_text("timestamp,x,y,z\n1,2,3,4\n")
    assert said in fails(4, "evaluate", tmp_path / "good.csv", tmp_path / "t.tum")
    assert said in fails(4, "evaluate", tmp_path / "t.tum", tmp_path / "good.csv")
