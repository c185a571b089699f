"""`unlidar run` on a folder of recordings, with a stand-in for the program."""

from __future__ import annotations

import csv
import json
import os
import shutil
import signal
import subprocess
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from many import StandIn, command, make_data_set, make_sequence, unfinished, wait_for
from unlidar.batch.discovery import find_recordings, is_recording
from unlidar.batch.job import Settings, make_job
from unlidar.cli import main
from unlidar.errors import InputError
from unlidar.frames_io import write_pcd


@pytest.fixture
def stand_in(tmp_path, monkeypatch) -> StandIn:
    program = StandIn(tmp_path)
    monkeypatch.setenv("UNLIDAR_TRACK", str(program.write()))
    return program


@pytest.fixture
def data(tmp_path) -> Path:
    make_data_set(tmp_path / "data", 3)
    return tmp_path / "data"


def run(data: Path, out: Path, *options: object) -> int:
    return main(["run", str(data), "--out", str(out), *(str(o) for o in options)])


def table(out: Path) -> dict[str, dict]:
    records = json.loads((out / "table.json").read_text())["sequences"]
    by_name = {record["sequence"]: record for record in records}
    assert len(by_name) == len(records)
    return by_name


def frames(folder: Path, begin_s: int) -> Path:
    folder.mkdir(parents=True)
    for k in range(3):
        write_pcd(folder / f"{begin_s + k}.500000.pcd", np.ones((2, 3)))
    return folder


def names(root: Path, results: Path | None = None) -> list[str]:
    return [found.name for found in find_recordings([root], results or root / "nowhere")]


def test_recordings_of_all_kinds_are_found_in_natural_order(tmp_path) -> None:
    make_sequence(tmp_path / "val/seq10")
    make_sequence(tmp_path / "val/seq9")
    frames(tmp_path / "field/monday/mid360", 1_700_000_000)
    frames(tmp_path / "field/monday/avia", 1_700_000_000)
    (tmp_path / "bags").mkdir()
    for name in ("noon.bag", "dusk.bag"):
        (tmp_path / "bags" / name).write_bytes(b"#ROSBAG V2.0\n")
    (tmp_path / "bags/notes.txt").write_text("x")
    expected = ["bags/dusk.bag", "bags/noon.bag", "field/monday", "val/seq9", "val/seq10"]
    assert names(tmp_path) == expected
    assert names(tmp_path / "val") == ["seq9", "seq10"]


def test_results_hidden_folders_and_circles_of_links_are_no_recordings(tmp_path) -> None:
    make_sequence(tmp_path / "val/seq1")
    make_sequence(tmp_path / ".trash/seq2")
    make_sequence(tmp_path / "out/seq3")
    earlier = frames(tmp_path / "earlier/seq1/frames/lidar_360", 1_700_000_000).parents[1]
    for name in ("traj.csv", "summary.json", "target_returns.pcd"):
        (earlier / name).write_text("")
    (tmp_path / "val/again").symlink_to(tmp_path)
    assert names(tmp_path, tmp_path / "out") == ["val/seq1"]


def test_links_to_themselves_and_pipes_are_no_recordings(tmp_path) -> None:
    frames(tmp_path / "b/lidar", 1)
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "loop.bag").symlink_to("loop.bag")
    os.mkfifo(tmp_path / "pipe.bag")
    assert names(tmp_path) == ["b"]
    assert not is_recording(tmp_path / "pipe.bag")
    assert find_recordings([tmp_path / "b", tmp_path / "loop"], tmp_path / "loop")


def test_frames_side_by_side_are_sensors_if_they_overlap_in_time_else_recordings(tmp_path) -> None:
    frames(tmp_path / "one/a", 1_700_000_000)
    frames(tmp_path / "one/b", 1_700_000_001)
    frames(tmp_path / "two/a", 1_700_000_000)
    frames(tmp_path / "two/b", 1_700_000_100)
    assert is_recording(tmp_path / "one")
    assert not is_recording(tmp_path / "two")
    assert names(tmp_path) == ["one", "two/a", "two/b"]


