"""tools/arm64.sh: what is built for arm64 gives the rows of what is built for this machine."""

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
    assert len(rows) == 3 and all(line.endswith(": the same bytes") for line in rows), rows
