"""What is said while something works: notes, and with --verbose the commands and stages.

The package says it to the logger `unlidar_tools`; the command line shows it on stderr.
"""

import logging
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from unlidar_tools.printable import printable

LOGGER = logging.getLogger("unlidar_tools")


def stage(text: str) -> None:
    """Of interest to those who want to know every step."""
    LOGGER.info(text)


@contextmanager
def timed(text: str) -> Iterator[None]:
    """Tells of a stage when it has ended, with its time, as the program does."""
    begin = time.perf_counter()
    yield
    stage(f"{text} ({time.perf_counter() - begin:.3f} s)")


def note(text: str) -> None:
    """Of interest to every user."""
    LOGGER.warning(text)


def is_verbose() -> bool:
    """Whether stages are shown."""
    return LOGGER.isEnabledFor(logging.INFO)


def show(verbose: bool) -> None:
    """Lets the command line show notes, and stages if `verbose`."""
    for handler in LOGGER.handlers[:]:
        LOGGER.removeHandler(handler)
    handler = _Lines()
    LOGGER.addHandler(handler)
    LOGGER.propagate = False
    LOGGER.setLevel(logging.INFO if verbose else logging.WARNING)


class _Lines(logging.Handler):
    """A line each, to whatever stderr is then."""

    def emit(self, record: logging.LogRecord) -> None:
        kind = "note: " if record.levelno >= logging.WARNING else ""
        print(f"unlidar: {kind}{printable(record.getMessage())}", file=sys.stderr)