def test_a_folder_without_any_recording_is_an_error(tmp_path, fails) -> None:
    (tmp_path / "data/empty").mkdir(parents=True)
    with pytest.raises(InputError, match="no recording in it"):
        names(tmp_path / "data")
    assert "no recording" in fails(4, "run", tmp_path / "data")


def test_every_recording_gets_its_results_and_its_row_in_each_table(
    stand_in, data, tmp_path, capsys
) -> None:
    out = tmp_path / "out"
    assert run(data, out, "--jobs", 2) == 0
    rows = table(out)
    assert list(rows) == [f"val/seq000{k}" for k in range(1, 4)]
    for name, row in rows.items():
        assert row["status"] == "done"
        assert (row["rmse"], row["coverage"], row["within1m"], row["tracks"]) == (0, 1, 1, 1)
        assert row["time_s"] > 0
        for file in ("traj.csv", "evaluation.json", "figure.png", "run.json"):
            assert (out / name / file).is_file()
    with (out / "table.csv").open() as file:
        assert [row["sequence"] for row in csv.DictReader(file)] == list(rows)
    markdown = (out / "table.md").read_text().splitlines()
    assert len({line.count("|") for line in markdown}) == 1
    assert [line.split(" | ")[0].strip("| ") for line in markdown[2:]] == [*rows, "mean"]
    printed = capsys.readouterr().out
    for word in ("RMSE", "coverage", "false", "table.md", "mean"):
        assert word in printed
    assert sorted(stand_in.calls()) == [f"seq000{k}" for k in range(1, 4)]
    assert unfinished(out) == []


def test_what_results_say_of_their_own_files_holds_where_they_lie(stand_in, data, tmp_path) -> None:
    run(data, tmp_path / "out")
    told = json.loads((tmp_path / "out/val/seq0001/summary.json").read_text())["told"]
    assert told[:2] == ["--frames", "lidar_360=frames/lidar_360"]


def test_what_is_done_is_kept_until_something_changes(stand_in, data, tmp_path) -> None:
    out = tmp_path / "out"
    assert run(data, out) == 0
    assert len(stand_in.calls()) == 3
    assert run(data, out, "--threads", 3) == 0  # changes no result
    assert stand_in.calls() == []
    rows = table(out).values()
    assert [(row["status"], row["rmse"]) for row in rows] == [("done before", 0)] * 3
    np.save(data / "val/seq0002/lidar_360/1700000000.9.npy", np.ones((9, 3)))
    shutil.rmtree(out / "val/seq0003")
    assert run(data, out) == 0
    assert sorted(stand_in.calls()) == ["seq0002", "seq0003"]
    config = tmp_path / "station.yaml"
    config.write_text("input:\n  min_range_m: 1.0\n")
    assert run(data, out, "--config", config) == 0
    assert len(stand_in.calls()) == 3
    assert (out / "val/seq0001/config.yaml").read_text() == config.read_text()


def test_the_key_changes_with_whatever_changes_the_results(data) -> None:
    recording = data / "val/seq0001"
    settings = Settings(None, None, None, ["--set", "input.min_range_m=1"], 1, [], False, True)

    def key(settings: Settings = settings, program: str = "a") -> str:
        return make_job("name", recording, data / "out", settings, program, "").key

    keys = [
        key(),
        key(program="b"),
        key(replace(settings, sensors=["lidar_360"])),
        key(replace(settings, options=[])),
        key(replace(settings, config="")),
        key(replace(settings, config="method: paper\n")),
    ]
    frame = recording / "lidar_360/1700000000.1.npy"
    os.utime(frame, (1, 1))
    keys.append(key())
    frame.rename(frame.with_name("1700000000.15.npy"))
    keys.append(key())
    assert len(set(keys)) == len(keys)
    assert key(replace(settings, threads=7, config_file="elsewhere")) == keys[-1]


