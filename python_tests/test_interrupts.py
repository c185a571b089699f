"""The end of `unlidar` on an interrupt, and on a closed stdout."""

from __future__ import annotations

import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from many import StandIn, command, make_sequence, unfinished, wait_for
from unlidar.output import RUN_RECORD, complete_directory

# Interrupts the process at the n-th import of a module after the package's own entry.
AT_IMPORT = """
import os, signal, sys
n = int(sys.argv.pop(1))
class Watch:
    count = 0
    def find_spec(self, name, *_):
        Watch.count += 1
        if Watch.count == n:
            os.kill(os.getpid(), signal.{signal})
from unlidar.__main__ import main
sys.meta_path.insert(0, Watch())
exit_code = main()
if Watch.count < n: print("all", Watch.count)
sys.exit(exit_code)
"""
SAID = "unlidar: error: interrupted\n"
BUFFERED = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}


def interrupted_at(number: int, name: str, *arguments: object) -> subprocess.CompletedProcess:
    script = AT_IMPORT.format(signal=name)
    return subprocess.run(
        [sys.executable, "-c", script, str(number), *map(str, arguments)],
        capture_output=True,
        text=True,
    )


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_an_interrupt_at_any_import_is_one_line_and_code_130(name, tmp_path) -> None:
    truth = tmp_path / "truth.csv"
    truth.write_text("timestamp,x,y,z\n1,2,3,4\n2,2,3,4\n")
    arguments = ("evaluate", truth, truth)
    whole = interrupted_at(10**6, name, *arguments)
    assert whole.returncode == 0, whole.stderr
    total = int(whole.stdout.split()[-1])
    assert total > 100
    for number in (1, 2, 3, *range(10, total, total // 12)):
        done = interrupted_at(number, name, *arguments)
        assert (done.returncode, done.stderr) == (130, SAID), number


@pytest.mark.parametrize("wait_s", [0.1, 0.15, 0.2, 0.3, 0.4])
def test_ctrl_c_soon_after_the_start_prints_no_traceback(wait_s, tmp_path) -> None:
    process = subprocess.Popen(
        command("simulate", "demo", tmp_path / "out"), stderr=subprocess.PIPE, text=True
    )
    time.sleep(wait_s)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=120)
    # Before Python itself has begun it is the signal that ends the process, and until the package
    # is in charge, on a busy machine, Python that says so.
    is_of_python = "KeyboardInterrupt" in said and "/unlidar/cli/" not in said
    assert is_of_python or (process.returncode, said) in ((130, SAID), (-signal.SIGINT, "")), said
    assert unfinished(tmp_path) == []


@pytest.mark.parametrize("call", ["mkdir", "rename"])
def test_an_interrupt_in_the_midst_of_a_change_leaves_what_was_there(
    call, tmp_path, monkeypatch
) -> None:
    """Python tells of a signal when the system's call is done."""
    out = tmp_path / "out"
    out.mkdir()
    (out / RUN_RECORD).write_text("before")
    done = 0

    def change_and_interrupt(*arguments, **keywords) -> None:
        nonlocal done
        change(*arguments, **keywords)
        done += 1
        if done == interrupted:
            raise KeyboardInterrupt

    change = getattr(os, call)
    monkeypatch.setattr(os, call, change_and_interrupt)
    for interrupted in (1, 2):
        done = 0
        with pytest.raises(KeyboardInterrupt), complete_directory(out, force=True) as work:
            (work / RUN_RECORD).write_text("after")
        assert list(tmp_path.iterdir()) == [out]
        # What has its place before the interrupt keeps it.
        expected = "after" if (call, interrupted) == ("rename", 2) else "before"
        assert (out / RUN_RECORD).read_text() == expected


def test_a_process_started_after_the_interrupt_can_be_ended() -> None:
    """As a thread does that was about to start it."""
    script = """
import os, signal, subprocess, sys
from unlidar.interrupts import guarded
code = guarded(lambda: os.kill(os.getpid(), signal.SIGTERM))
child = subprocess.Popen(["sleep", "60"])
child.terminate()
print(code, child.wait())
"""
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=30
    )
    assert (done.stdout, done.stderr) == (f"130 {-signal.SIGTERM}\n", SAID)


def press_ctrl_c(process: subprocess.Popen) -> tuple[int, str]:
    """As a terminal does it: the signal goes to the whole group."""
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=120)
    return process.returncode, said


def started(*arguments: object) -> subprocess.Popen:
    return subprocess.Popen(
        command(*arguments), stderr=subprocess.PIPE, text=True, start_new_session=True
    )


def children_of(pid: int) -> int:
    """Processes of the session that `pid` leads, itself included."""
    found = 0
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            found += int(path.read_text().rsplit(")", 1)[1].split()[3]) == pid
        except OSError:
            continue
    return found


def test_ctrl_c_while_the_program_runs_ends_it_with_one_line(tmp_path, monkeypatch) -> None:
    stand_in = StandIn(tmp_path)
    monkeypatch.setenv("UNLIDAR_TRACK", str(stand_in.write("time.sleep(60)")))
    process = started("run", make_sequence(tmp_path / "seq"), "--out", tmp_path / "out")
    wait_for(lambda: stand_in.called() == 1, "the program to begin")
    assert press_ctrl_c(process) == (130, SAID)
    wait_for(lambda: children_of(process.pid) == 0, "the program to end")


@pytest.mark.parametrize("wait_s", [0.2, 1.0, 3.0])
def test_ctrl_c_in_a_benchmark_ends_all_its_processes_with_one_line(
    wait_s, tmp_path, monkeypatch
) -> None:
    stand_in = StandIn(tmp_path)
    monkeypatch.setenv("UNLIDAR_TRACK", str(stand_in.write("time.sleep(60)")))
    monkeypatch.setenv("TMPDIR", str(tmp_path / "tmp"))
    (tmp_path / "tmp").mkdir()
    scenario = tmp_path / "tiny.yaml"
    scenario.write_text("duration_s: 1\nsensors: {mid360: {model: mid360}}\n")
    process = started(
        "benchmark", scenario, "--seeds", "1-4", "--jobs", "2", "--out", tmp_path / "out"
    )
    time.sleep(wait_s)
    assert press_ctrl_c(process) == (130, SAID)
    wait_for(lambda: children_of(process.pid) == 0, "its processes to end")
    assert list((tmp_path / "tmp").iterdir()) == []


def shell(line: str, unbuffered: bool) -> subprocess.CompletedProcess:
    environment = BUFFERED | ({"PYTHONUNBUFFERED": "1"} if unbuffered else {})
    line = line.replace("unlidar", f"{shlex.quote(sys.executable)} -m unlidar", 1)
    return subprocess.run(["bash", "-c", line], capture_output=True, text=True, env=environment)


@pytest.mark.parametrize("unbuffered", [False, True])
@pytest.mark.parametrize("option", ["", "--help", "--version", "run --help"])
def test_a_closed_pipe_ends_quietly(option, unbuffered) -> None:
    done = shell(f"unlidar {option} | true; exit ${{PIPESTATUS[0]}}", unbuffered)
    assert (done.returncode, done.stderr) == (5, "")


def test_a_full_disk_is_one_line(tmp_path) -> None:
    done = shell("unlidar --help >/dev/full", False)
    assert done.returncode == 5
    assert done.stderr == "unlidar: error: stdout: cannot be written: No space left on device\n"


def test_unlidar_alone_prints_its_help() -> None:
    alone, asked = (shell(f"unlidar {option}", False) for option in ("", "--help"))
    assert alone.returncode == 0
    assert alone.stdout == asked.stdout != ""
    assert alone.stderr == ""
