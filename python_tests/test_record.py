"""The record of a run: one form, whoever wrote it, for every command that reads results."""

import dataclasses
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from many import StandIn, make_data_set
from unlidar.cli import main
from unlidar.errors import InputError
from unlidar.frames_io import write_pcd
from unlidar.record import RunRecord, read_finished, read_record, write_record
from unlidar.simulate import Scenario, simulate
from unlidar.simulate.scenario import Drone, Flight, Sensor

TINY = """duration_s: 1
sensors: {mid360: {model: mid360}}
drones: [{flight: {box_m: [[6, -8, 3], [12, 8, 7]]}}]
"""


@pytest.fixture
def stand_in(tmp_path, monkeypatch) -> StandIn:
    program = StandIn(tmp_path)
    monkeypatch.setenv("UNLIDAR_TRACK", str(program.write()))
    return program


@pytest.fixture(scope="module")
def recordings(tmp_path_factory) -> Path:
    """A simulated recording and a folder of frames without truth."""
    root = tmp_path_factory.mktemp("recordings")
    box = ((-10.0, -10.0, 4.0), (10.0, 10.0, 12.0))
    flight = Scenario({"mid360": Sensor("mid360")}, (Drone(Flight(box_m=box)),), duration_s=1.0)
    simulate(flight, root / "simulated", 1)
    (root / "bare/lidar").mkdir(parents=True)
    for k in range(3):
        write_pcd(root / f"bare/lidar/1700000000.{k}.pcd", np.ones((2, 3)))
    return root


def run(*arguments: object) -> int:
    return main(["run", *map(str, arguments)])


def as_json(capsys, *arguments: object) -> dict:
    capsys.readouterr()
    assert main(["evaluate", *map(str, arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_a_record_is_read_as_it_was_written_and_moves_with_its_folder(tmp_path) -> None:
    run_dir = tmp_path / "run"
    run_dir.mkdir()
    record = RunRecord(
        title="[x] \\x1b[31m",
        recording=Path("/data/flight.bag"),
        frames={"a": run_dir / "frames/a", "b": Path("/data/b")},
        truth=run_dir / "frames/ground_truth.csv",
        options=["--set", "a.b=1"],
        preset="mmaud.yaml",
        notes=("the last block is cut short",),
        broken=True,
        messages=("one", "two"),
        tracks=3,
        tracking_s=1.25,
        total_s=2.5,
        key="abc",
    )
    write_record(run_dir, record)
    assert read_finished(run_dir) == record
    shutil.move(run_dir, tmp_path / "moved")
    moved = read_record(tmp_path / "moved")
    assert moved.truth == tmp_path / "moved/frames/ground_truth.csv"
    assert moved.frames == {"a": tmp_path / "moved/frames/a", "b": Path("/data/b")}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "cannot be read"),
        ("[1]", "list"),
        ("{}", "version is None, expected 1"),
        ('{"version": 2}', "version is 2, expected 1"),
        ('{"version": 1}', "is not what"),
        ("[" * 100_000, "cannot be read"),
    ],
)
def test_what_is_no_record_is_refused_by_name(text, said, tmp_path) -> None:
    (tmp_path / "run.json").write_text(text)
    with pytest.raises(InputError, match=said) as refused:
        read_record(tmp_path)
    assert "run.json" in str(refused.value)


def test_one_run_and_many_leave_records_of_one_form_that_every_command_reads(
    stand_in, tmp_path, capsys
) -> None:
    make_data_set(tmp_path / "data", 2)
    assert run(tmp_path / "data", "--out", tmp_path / "many") == 0
    assert run(tmp_path / "data/val/seq0001", "--out", tmp_path / "one") == 0
    folders = [tmp_path / "one", tmp_path / "many/val/seq0001"]
    one, of_many = (json.loads((folder / "run.json").read_text()) for folder in folders)
    assert list(one) == list(of_many)
    differ = {"options", "tracking_s", "total_s", "key", "title"}
    assert {k: v for k, v in one.items() if k not in differ} == {
        k: v for k, v in of_many.items() if k not in differ
    }
    for folder in folders:
        assert main(["report", str(folder)]) == 0
        assert as_json(capsys, folder)["groups"]["all"]["rmse"] == 0
    assert as_json(capsys, tmp_path / "many")["groups"]["all"]["tracks"] == 2