def test_a_failure_is_a_row_with_its_reason_and_does_not_stop_the_rest(
    stand_in, data, tmp_path, fails, capsys
) -> None:
    out = tmp_path / "out"
    (data / "val/seq0002/lidar_360/1700000000.1.npy").write_bytes(b"broken")
    line = fails(4, "run", data, "--out", out)
    assert "1 of 3 recordings failed" in line
    rows = table(out)
    assert [row["status"] for row in rows.values()] == ["done", "failed", "done"]
    assert "1700000000.1.npy" in rows["val/seq0002"]["remark"]
    assert "1700000000.1.npy" in (out / "table.md").read_text()
    assert not (out / "val/seq0002").exists()
    assert unfinished(out) == []
    # Mended, it is the only one that is run.
    stand_in.calls()
    make_sequence(tmp_path / "whole")
    shutil.copytree(tmp_path / "whole", data / "val/seq0002", dirs_exist_ok=True)
    assert run(data, out) == 0
    assert stand_in.calls() == ["seq0002"]


def test_results_of_other_settings_do_not_outlive_a_failure(stand_in, data, tmp_path) -> None:
    out = tmp_path / "out"
    assert run(data, out) == 0
    stand_in.write("if name == 'seq0001': sys.exit(4)")
    assert run(data, out) == 4
    assert not (out / "val/seq0001").exists()
    assert (out / "val/seq0002/run.json").exists()


def test_failures_of_different_kinds_end_with_code_1(stand_in, data, tmp_path) -> None:
    stand_in.write("if name < 'seq0003': sys.exit(int(name[-1]) + 3)")
    assert run(data, tmp_path / "out") == 1


def test_a_process_that_is_killed_takes_no_other_with_it(stand_in, data, tmp_path) -> None:
    stand_in.write("if name == 'seq0003': os.kill(os.getppid(), 9)")
    assert run(data, tmp_path / "out", "--jobs", 2) == 1
    rows = table(tmp_path / "out")
    assert [row["status"] for row in rows.values()] == ["done", "done", "failed"]
    assert "SIGKILL" in rows["val/seq0003"]["remark"]


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_run_that_is_killed_goes_on_where_it_was(stand_in, data, tmp_path, jobs) -> None:
    out = tmp_path / "out"
    slow = tmp_path / "slow"
    slow.touch()
    stand_in.write(f"if name > 'seq0001' and os.path.exists({str(slow)!r}): time.sleep(60)")
    arguments = command("run", data, "--out", out, "--jobs", jobs)
    process = subprocess.Popen(arguments, start_new_session=True)
    wait_for(lambda: stand_in.called() == 1 + jobs, "recordings that take long")
    process.kill()
    process.wait()
    # A folder of results is complete or absent, and what was running ends with its parent.
    wait_for(lambda: unfinished(out) == [], "the orphans to tidy up")
    done = sorted((out / "val").iterdir())
    assert [path.name for path in done] == ["seq0001"]
    assert all((path / "run.json").is_file() for path in done)
    stand_in.calls()
    slow.unlink()
    assert run(data, out) == 0
    assert sorted(stand_in.calls()) == ["seq0002", "seq0003"]
    assert unfinished(out) == []
    rows = table(out)
    assert [row["status"] for row in rows.values()] == ["done before", "done", "done"]
    assert all(row["rmse"] == 0 for row in rows.values())


def kill_all_at_once(process: subprocess.Popen) -> None:
    """As when the machine fails: nobody is left to tidy up. Every job has a group of its own."""
    parents = {int(path.name): path for path in Path("/proc").iterdir() if path.name.isdecimal()}
    doomed, found = [process.pid], [process.pid]
    while found:
        children = []
        for pid, path in parents.items():
            with suppress(OSError):  # has ended meanwhile
                if int((path / "stat").read_text().rsplit(")", 1)[1].split()[1]) in found:
                    children.append(pid)
        doomed, found = [*doomed, *children], children
    for pid in doomed:
        os.kill(pid, signal.SIGSTOP)
    for pid in doomed:
        os.kill(pid, signal.SIGKILL)
    process.wait()


