"""`unlidar run` with a stand-in for the program: how it is called and what is made of its files."""

import html
import json
import shlex
import stat
import sys
from pathlib import Path

import numpy as np
import pytest
import unlidar
from unlidar.cli import main
from unlidar.frames_io import find_sensors, write_pcd
from unlidar.simulate import Scenario, simulate
from unlidar.simulate.scenario import Drone, Flight, Sensor

STUB = '''"""Reports the truth beside the first sensor as its one track, and what it was told."""
import csv, json, pathlib, sys
words = sys.argv[1:]
def values(option):
    return [words[i + 1] for i, word in enumerate(words) if word == option]
# The program is asked once for its opinion of the options, with frames that do not exist.
if values("--frames")[0].endswith("/absent"): sys.exit(4)
{behaviour}
first = pathlib.Path(values("--frames")[0].split("=", 1)[1])
truth = first.parent / "ground_truth.csv"
rows = list(csv.DictReader(truth.open())) if truth.is_file() else []
with open(values("--out")[0], "w") as file:
    print("timestamp,track_id,x,y,z,vx,vy,vz,sigma_x,sigma_y,sigma_z,support", file=file)
    for r in rows:
        print(r["timestamp"], 1, r["x"], r["y"], r["z"], "0,0,0,1,1,1,2", sep=",", file=file)
json.dump({{"told": words}}, open(values("--summary")[0], "w"))
pathlib.Path(values("--clusters")[0]).write_text("id,rank,size\\n7,1,12\\n")
head = b"VERSION 0.7\\nFIELDS x y z\\nSIZE 4 4 4\\nTYPE F F F\\nCOUNT 1 1 1\\nWIDTH 0\\nHEIGHT 1\\n"
pathlib.Path(values("--points")[0]).write_bytes(head + b"POINTS 0\\nDATA binary\\n")
'''


@pytest.fixture
def stub(tmp_path, monkeypatch):
    """Makes a stand-in program that first runs the given line of Python."""

    def make(behaviour: str = "") -> Path:
        script = tmp_path / "stub_program.py"
        script.write_text(STUB.format(behaviour=behaviour))
        # Through a shell: a shebang cannot name an interpreter with a blank in its path.
        path = tmp_path / "stub_program"
        command = shlex.join([sys.executable, str(script)])
        path.write_text(f'#!/bin/sh\nexec {command} "$@"\n')
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
        monkeypatch.setenv("UNLIDAR_TRACK", str(path))
        return path

    return make


@pytest.fixture(scope="module")
def flight(tmp_path_factory) -> Path:
    """A short simulated recording."""
    sensors = {"mid360": Sensor("mid360"), "avia": Sensor("avia")}
    box = ((-10.0, -10.0, 4.0), (10.0, 10.0, 12.0))
    scenario = Scenario(sensors, (Drone(Flight(box_m=box)),), duration_s=1.0)
    out = tmp_path_factory.mktemp("recordings") / "flight"
    simulate(scenario, out, 1)
    return out


def make_sequence(root: Path) -> Path:
    for name in ("lidar_360", "radar_enhance_pcl", "ground_truth"):
        (root / name).mkdir(parents=True)
    for k in range(1, 6):
        np.save(root / "lidar_360" / f"1700000000.{k}.npy", np.full((4, 3), 1.0 + k))
        np.save(root / "radar_enhance_pcl" / f"1700000000.{k}.npy", np.full((4, 3), 1.0 + k))
        np.save(root / "ground_truth" / f"1700000000.{k}.npy", np.full(3, 2.0))
    return root


def told(out: Path) -> list[str]:
    return json.loads((out / "summary.json").read_text())["told"]