@pytest.mark.parametrize("command", [["report"], ["evaluate"]])
def test_results_of_a_benchmark_are_results_too(command, stand_in, tmp_path) -> None:
    (tmp_path / "tiny.yaml").write_text(TINY)
    call = ["benchmark", str(tmp_path / "tiny.yaml"), "--seeds", "1", "--methods", "robust"]
    assert main([*call, "--out", str(tmp_path / "out")]) == 0
    assert main([*command, str(tmp_path / "out/runs/tiny/1/robust")]) == 0


def test_results_of_a_simulated_recording_are_judged_by_its_truth(
    stand_in, recordings, tmp_path, capsys, fails
) -> None:
    recording = tmp_path / "simulated"
    shutil.copytree(recordings / "simulated", recording)
    assert run(recording, "--out", tmp_path / "out") == 0
    expected = json.loads((tmp_path / "out/evaluation.json").read_text())
    (judged,) = as_json(capsys, tmp_path / "out")["sequences"]
    assert judged == {"sequence": "out", "group": "", **expected}
    (recording / "ground_truth.csv").unlink()
    assert "ground_truth.csv is no longer there" in fails(4, "evaluate", tmp_path / "out")


def test_of_many_results_those_without_truth_are_left_out_and_named(
    stand_in, recordings, tmp_path, capsys, fails
) -> None:
    assert run(recordings, "--out", tmp_path / "out") == 0
    result = as_json(capsys, tmp_path / "out")
    assert [one["sequence"] for one in result["sequences"]] == ["simulated"]
    assert main(["evaluate", str(tmp_path / "out")]) == 0
    assert "bare: was run without a truth" in capsys.readouterr().err
    assert "without a truth" in fails(4, "evaluate", tmp_path / "out/bare")
    shutil.rmtree(tmp_path / "out/simulated")
    assert main(["evaluate", str(tmp_path / "out")]) == 4


def test_a_run_that_did_not_end_is_no_result(stand_in, recordings, tmp_path, fails) -> None:
    stand_in.write("sys.exit(4)")
    fails(4, "run", recordings / "simulated", "--out", tmp_path / "out")
    assert read_record(tmp_path / "out").tracks is None
    assert "did not come to its end" in fails(4, "report", tmp_path / "out")
    stand_in.write()
    assert run(recordings / "simulated", "--out", tmp_path / "out") == 0
    assert read_finished(tmp_path / "out").tracks == 1


def test_a_file_that_no_run_wrote_is_not_replaced(stand_in, recordings, tmp_path, fails) -> None:
    for name in ("summary.json", "traj.csv", "run.json"):
        out = tmp_path / name.split(".")[0]
        out.mkdir()
        (out / name).write_text("mine")
        assert name in fails(5, "run", recordings / "simulated", "--out", out)
        assert [path.name for path in out.iterdir()] == [name]
        assert (out / name).read_text() == "mine"
    (tmp_path / "other").mkdir()
    (tmp_path / "other/thesis.tex").write_text("mine")
    assert run(recordings / "simulated", "--out", tmp_path / "other") == 0
    assert (tmp_path / "other/thesis.tex").read_text() == "mine"


def test_a_record_has_no_field_that_is_not_written(tmp_path) -> None:
    write_record(tmp_path, RunRecord("", Path(), {}, None, []))
    written = json.loads((tmp_path / "run.json").read_text())
    assert set(written) == {"version", *(f.name for f in dataclasses.fields(RunRecord))}
