"""`unlidar run --scheduler` on a real Dask cluster: a scheduler and two workers, all processes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from many import StandIn, command, make_data_set, unfinished, wait_for

pytest.importorskip("distributed", reason="the extra [cluster] is not installed")


@contextmanager
def processes() -> Iterator[list[subprocess.Popen]]:
    """Ends what is put into the list."""
    started: list[subprocess.Popen] = []
    try:
        yield started
    finally:
        for process in started:
            process.kill()
            process.wait()


def start(module: str, *arguments: str) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, "-m", f"distributed.cli.{module}", "--no-dashboard", *arguments],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def start_scheduler(folder: Path) -> tuple[subprocess.Popen, str]:
    file = folder / "scheduler.json"
    process = start(
        "dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", file
    )
    wait_for(lambda: file.exists() and file.read_text().endswith("}"), "the scheduler")
    return process, json.loads(file.read_text())["address"]


def start_worker(address: str) -> subprocess.Popen:
    return start("dask_worker", address, "--no-nanny", "--nthreads", "1")


def test_when_one_of_two_workers_is_killed_all_sequences_are_done_and_none_twice(
    tmp_path, monkeypatch
) -> None:
    names = make_data_set(tmp_path / "data", 4)
    stand_in = StandIn(tmp_path)
    pids = tmp_path / "pids"
    slow = tmp_path / "slow"
    pids.mkdir()
    # The parent of the program is the job's process, and that one's parent the worker.
    stand_in.write(
        "job = pathlib.Path(f'/proc/{os.getppid()}/stat').read_text()\n"
        f"pathlib.Path({str(pids)!r}, name).write_text(job.rsplit(')', 1)[1].split()[1])\n"
        f"while os.path.exists({str(slow)!r}): time.sleep(0.05)"
    )
    monkeypatch.setenv("UNLIDAR_TRACK", str(stand_in.path))
    slow.touch()
    out = tmp_path / "out"
    with processes() as started:
        scheduler, address = start_scheduler(tmp_path)
        workers = [start_worker(address) for _ in range(2)]
        started += [scheduler, *workers]
        run = subprocess.Popen(
            command("run", tmp_path / "data", "--out", out, "--scheduler", address),
            stderr=subprocess.PIPE,
            text=True,
        )
        started.append(run)
        wait_for(
            lambda: [p.stat().st_size > 0 for p in pids.iterdir()] == [True, True],
            "both workers to be busy",
        )
        busy = {int(path.read_text()) for path in pids.iterdir()}
        assert busy == {worker.pid for worker in workers}
        workers[0].kill()
        wait_for(lambda: len(unfinished(out)) == 1, "the job of the killed worker to end")
        slow.unlink()
        _, said = run.communicate(timeout=120)
        assert run.returncode == 0, said
    calls = stand_in.calls()
    assert len(calls) == len(names) + 1, "one was begun twice, by the killed worker and another"
    table = json.loads((out / "table.json").read_text())["sequences"]
    assert [row["sequence"] for row in table] == names
    assert {row["status"] for row in table} == {"done"}
    assert all((out / name / "run.json").is_file() for name in names)
    assert unfinished(out) == []


def test_a_worker_with_another_program_and_an_absent_scheduler_are_told(
    tmp_path, monkeypatch, fails
) -> None:
    make_data_set(tmp_path / "data", 1)
    stand_in = StandIn(tmp_path)
    monkeypatch.setenv("UNLIDAR_TRACK", str(stand_in.write("'of the worker'")))
    arguments = ("run", tmp_path / "data", "--out", tmp_path / "out", "--scheduler")
    with processes() as started:
        scheduler, address = start_scheduler(tmp_path)
        started += [scheduler, start_worker(address)]
        (tmp_path / "mine").mkdir()
        mine = StandIn(tmp_path / "mine")
        monkeypatch.setenv("UNLIDAR_TRACK", str(mine.write("'of the caller'")))
        assert "1 of 1 recordings failed" in fails(2, *arguments, address)
    row = json.loads((tmp_path / "out/table.json").read_text())["sequences"][0]
    assert os.uname().nodename in row["remark"]
    assert "another build" in row["remark"]
    monkeypatch.setattr("unlidar.batch.cluster._PATIENCE_S", 1)
    assert "no answer" in fails(2, *arguments, "tcp://127.0.0.1:9")
    assert "no answer" in fails(2, *arguments, "nonsense://x")