def test_what_a_failed_machine_left_is_removed_and_nothing_of_others(
    stand_in, data, tmp_path
) -> None:
    out = tmp_path / "out"
    foreign = {
        out / where / f".{name}.{kind}-{rest}"
        for where in (".", "val", "photos/2024")
        for name in ("config", "seq0002")
        for kind, rest in (("old", "2024"), ("partial", "abcdefgh"), ("partial", "0123abcd-x"))
    }
    for folder in foreign:
        folder.mkdir(parents=True)
        (folder / "keep").write_text("x")
    slow = tmp_path / "slow"
    slow.touch()
    stand_in.write(f"if os.path.exists({str(slow)!r}): time.sleep(60)")
    for _ in range(2):
        process = subprocess.Popen(
            command("run", data, "--out", out, "--jobs", 2), stderr=subprocess.DEVNULL
        )
        wait_for(lambda: stand_in.called() == 2, "two recordings to begin")
        kill_all_at_once(process)
        stand_in.calls()
        assert len(set(unfinished(out)) - foreign) == 2
    slow.unlink()
    assert run(data, out) == 0
    assert set(unfinished(out)) <= foreign
    assert all((folder / "keep").read_text() == "x" for folder in foreign)


def test_a_forged_register_removes_nothing_elsewhere(stand_in, data, tmp_path) -> None:
    out = tmp_path / "out"
    (out / "sub").mkdir(parents=True)
    kept = [tmp_path / ".a.old-0123abcd-x", out / ".a.old-x", out / ".b.partial-*-x"]
    for folder in kept:
        folder.mkdir()
    lines = [
        {"token": "0123abcd", "results": ["../a", str(tmp_path / "a"), "sub/../../a", ""]},
        {"token": "*", "results": ["a", "b"]},
        {"token": "", "results": ["a"]},
        {"token": "0123abcd"},
        [],
    ]
    text = "".join(json.dumps(line) + "\n" for line in lines) + '{"token": "0123ab'
    (out / ".unlidar-run").write_text(text)
    assert run(data, out) == 0
    assert all(folder.is_dir() for folder in kept)


def test_tables_that_no_run_wrote_are_not_replaced(stand_in, data, tmp_path, fails) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "table.csv").write_text("mine")
    assert "table.csv" in fails(5, "run", data, "--out", out)
    assert [path.name for path in out.iterdir()] == ["table.csv"]
    assert (out / "table.csv").read_text() == "mine"


def test_what_was_put_beside_results_is_not_removed_with_them(
    stand_in, data, tmp_path, fails
) -> None:
    out = tmp_path / "out"
    assert run(data, out) == 0
    notes = out / "val/seq0001/notes.md"
    notes.write_text("x")
    assert run(data, out) == 0  # nothing is to be replaced
    stand_in.write("'another program'")
    fails(5, "run", data, "--out", out)
    assert notes.read_text() == "x"
    rows = table(out)
    assert "notes.md" in rows["val/seq0001"]["remark"]
    assert rows["val/seq0002"]["status"] == "done"


def test_an_interrupt_ends_what_runs_and_leaves_nothing_unfinished(
    stand_in, data, tmp_path
) -> None:
    out = tmp_path / "out"
    stand_in.write("time.sleep(60)")
    process = subprocess.Popen(
        command("run", data, "--out", out, "--jobs", 2), stderr=subprocess.PIPE, text=True
    )
    wait_for(lambda: stand_in.called() == 2, "two recordings to begin")
    process.terminate()
    _, said = process.communicate(timeout=30)
    assert process.returncode == 130
    assert said == "unlidar: error: interrupted\n"
    assert unfinished(out) == []
    assert stand_in.called() == 2


def test_a_second_run_on_the_same_results_is_refused(stand_in, data, tmp_path, fails) -> None:
    stand_in.write("time.sleep(60)")
    process = subprocess.Popen(
        command("run", data, "--out", tmp_path / "out"), stderr=subprocess.DEVNULL
    )
    wait_for(lambda: stand_in.called() >= 1, "a recording to begin")
    assert "another run" in fails(2, "run", data, "--out", tmp_path / "out")
    process.terminate()
    process.wait(timeout=30)


