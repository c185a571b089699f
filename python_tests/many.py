"""Folders of recordings, and a stand-in for the program that tells when it was called."""

from __future__ import annotations

import hashlib
import os
import shlex
import stat
import sys
import time
from collections.abc import Callable
from fnmatch import fnmatch
from pathlib import Path

import numpy as np
from test_run import STUB

BEGIN = """
import os, time
name = pathlib.Path.cwd().name.split(".partial-")[0].lstrip(".")
with open({calls!r}, "a") as log: print(name, file=log)
"""


class StandIn:
    """Writes the stand-in program; `behaviour` is Python that knows `name`, the recording's."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "stand_in"
        self._script = folder / "stand_in.py"
        self._calls = folder / "calls"

    def write(self, behaviour: str = "") -> Path:
        begin = BEGIN.format(calls=str(self._calls)) + behaviour
        script = STUB.format(behaviour=begin)
        self._script.write_text(script)
        # The shell keeps the digest of the script: another behaviour is another program.
        digest = hashlib.sha256(script.encode()).hexdigest()
        call = shlex.join([sys.executable, str(self._script)])
        self.path.write_text(f'#!/bin/sh\n# {digest}\nexec {call} "$@"\n')
        self.path.chmod(self.path.stat().st_mode | stat.S_IXUSR)
        return self.path

    def calls(self) -> list[str]:
        """The recordings it was called for since the last time this was asked."""
        found = self._calls.read_text().split() if self._calls.exists() else []
        self._calls.unlink(missing_ok=True)
        return found

    def called(self) -> int:
        return len(self._calls.read_text().split()) if self._calls.exists() else 0


def make_sequence(root: Path, height_m: float = 2.0) -> Path:
    """The smallest sequence in the layout of MMAUD."""
    for name in ("lidar_360", "ground_truth"):
        (root / name).mkdir(parents=True)
    for k in range(1, 4):
        np.save(root / "lidar_360" / f"1700000000.{k}.npy", np.full((4, 3), 1.0 + k))
        np.save(root / "ground_truth" / f"1700000000.{k}.npy", np.full(3, height_m))
    return root


def make_data_set(root: Path, count: int) -> list[str]:
    """val/seq0001 and so on; returns their names in the table."""
    names = [f"val/seq{k:04}" for k in range(1, count + 1)]
    for name in names:
        make_sequence(root / name)
    return names


def wait_for(condition: Callable[[], bool], what: str) -> None:
    end = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < end, f"waited in vain for {what}"
        time.sleep(0.02)


def command(*arguments: object) -> list[str]:
    """`unlidar` as a process."""
    return [sys.executable, "-m", "unlidar", *(str(a) for a in arguments)]


def unfinished(out: Path) -> list[Path]:
    """The folders still being written. Unlike rglob, os.walk bears one that vanishes meanwhile."""
    return [
        Path(parent) / name
        for parent, folders, _ in os.walk(out)
        for name in folders
        if fnmatch(name, ".*.partial-*")
    ]
