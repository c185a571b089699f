"""Results appear complete or not at all: written beside, then renamed."""

import glob
import os
import secrets
import shutil
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from unlidar.errors import OutputError, UsageError, reason

# Every folder this package writes holds one of these; --force replaces no other folder.
RUN_RECORD = "run.json"
FRAMES = "frames"  # converted frames, beside it
MARKERS = ("conversion.json", "scenario.json", RUN_RECORD)
_KINDS = "partial", "old"  # of temporary directories


def is_run(folder: Path) -> bool:
    """True for the folder of a run: what lies in it are results, no frames."""
    return (folder / RUN_RECORD).is_file()


@contextmanager
def complete_directory(
    out: Path, force: bool, source: Path | None = None, token: str = ""
) -> Iterator[Path]:
    """Yields a temporary directory that becomes `out` when the block ends without an error.

    An existing non-empty `out` is refused, or with `force` replaced if this package wrote it.
    `source` is the input, which must not be replaced. `token` goes into the names of the
    temporary directories, so that `leftovers` finds those of a process that was killed.
    """
    out = out.absolute()
    if source is not None and (
        source.resolve() == out.resolve() or out.resolve() in source.resolve().parents
    ):
        raise UsageError(f"{out}: the output would replace its own source {source}")
    _refuse_foreign(out, force)
    work = _temporary(out, "partial", token)
    try:
        work.mkdir(parents=True)
        yield work
        _replace(work, out, token)
    except OSError as error:
        raise OutputError(f"{out}: cannot be written: {reason(error)}") from error
    finally:
        shutil.rmtree(work, ignore_errors=True)


def leftovers(out: Path, token: str) -> list[Path]:
    """Temporary directories of a killed `complete_directory` with this `out` and `token`."""
    return [
        path
        for kind in _KINDS
        for path in out.parent.glob(f"{glob.escape(_prefix(out, kind, token))}*")
    ]


def write_file(path: Path, write: Callable[[Path], None]) -> None:
    """Lets `write` fill a file of the same suffix beside `path`, then renames it to `path`."""
    if not path.name:
        raise OutputError(f"{path}: is a folder, expected the name of a file")
    work = path.with_name(f".partial-{os.getpid()}-{path.name}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write(work)
        work.replace(path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {reason(error)}") from error
    finally:
        work.unlink(missing_ok=True)


def refuse_input(out: Path, *inputs: Path | None) -> None:
    """UsageError if `out` is a file that is read: it would be replaced by what is made of it."""
    if any(path is not None and path.resolve() == out.resolve() for path in inputs):
        raise UsageError(f"{out}: is what is read, expected another name for what is written")


def clear_results(out: Path, names: Iterable[str]) -> None:
    """Makes the folder `out` and removes files of an earlier run."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        for name in names:
            (out / name).unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"{out}: cannot be written: {reason(error)}") from error


def _refuse_foreign(out: Path, force: bool) -> None:
    if not out.exists() and not out.is_symlink():
        return
    if not out.is_dir():
        raise OutputError(f"{out}: exists and is not a folder")
    if not any(out.iterdir()):
        return
    if not force:
        raise OutputError(f"{out}: exists already; choose another folder or give --force")
    if not any((out / marker).is_file() for marker in MARKERS):
        raise OutputError(
            f"{out}: holds none of {', '.join(MARKERS)}, so it was not written by this command "
            "and is not replaced"
        )


def _replace(work: Path, out: Path, token: str) -> None:
    if not out.exists():
        work.rename(out)
        return
    old = _temporary(out, "old", token)
    try:
        old.mkdir()
        out.rename(old / out.name)
        work.rename(out)
    except BaseException:  # also an interrupt between the two renames
        if not out.exists() and (old / out.name).exists():
            (old / out.name).rename(out)
        raise
    finally:
        shutil.rmtree(old, ignore_errors=True)


def _temporary(out: Path, kind: str, token: str) -> Path:
    """The path of a new directory beside `out`.

    Named before creation, so that an interrupt cannot leave a directory of unknown name.
    """
    return out.with_name(_prefix(out, kind, token) + secrets.token_hex(6))


def _prefix(out: Path, kind: str, token: str) -> str:
    return f".{out.name}.{kind}-{token}{'-' * bool(token)}"
