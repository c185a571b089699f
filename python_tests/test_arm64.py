"""tools/arm64.sh: what is built for arm64 gives the rows of what is built for this machine.

To 1e-6 m where Ceres fits them, live byte for byte.
"""

from __future__ import annotations

import platform
import shutil
import subprocess

import pytest
from synthetic import PROJECT


def test_arm64_has_the_same_rows() -> None:
    if platform.machine() == "aarch64":
        pytest.skip("this machine is arm64: all tests are of it")
    needed = ("aarch64-linux-gnu-g++", "qemu-aarch64-static")
    missing = [tool for tool in needed if shutil.which(tool) is None]
    if missing:
        pytest.skip(f"not installed: {' '.join(missing)}")
    if not (PROJECT / "build" / "unlidar_track").is_file():
        pytest.skip("build/unlidar_track is not built: there is nothing to compare with")
    done = subprocess.run(
        [PROJECT / "tools/arm64.sh", "--quick"],
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
    )
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr
    rows = [line for line in done.stdout.splitlines() if " rows: " in line]
    same = (": the same bytes", ": the same to 1e-6 m")
    assert len(rows) == 3 and all(line.endswith(same) for line in rows), rows
    assert all(line.endswith(same[0]) for line in rows if " live " in line), rows
