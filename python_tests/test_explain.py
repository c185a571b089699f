"""`unlidar explain`: the first stage at which a target was lost, on traces and truth by hand."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from synthetic import BEGIN_NS as FLIGHT_NS
from synthetic import decimal_name, make_flight, seconds, truth_m, write_frames
from traced_run import BEGIN_NS, DRONE_M, FAR_M, SECOND_NS, THRESHOLD
from unlidar.cli import main
from unlidar.explain.targets import NEAR_M, NEAR_SLOPE
from unlidar.record import EXPLANATION
from unlidar.report.explanation import read_explanation
from unlidar.report.html import explanation_section


def stages(target: dict) -> list[str]:
    """Second by second."""
    return [run["stage"] for run in target["runs"] for _ in range(run["seconds"])]


@pytest.mark.parametrize(
    "mounted",
    [{}, {"translation_m": (3.0, -2.0, 1.5), "yaw_deg": 90.0, "time_offset_s": 0.25}],
    ids=["at the origin", "mounted, with a late clock"],
)
def test_each_stage_is_reported_in_the_second_in_which_the_target_is_lost_there(
    mounted, traced, explained
) -> None:
    run = traced(**mounted)
    expected = run.every_stage()
    (target,) = explained(run)
    assert stages(target) == expected
    assert [r["from_s"] - BEGIN_NS / 1e9 for r in target["runs"]] == list(range(len(expected)))
    assert target["shares"] == dict.fromkeys(expected, 1 / len(expected))
    assert "--trace" in run.told and run.told[:2] == ["--threads", "1"]


def test_seconds_of_one_stage_are_one_run_with_their_numbers_added(traced, explained) -> None:
    run = traced()
    for k in range(3):
        run.second(k, returns=True)
    run.add_truth(3)
    (target,) = explained(run)
    (one,) = target["runs"]
    assert (one["stage"], one["seconds"]) == ("structure", 3)
    assert one["evidence"]["returns"] == 2 * one["evidence"]["frames"] == 24


def test_a_path_says_by_how_much_it_is_below_the_threshold(traced, explained) -> None:
    run = traced()
    run.second(0, returns=True, detected=True, path="below_threshold", score=9.0)
    run.second(0, returns=True, detected=True, path="below_threshold", score=12.5)
    run.add_truth(1)
    (target,) = explained(run)
    (one,) = target["runs"]
    assert f"{THRESHOLD - 12.5:.1f} too little" in one["measured"]
    assert one["evidence"]["path"]["log_likelihood_ratio"] == 12.5


def test_paths_detections_and_rows_elsewhere_explain_nothing(traced, explained) -> None:
    run = traced()
    run.second(0, returns=True, detected=True, body=True, path=None, row_m=FAR_M, at_m=FAR_M)
    run.add_truth(1)
    assert stages(explained(run)[0]) == ["no return"]


def test_returns_that_the_program_drops_for_their_range_are_none(traced, explained) -> None:
    run = traced()
    for k, range_m in enumerate((0.2, 5.0, 500.0)):
        run.second(k, returns=True, at_m=(range_m, 0.0, 0.0))
        told = explained(run, f"--at={BEGIN_NS / 1e9 + k + 0.5}", f"--near={range_m},0,0")
        assert stages(told[0]) == ["structure" if k == 1 else "no return"]


def test_every_drone_of_the_truth_is_reported_by_itself(traced, explained) -> None:
    run = traced()
    run.second(0, returns=True, detected=True, path=None, row_m=DRONE_M)
    run.add_truth(1, target=3)
    run.add_truth(1, at_m=(40.0, 40.0, 9.0), target=7)
    told = {target["target"]: stages(target) for target in explained(run)}
    assert told == {"drone 3": ["found"], "drone 7": ["no return"]}


def test_seconds_out_of_view_and_in_gaps_of_the_truth_are_not_judged(traced, explained) -> None:
    run = traced()
    for k in range(6):
        run.second(k, returns=True)
    run.add_truth(6)
    begin = [int(float(row[0])) - BEGIN_NS // SECOND_NS for row in run.truth]
    run.truth = [
        (*row[:5], 0 if second == 1 else 1)
        for row, second in zip(run.truth, begin, strict=True)
        if second not in (3, 4)
    ]
    told = explained(run)[0]["runs"]
    judged = {k for r in told for k in range(int(r["from_s"]), int(r["to_s"]))}
    assert {k - BEGIN_NS // SECOND_NS for k in judged} == {0, 2, 5}


def test_a_second_in_view_without_a_frame_has_no_return(traced, explained) -> None:
    run = traced()
    run.second(0, returns=True)
    run.second(2, returns=True)
    run.add_truth(3)
    (target,) = explained(run)
    assert stages(target) == ["structure", "no return", "structure"]
    assert target["runs"][1]["measured"] == "no frame"


def test_a_place_and_an_instant_need_no_truth(traced, explained) -> None:
    run = traced()
    run.every_stage()
    run.truth = None
    at, near = f"--at={BEGIN_NS / 1e9 + 5.5}", f"--near={','.join(map(str, DRONE_M))}"
    (target,) = explained(run, at, near)
    (one,) = target["runs"]
    assert one["stage"] == "gate near_ground"
    assert one["from_s"] == BEGIN_NS / 1e9 + 5
    assert stages(explained(run, at, "--near=-20,0,5")[0]) == ["no return"]
    assert len(stages(explained(run, near)[0])) == 8


def test_an_instant_alone_is_reported_by_the_truth(traced, explained) -> None:
    run = traced()
    expected = run.every_stage()
    for k, stage in enumerate(expected):
        assert stages(explained(run, "--at", BEGIN_NS / 1e9 + k + 0.5)[0]) == [stage]


def test_a_drone_that_is_not_known_at_the_instant_is_not_reported_then(traced, explained) -> None:
    run = traced()
    for k in range(4):
        run.second(k, returns=True)
    run.add_truth(4, target=1)
    run.add_truth(1, target=2)
    told = explained(run, "--at", BEGIN_NS / 1e9 + 3.5)
    assert [stages(target) for target in told] == [["structure"], []]


def test_the_radius_says_what_is_near(traced, explained) -> None:
    run = traced()
    x, y, z = DRONE_M
    away_m = NEAR_M + NEAR_SLOPE * float(np.linalg.norm(DRONE_M))
    run.second(0, returns=True, at_m=(x, y, z + away_m - 0.1))
    run.second(1, returns=True, at_m=(x, y, z + away_m + 0.1))
    run.add_truth(2)
    assert stages(explained(run)[0]) == ["structure", "no return"]
    assert stages(explained(run, "--radius", away_m + 0.2)[0]) == ["structure", "structure"]
    assert stages(explained(run, "--radius", 0.5)[0]) == ["no return", "no return"]


def test_the_table_has_every_run_what_it_means_and_the_shares(traced, capsys) -> None:
    run = traced()
    expected = run.every_stage()
    assert main(["explain", str(run.write())]) == 0
    printed = capsys.readouterr().out
    for stage in expected:
        assert re.search(rf"^ \d+ +\d+ +1 +{stage} ", printed, re.MULTILINE), stage
        assert re.search(rf"^{stage}: .*See .*docs/", printed, re.MULTILINE), stage
        assert f"{stage} 12.5 %" in printed.splitlines()[-1]


def test_the_page_has_the_table_after_explaining(traced) -> None:
    run = traced()
    expected = run.every_stage()
    folder = run.write()
    assert read_explanation(folder) == []
    assert main(["explain", str(folder), f"--at={BEGIN_NS / 1e9}"]) == 0
    assert read_explanation(folder) == []
    assert main(["explain", str(folder)]) == 0
    section = explanation_section(read_explanation(folder), BEGIN_NS / 1e9)
    for k, stage in enumerate(expected):
        assert f"<td>{k}.0</td><td>{k + 1}.0</td><td>1</td><td>{stage}</td>" in section


# --- with the program ---------------------------------------------------------------------------


@pytest.fixture(scope="module")
def flown(program, tmp_path_factory) -> Path:
    """A run of the program on a made-up flight with truth."""
    shown = subprocess.run([program, "--help"], capture_output=True, text=True, check=True).stdout
    if "--trace" not in shown:
        pytest.skip(f"{program} has no --trace")
    root = tmp_path_factory.mktemp("flown")
    flight = make_flight(frames=80)
    write_frames(root / "flight/lidar", flight, decimal_name)
    times_ns = [FLIGHT_NS + k * SECOND_NS // 20 for k in range(160)]
    rows = zip(times_ns, truth_m([t * 1e-9 for t in times_ns]), strict=True)
    (root / "flight/ground_truth.csv").write_text(
        "timestamp,x,y,z\n"
        + "".join(f"{seconds(t)},{','.join(map(str, place))}\n" for t, place in rows)
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("UNLIDAR_TRACK", str(program))
        out = str(root / "out")
        assert main(["run", str(root / "flight"), "--out", out, "--no-report"]) == 0
    return root / "out"


def test_the_program_explains_a_flight_a_wall_and_the_empty_sky(
    flown, program, monkeypatch, explained
) -> None:
    monkeypatch.setenv("UNLIDAR_TRACK", str(program))
    (target,) = explained(flown)
    assert target["shares"].get("found", 0) > 0.9
    assert stages(explained(flown, "--near=20,0,1", "--radius=0.5")[0]).count("structure") >= 8
    assert set(stages(explained(flown, "--near=0,0,40")[0])) == {"no return"}


def test_a_target_that_a_gate_refuses_is_reported_with_its_name_until_the_next_run(
    flown, program, monkeypatch, explained, tmp_path
) -> None:
    monkeypatch.setenv("UNLIDAR_TRACK", str(program))
    out = str(tmp_path / "out")
    refuse = ["--set", "robust.min_plots=1000"]
    assert main(["run", str(flown.parent / "flight"), "--out", out, "--no-report", *refuse]) == 0
    (target,) = explained(Path(out))
    assert target["shares"].get("gate too_few_detections", 0) > 0.8
    assert (Path(out) / EXPLANATION).is_file()
    assert main(["run", str(flown.parent / "flight"), "--out", out, "--no-report"]) == 0
    assert not (Path(out) / EXPLANATION).exists()  # it was about the run before
