"""Progress reports: notes, and with --verbose the commands and stages.

The package logs to the logger `unlidar`; the command line shows it on stderr.
"""

import logging
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from unlidar.errors import reason
from unlidar.sanitize import hide_secrets, printable

_STAGE, _NOTE = "unlidar: ", "unlidar: note: "
LOGGER = logging.getLogger("unlidar")


def stage(text: str) -> None:
    """Logs a stage, shown with --verbose only (level INFO)."""
    LOGGER.info(text)


@contextmanager
def timed(text: str) -> Iterator[None]:
    """Logs a stage with its wall time when it has ended, in the program's form."""
    begin = time.perf_counter()
    yield
    stage(f"{text} ({time.perf_counter() - begin:.3f} s)")


def note(text: str) -> None:
    """Logs a note, shown to every user (level WARNING)."""
    LOGGER.warning(text)


def is_verbose() -> bool:
    """True if stages are shown."""
    return LOGGER.isEnabledFor(logging.INFO)


def show_on_stderr(verbose: bool) -> None:
    """Shows notes, and stages if `verbose`, on stderr."""
    for handler in LOGGER.handlers[:]:
        LOGGER.removeHandler(handler)
    handler = _StderrHandler()
    LOGGER.addHandler(handler)
    LOGGER.propagate = False
    LOGGER.setLevel(logging.INFO if verbose else logging.WARNING)


def forward_messages(stderr: str, name: str) -> None:
    """Logs the notes and stages on a child process's stderr, prefixed with `name`."""
    for line in stderr.splitlines():
        if line.startswith(_NOTE):
            note(f"{name}: {line.removeprefix(_NOTE)}")
        elif line.startswith(_STAGE) and not line.startswith(f"{_STAGE}error: "):
            stage(f"{name}: {line.removeprefix(_STAGE)}")


class RateLimitedNote:
    """A repeating note, shown the first, second, fourth, eighth time and so on."""

    def __init__(self, text: str) -> None:
        self._text = text
        self.count = 0

    def __call__(self, detail: str) -> None:
        """Counts an occurrence; logs it if the count is a power of two."""
        self.count += 1
        if self.count & (self.count - 1) == 0:
            times = f" ({self.count} so far)" if self.count > 1 else ""
            note(f"{self._text}{times}: {detail}")


def limit_logging(text: str, *loggers: str) -> None:
    """Rate-limits the loggers of libraries, which log every bad request, and drops tracebacks."""
    handler = _RateLimitedHandler(text)
    for name in loggers:
        logger = logging.getLogger(name)
        logger.handlers, logger.propagate = [handler], False


class _RateLimitedHandler(logging.Handler):
    def __init__(self, text: str) -> None:
        super().__init__(logging.WARNING)
        self._note = RateLimitedNote(text)

    def emit(self, record: logging.LogRecord) -> None:
        error = record.exc_info[1] if record.exc_info else None
        text = record.getMessage().strip()
        self._note(f"{text}: {type(error).__name__}: {reason(error)}" if error else text)


class _StderrHandler(logging.Handler):
    """Writes a line for each record to the current sys.stderr."""

    def emit(self, record: logging.LogRecord) -> None:
        kind = _NOTE if record.levelno >= logging.WARNING else _STAGE
        print(f"{kind}{printable(hide_secrets(record.getMessage()))}", file=sys.stderr)
