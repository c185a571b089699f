"""A file of events that is followed while others replace it, or take it away."""

from __future__ import annotations

import asyncio
import contextlib
import os
from collections.abc import Callable
from pathlib import Path

import pytest
from live_program import PATIENCE_S
from unlidar.errors import InputError
from unlidar.events.source import open_source


def followed(path: Path, replace: Callable[[], None], restore: Callable[[], None]) -> list[bytes]:
    """Lines: one before, none meanwhile for a second, and one after."""
    got: list[bytes] = []

    async def run() -> None:
        quiet = 0
        async for line in open_source(str(path)).lines():
            if line.data:
                got.append(line.data)
                if len(got) == 2:
                    return
                replace()
            elif got and (quiet := quiet + 1) == 2:
                restore()

    asyncio.run(asyncio.wait_for(run(), PATIENCE_S))
    return got


@pytest.mark.parametrize("kind", ["pipe", "folder", "loop", "nothing"])
def test_whatever_takes_the_place_of_a_file_of_events_the_next_file_is_read(
    kind, tmp_path, caplog, monkeypatch
) -> None:
    monkeypatch.setattr("unlidar.events.source._RETRY_S", (0.05, 0.1))
    path = tmp_path / "events.jsonl"
    path.write_bytes(b"before\n")
    before = len(list(Path("/proc/self/fd").iterdir()))

    def replace() -> None:
        path.unlink()
        if kind == "pipe":
            os.mkfifo(path)
        elif kind == "folder":
            path.mkdir()
        elif kind == "loop":
            path.symlink_to(path)

    def restore() -> None:
        with contextlib.suppress(FileNotFoundError):
            path.rmdir() if kind == "folder" else path.unlink()
        path.write_bytes(b"after\n")

    assert followed(path, replace, restore) == [b"before", b"after"]
    assert len(list(Path("/proc/self/fd").iterdir())) <= before + 1
    said = [text for text in caplog.messages if "it is tried again" in text]
    assert bool(said) == (kind in ("pipe", "folder"))


def test_a_file_that_says_nothing_more_lets_time_pass(tmp_path) -> None:
    path = tmp_path / "events.jsonl"
    path.write_bytes(b"before\n")

    async def run() -> list[bytes]:
        got = []
        async for line in open_source(str(path)).lines():
            got.append(line.data)
            if len(got) == 2:
                break
        return got

    assert asyncio.run(asyncio.wait_for(run(), PATIENCE_S)) == [b"before", b""]


@pytest.mark.skipif(os.geteuid() == 0, reason="root reads everything")
def test_a_file_that_may_not_be_read_is_an_error_at_the_start(tmp_path) -> None:
    path = tmp_path / "events.jsonl"
    path.write_bytes(b"{}\n")
    path.chmod(0)
    with pytest.raises(InputError, match="cannot be read"):
        followed(path, lambda: None, lambda: None)
