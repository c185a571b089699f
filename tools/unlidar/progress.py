"""Progress on stderr: shown on a terminal, silent in a pipe or a log."""

import sys
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from rich.console import Console
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from unlidar.sanitize import printable

T = TypeVar("T")


def on_terminal() -> bool:
    """True if stderr is a terminal."""
    return sys.stderr is not None and sys.stderr.isatty()


@contextmanager
def show_stages(description: str | None) -> Iterator[Callable[[str], None]]:
    """Shows a spinner with elapsed time and the last stage; None: shows nothing."""
    columns = SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn()
    shown = description is not None and on_terminal()
    with Progress(
        *columns, console=Console(stderr=True), transient=True, disable=not shown
    ) as progress:
        task = progress.add_task(_text(description or ""), total=None)
        yield lambda text: progress.update(task, description=_text(f"{description}  {text}"))


def _text(text: str) -> str:
    return escape(printable(text))


def with_progress(items: Iterable[T], total: int, description: str) -> Generator[T, None, None]:
    """Yields the items and shows how many of `total` are done, with the remaining time."""
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(
        *columns, console=Console(stderr=True), transient=True, disable=not on_terminal()
    ) as progress:
        yield from progress.track(items, total=total, description=_text(description))