def test_nothing_but_results_is_replaced(stand_in, data, tmp_path, fails) -> None:
    (tmp_path / "out/val/seq0001").mkdir(parents=True)
    (tmp_path / "out/val/seq0001/thesis.tex").write_text("x")
    fails(5, "run", data, "--out", tmp_path / "out")
    assert "no run.json" in table(tmp_path / "out")["val/seq0001"]["remark"]
    assert (tmp_path / "out/val/seq0001/thesis.tex").read_text() == "x"
    assert "choose another" in fails(2, "run", data, "--out", data)
    inside = data / "val/seq0002/results"
    assert "seq0002" in fails(2, "run", data, "--out", inside)
    assert (data / "val/seq0002/lidar_360/1700000000.1.npy").is_file()


def test_what_would_fail_everywhere_fails_at_once(stand_in, data, tmp_path, fails) -> None:
    out = ("--out", tmp_path / "out")
    fails(3, "run", data, *out, "--config", tmp_path / "absent.yaml")
    fails(2, "run", data, *out, "--jobs", 0)
    fails(2, "run", data, *out, "--jobs", 2, "--scheduler", "tcp://127.0.0.1:1")
    fails(2, "run", data / "val/seq0001", *out, "--jobs", 2)
    stand_in.path.write_text("#!/bin/sh\necho 'unlidar_track: error: x: unknown key' >&2\nexit 3\n")
    assert "unknown key" in fails(3, "run", data, *out)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "stamp"),
    [([], "end"), (["--set", "input.stamp=middle"], "middle"), (["--config", "c.yaml"], "begin")],
)
def test_mmaud_folders_get_their_stamp_unless_told_otherwise(
    program, data, tmp_path, monkeypatch, capsys, options, stamp
) -> None:
    monkeypatch.setenv("UNLIDAR_TRACK", str(program))
    monkeypatch.chdir(tmp_path)
    Path("c.yaml").write_text("input:\n  min_range_m: 1.0\n")
    for name in ("seq0002", "seq0003"):
        shutil.rmtree(data / "val" / name)
    sequence = data / "val/seq0001"
    assert run(sequence, tmp_path / "single", *options) == 0
    assert ("mmaud.yaml" in capsys.readouterr().out) == (stamp == "end")
    assert run(data, tmp_path / "out", *options) == 0
    assert ("mmaud.yaml" in capsys.readouterr().out) == (stamp == "end")
    # Also for frames that were converted before, but not for frames of which nothing is known.
    assert run(tmp_path / "single/frames", tmp_path / "again", *options) == 0
    for folder in ("single", "out/val/seq0001", "again"):
        summary = json.loads((tmp_path / folder / "summary.json").read_text())
        assert summary["config"]["input"]["stamp"] == stamp, folder
    (tmp_path / "single/frames/conversion.json").unlink()
    assert run(tmp_path / "single/frames", tmp_path / "foreign", *options) == 0
    summary = json.loads((tmp_path / "foreign/summary.json").read_text())
    assert summary["config"]["input"]["stamp"] == {"end": "begin"}.get(stamp, stamp)


def test_on_the_real_sequence_the_end_of_a_frame_is_nearest_to_the_truth(
    program, shared, tmp_path, monkeypatch
) -> None:
    monkeypatch.setenv("UNLIDAR_TRACK", str(program))
    sequence = shared / "data/mmaud/val/seq0001"
    rmse = {}
    for stamp in ("begin", "middle", "end"):
        options = ["--sensors", "lidar_360", "--set", f"input.stamp={stamp}"]
        assert run(sequence, tmp_path / stamp, *options) == 0
        measures = json.loads((tmp_path / stamp / "evaluation.json").read_text())
        rmse[stamp] = measures["rmse_unbiased"]
    assert rmse["end"] < rmse["middle"] < rmse["begin"]
