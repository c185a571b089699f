"""Register of the results that a batch run is about to write, kept in its output folder.

A killed run leaves half-written folders. The next run removes them and nothing else: only the
names in the register, directly beside the results.
"""

import fcntl
import json
import re
import secrets
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import TextIO

from unlidar.errors import OutputError, UsageError, reason
from unlidar.output import leftovers

REGISTER = ".unlidar-run"
_TOKEN = re.compile(r"[0-9a-f]{8}")
_Entry = tuple[str, list[str]]  # token of a run, names of its results below the folder


@contextmanager
def registered(out: Path, names: Iterable[str], tables: Iterable[Path]) -> Iterator[str]:
    """Locks `out` against other runs and yields the token for its temporary folders.

    Leftovers of earlier runs are removed before, those of this run after. Throws UsageError
    if another run holds the lock, and OutputError if `out` cannot be written or holds `tables`
    that no run has written.
    """
    try:
        foreign = next((path for path in tables if path.exists()), None)
        if foreign is not None and not (out / REGISTER).exists():
            raise OutputError(
                f"{foreign}: was not written by this command and is not replaced, choose another "
                "folder"
            )
        out.mkdir(parents=True, exist_ok=True)
        with (out / REGISTER).open("a+", encoding="utf-8") as file:
            try:  # flock: the system releases the lock of a killed run
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                raise UsageError(f"--out {out}: another run is writing to it") from error
            token = secrets.token_hex(4)
            entries = [*_swept(out, _read(file)), (token, list(names))]
            _write(file, entries)
            try:
                yield token
            finally:
                _write(file, _swept(out, entries))
    except OSError as error:
        raise OutputError(f"{out}: cannot be written: {reason(error)}") from error


def _swept(out: Path, entries: list[_Entry]) -> list[_Entry]:
    """Removes the leftovers of these entries and returns the entries where that failed."""
    remaining = []
    for token, names in entries:
        for name in names:
            for folder in leftovers(out / name, token):
                shutil.rmtree(folder, ignore_errors=True)
        kept = [name for name in names if leftovers(out / name, token)]
        if kept:
            remaining.append((token, kept))
    return remaining


def _read(file: TextIO) -> list[_Entry]:
    """The entries; lines that are truncated or that name a path outside are ignored."""
    file.seek(0)
    entries = []
    for line in file:
        try:
            known = json.loads(line)
            token, names = str(known["token"]), [str(name) for name in known["results"]]
        except (ValueError, KeyError, TypeError, RecursionError):
            continue
        if _TOKEN.fullmatch(token):
            entries.append((token, [name for name in names if _is_below(name)]))
    return entries


def _write(file: TextIO, entries: list[_Entry]) -> None:
    """Rewrites the register in place: a new file would not hold the lock."""
    file.truncate(0)
    for token, names in entries:
        file.write(json.dumps({"token": token, "results": names}) + "\n")
    file.flush()


def _is_below(name: str) -> bool:
    path = PurePosixPath(name)
    return not path.is_absolute() and bool(path.parts) and ".." not in path.parts