def test_a_simulated_flight_is_tracked_evaluated_and_drawn(stub, flight, tmp_path, capsys):
    stub()
    assert main(["run", str(flight), "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    for word in ("RMSE", "coverage", "100.0 %", "within 1 m", "figure.png", "traj.csv"):
        assert word in printed
    measures = json.loads((tmp_path / "out/evaluation.json").read_text())
    assert measures["rmse"] == 0.0
    assert measures["within1m"] == 1.0
    assert (tmp_path / "out/figure.png").read_bytes().startswith(b"\x89PNG")
    frames = [f"{name}={flight / name}" for name in ("avia", "mid360")]
    assert [w for w in told(tmp_path / "out") if "=" in w] == frames


def test_sensors_are_chosen_in_the_order_given(stub, flight, tmp_path):
    stub()
    arguments = ["run", str(flight), "--out", str(tmp_path / "out"), "--sensors"]
    assert main([*arguments, "mid360,avia"]) == 0
    assert told(tmp_path / "out")[1] == f"mid360={flight / 'mid360'}"
    assert main([*arguments, "avia"]) == 0
    assert told(tmp_path / "out").count("--frames") == 1


def test_options_reach_the_program(stub, flight, tmp_path):
    stub()
    options = ["--method", "paper", "--set", "paper.lambda=2", "--threads", "3"]
    (tmp_path / "c.yaml").write_text("")
    options += ["--config", str(tmp_path / "c.yaml")]
    assert main(["run", str(flight), "--out", str(tmp_path / "out"), *options]) == 0
    line = shlex.join(told(tmp_path / "out"))
    assert "--set method=paper --set paper.lambda=2" in line
    assert "--threads 3" in line
    assert f"--config {tmp_path / 'c.yaml'}" in line


def test_place_and_clock_of_simulated_sensors_are_told_to_the_program(stub, tmp_path):
    stub()
    moved = Sensor("mid360", position_m=(3.0, -2.0, 1.0), time_offset_s=0.25)
    simulate(Scenario({"m": moved, "n": Sensor("avia")}, duration_s=0.2), tmp_path / "seq", 1)
    assert main(["run", str(tmp_path / "seq"), "--out", str(tmp_path / "out")]) == 0
    assert "sensors.m.translation_m=[3.0, -2.0, 1.0]" in told(tmp_path / "out")
    assert "sensors.m.time_offset_s=0.25" in told(tmp_path / "out")


def test_a_sequence_of_the_data_set_is_converted_on_the_way(stub, tmp_path, capsys):
    stub()
    source = make_sequence(tmp_path / "seq")
    for _ in range(2):  # a second run replaces the frames of the first
        assert main(["run", str(source), "--out", str(tmp_path / "out")]) == 0
    assert len(list((tmp_path / "out/frames/lidar_360").iterdir())) == 5
    assert "RMSE" in capsys.readouterr().out
    assert told(tmp_path / "out")[1] == f"lidar_360={tmp_path / 'out/frames/lidar_360'}"
    arguments = ["run", str(source), "--out", str(tmp_path / "out"), "--sensors"]
    assert main([*arguments, "radar_enhance_pcl"]) == 0


def test_without_truth_it_tracks_and_says_that_nothing_was_evaluated(
    stub, flight, tmp_path, capsys
):
    stub()
    for frame in (flight / "mid360").iterdir():
        (tmp_path / "bare").mkdir(exist_ok=True)
        (tmp_path / "bare" / frame.name).write_bytes(frame.read_bytes())
    assert main(["run", str(tmp_path / "bare"), "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    assert "not evaluated" in printed
    assert "RMSE" not in printed
    assert told(tmp_path / "out")[1] == f"bare={tmp_path / 'bare'}"
    assert not (tmp_path / "out/evaluation.json").exists()


def test_measures_of_an_earlier_run_do_not_outlive_it(stub, flight, tmp_path):
    stub()
    assert main(["run", str(flight), "--out", str(tmp_path / "out")]) == 0
    bare = tmp_path / "bare"
    bare.mkdir()
    for frame in (flight / "avia").iterdir():
        (bare / frame.name).write_bytes(frame.read_bytes())
    assert main(["run", str(bare), "--out", str(tmp_path / "out")]) == 0
    assert not (tmp_path / "out/evaluation.json").exists()


def test_what_the_program_says_is_passed_on(stub, flight, tmp_path, capsys):
    stub("print('unlidar_track: no drone found', file=sys.stderr)")
    assert main(["run", str(flight), "--out", str(tmp_path / "out")]) == 0
    assert "no drone found" in capsys.readouterr().err


@pytest.mark.parametrize("code", [1, 2, 3, 4, 5])
def test_a_failure_of_the_program_is_one_line_with_its_reason_and_its_code(
    code, stub, flight, tmp_path, fails
):
    stub(f"sys.exit(print('unlidar_track: error: a.pcd: bad', file=sys.stderr) or {code})")
    line = fails(code, "run", flight, "--out", tmp_path / "out")
    assert "a.pcd: bad" in line


def test_a_program_that_dies_or_writes_nothing_is_an_error(stub, flight, tmp_path, fails):
    stub("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)")
    assert "signal 11" in fails(1, "run", flight, "--out", tmp_path / "out")
    stub("sys.exit(0)")
    assert "traj.csv" in fails(1, "run", flight, "--out", tmp_path / "fresh")


def test_results_of_an_earlier_run_are_not_taken_for_new_ones(stub, flight, tmp_path, fails):
    stub()
    assert main(["run", str(flight), "--out", str(tmp_path / "out")]) == 0
    stub("sys.exit(0)")
    fails(1, "run", flight, "--out", tmp_path / "out")


def test_an_absent_program_is_reported_with_where_it_was_looked_for(
    flight, tmp_path, fails, monkeypatch
):
    monkeypatch.setenv("UNLIDAR_TRACK", str(tmp_path / "nowhere"))
    assert "nowhere" in fails(2, "run", flight, "--out", tmp_path / "out")


def test_what_the_program_refuses_is_reported_before_the_conversion(
    program, tmp_path, fails, monkeypatch
):
    source = make_sequence(tmp_path / "seq")
    out = tmp_path / "out"
    monkeypatch.setenv("UNLIDAR_TRACK", str(program))
    assert "unknown key" in fails(3, "run", source, "--out", out, "--set", "robust.nothing=1")
    assert "--threads" in fails(2, "run", source, "--out", out, "--threads", "100000")
    (tmp_path / "c.yaml").write_text("input:\n  nothing: 1\n")
    assert "c.yaml" in fails(3, "run", source, "--out", out, "--config", tmp_path / "c.yaml")
    assert "d.yaml" in fails(3, "run", source, "--out", out, "--config", tmp_path / "d.yaml")
    monkeypatch.setenv("UNLIDAR_TRACK", str(tmp_path / "nowhere"))
    fails(2, "run", source, "--out", out)
    assert not out.exists()


@pytest.mark.parametrize("name", ["a$x^$", "s\udcff", "[b]<b>_"])
def test_a_recording_of_any_name_has_figure_and_page(name, stub, tmp_path):
    stub()
    source = make_sequence(tmp_path / name)
    assert main(["run", str(source), "--out", str(tmp_path / "out")]) == 0
    assert (tmp_path / "out/figure.png").is_file()
    page = (tmp_path / "out/report.html").read_text(encoding="utf-8")
    shown = html.escape(name).replace("\udcff", r"\udcff")
    assert f"<h1>{shown}</h1>" in page


def test_results_do_not_go_among_the_frames_of_their_recording(stub, tmp_path, fails):
    stub()
    source = make_sequence(tmp_path / "seq")
    before = sorted(source.rglob("*"))
    for out in (source, source / "lidar_360"):
        assert "has files of the recording" in fails(2, "run", source, "--out", out)
        with pytest.raises(unlidar.UsageError, match="choose another folder for the results"):
            unlidar.run(source, out)
    assert sorted(source.rglob("*")) == before
    for _ in range(2):
        assert main(["run", str(source), "--out", str(source / "results")]) == 0


def test_results_beside_the_frames_are_no_frames(tmp_path):
    for name in ("lidar/1700000000", "results/target_returns"):
        (tmp_path / "seq" / name).parent.mkdir(parents=True)
        write_pcd(tmp_path / f"seq/{name}.pcd", np.ones((9, 3)))
    assert list(find_sensors(tmp_path / "seq")) == ["lidar", "results"]
    (tmp_path / "seq/results/run.json").write_text("{}")
    assert list(find_sensors(tmp_path / "seq")) == ["lidar"]
    assert [frame.sensor for frame in unlidar.read(tmp_path / "seq")] == ["lidar"]


def test_wrong_recordings_and_sensors_are_refused(stub, flight, tmp_path, fails):
    stub()
    out = ("--out", tmp_path / "out")
    fails(4, "run", tmp_path / "absent", *out)
    assert "avia" in fails(2, "run", flight, *out, "--sensors", "radar")
    source = make_sequence(tmp_path / "seq")
    assert "lidar_360" in fails(2, "run", source, *out, "--sensors", "radar")
    (tmp_path / "text").write_text("x")
    fails(4, "run", tmp_path / "text", *out)
    fails(5, "run", flight, "--out", tmp_path / "text")


def test_the_real_program_follows_a_simulated_drone(program, flight, tmp_path, monkeypatch):
    monkeypatch.setenv("UNLIDAR_TRACK", str(program))
    assert main(["simulate", "demo", str(tmp_path / "demo")]) == 0
    assert main(["run", str(tmp_path / "demo"), "--out", str(tmp_path / "out")]) == 0
    measures = json.loads((tmp_path / "out/evaluation.json").read_text())
    assert measures["tracks"] == 1
    assert measures["within1m"] > 0.9
    assert measures["rmse"] < 0.5


def test_the_real_program_merges_sensors_at_other_places_and_clocks(program, tmp_path, monkeypatch):
    monkeypatch.setenv("UNLIDAR_TRACK", str(program))
    sensors = {
        "m": Sensor("mid360", position_m=(3.0, -2.0, 1.0), time_offset_s=-0.25),
        "n": Sensor("avia", position_m=(-2.0, 1.0, 0.0)),
    }
    waypoints = ((0.0, -3.0, 2.0, 8.0), (3.0, 2.0, 3.0, 9.0), (6.0, 3.0, -3.0, 9.0))
    flight = Scenario(sensors, (Drone(Flight(waypoints=waypoints)),), duration_s=6.0)
    simulate(flight, tmp_path / "seq", 1)
    assert main(["run", str(tmp_path / "seq"), "--out", str(tmp_path / "out")]) == 0
    measures = json.loads((tmp_path / "out/evaluation.json").read_text())
    assert measures["within1m"] > 0.9
    assert measures["rmse"] < 0.5


def test_the_real_program_finds_nothing_in_an_empty_sky(program, tmp_path, monkeypatch):
    monkeypatch.setenv("UNLIDAR_TRACK", str(program))
    assert main(["simulate", "empty_sky", str(tmp_path / "sky")]) == 0
    assert main(["run", str(tmp_path / "sky"), "--out", str(tmp_path / "out")]) == 0
    assert json.loads((tmp_path / "out/evaluation.json").read_text())["tracks"] == 0


def test_the_real_drone_is_one_track_for_one_lidar(shared, program, tmp_path, monkeypatch):
    """A second path beside the drone has no returns left."""
    monkeypatch.setenv("UNLIDAR_TRACK", str(program))
    recording = shared / "data/mmaud/val/seq0001"
    assert main(["run", str(recording), "--sensors", "lidar_360", "--out", str(tmp_path)]) == 0
    (track,) = json.loads((tmp_path / "summary.json").read_text())["tracks"]
    assert track["rows"] == 88
