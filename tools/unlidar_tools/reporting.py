"""What is said while something works: notes, and with --verbose the commands and stages.

The package says it to the logger `unlidar_tools`; the command line shows it on stderr.
"""

import logging
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from unlidar_tools.errors import reason
from unlidar_tools.sanitize import hide_secrets, printable

_STAGE, _NOTE = "unlidar: ", "unlidar: note: "
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


def show_on_stderr(verbose: bool) -> None:
    """Lets the command line show notes, and stages if `verbose`."""
    for handler in LOGGER.handlers[:]:
        LOGGER.removeHandler(handler)
    handler = _StderrHandler()
    LOGGER.addHandler(handler)
    LOGGER.propagate = False
    LOGGER.setLevel(logging.INFO if verbose else logging.WARNING)


def forward_messages(said: str, name: str) -> None:
    """Tells what another process of this package has told on stderr, and whose it is."""
    for line in said.splitlines():
        if line.startswith(_NOTE):
            note(f"{name}: {line.removeprefix(_NOTE)}")
        elif line.startswith(_STAGE) and not line.startswith(f"{_STAGE}error: "):
            stage(f"{name}: {line.removeprefix(_STAGE)}")


class RateLimitedNote:
    """Says what repeats the first, second, fourth, eighth time and so on."""

    def __init__(self, what: str) -> None:
        self._what = what
        self.count = 0

    def __call__(self, detail: str) -> None:
        """Counts one more."""
        self.count += 1
        if self.count & (self.count - 1) == 0:
            times = f" ({self.count} so far)" if self.count > 1 else ""
            note(f"{self._what}{times}: {detail}")


def limit_logging(what: str, *loggers: str) -> None:
    """Says what libraries would say for every bad request as `RateLimitedNote` does, a line without trace."""
    said = _RateLimitedHandler(what)
    for name in loggers:
        logger = logging.getLogger(name)
        logger.handlers, logger.propagate = [said], False


class _RateLimitedHandler(logging.Handler):
    def __init__(self, what: str) -> None:
        super().__init__(logging.WARNING)
        self._said = RateLimitedNote(what)

    def emit(self, record: logging.LogRecord) -> None:
        error = record.exc_info[1] if record.exc_info else None
        text = record.getMessage().strip()
        self._said(f"{text}: {type(error).__name__}: {reason(error)}" if error else text)


class _StderrHandler(logging.Handler):
    """A line each, to whatever stderr is then."""

    def emit(self, record: logging.LogRecord) -> None:
        kind = _NOTE if record.levelno >= logging.WARNING else _STAGE
        print(f"{kind}{printable(hide_secrets(record.getMessage()))}", file=sys.stderr)
