"""What is built for arm64 gives the rows of what is built for this machine.

The program (tools/arm64.sh) to 1e-6 m where Ceres fits them, live byte for byte; the engine of the
wheel (tools/package.sh --arm64) digit for digit.
"""

from __future__ import annotations

import os
import platform
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from synthetic import PROJECT, make_flight


@pytest.fixture(autouse=True)
def _needed() -> None:
    if platform.machine() == "aarch64":
        pytest.skip("this machine is arm64: all tests are of it")
    needed = ("aarch64-linux-gnu-g++", "qemu-aarch64-static")
    missing = [tool for tool in needed if shutil.which(tool) is None]
    if missing:
        pytest.skip(f"not installed: {' '.join(missing)}")
    if not (PROJECT / "build" / "unlidar_track").is_file():
        pytest.skip("build/unlidar_track is not built: there is nothing to compare with")


def output_of(*command: str | Path, **environment: str) -> str:
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        env=os.environ | environment,
    )
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr
    return done.stdout


def test_arm64_has_the_same_rows() -> None:
    said = output_of(PROJECT / "tools/arm64.sh", "--quick")
    rows = [line for line in said.splitlines() if " rows: " in line]
    same = (": the same bytes", ": the same to 1e-6 m")
    assert len(rows) == 3 and all(line.endswith(same) for line in rows), rows
    assert all(line.endswith(same[0]) for line in rows if " live " in line), rows


ROWS = """
import sys
import numpy as np
import unlidar
frames = np.load(sys.argv[1])
engine = unlidar.Engine()
events = [e for name in frames for e in engine.add("lidar", int(name), frames[name])]
print(*(event for event in events + engine.close() if isinstance(event, unlidar.Row)), sep="\\n")
"""


def test_the_wheel_of_arm64_has_the_same_rows(tmp_path: Path) -> None:
    pytest.importorskip("unlidar._engine", reason="the engine for Python is not built")
    said = output_of(PROJECT / "tools/package.sh", "--arm64")
    (wheel,) = (PROJECT / "out/packages-arm64").iterdir()
    assert re.fullmatch(
        r"unlidar_track-[0-9.]+-cp311-cp311-manylinux_2_\d+_aarch64\.whl", wheel.name
    )
    assert said.splitlines()[-1] == "import unlidar: aarch64"
    flight = make_flight()
    frames = {str(s): c for s, c in zip(flight.stamps_ns, flight.clouds, strict=True)}
    np.savez(tmp_path / "frames.npz", **frames)
    sysroot = PROJECT / "build-arm64-sysroot"
    there = output_of(
        "qemu-aarch64-static", "-L", sysroot, sysroot / "usr/bin/python3.11",
        "-c", ROWS, tmp_path / "frames.npz",
        PYTHONPATH=str(PROJECT / "out/wheel-arm64/site"),
    )  # fmt: skip
    here = output_of(sys.executable, "-c", ROWS, tmp_path / "frames.npz")
    assert here == there and here.count("\n") > 20
