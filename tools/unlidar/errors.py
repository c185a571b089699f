"""Errors that a user can fix, and the one place that turns them into a line and an exit code."""

import os
import re
import sys
from collections.abc import Callable, Iterable

from unlidar.sanitize import hide_secrets, printable

_MOST = 240  # characters of a message
_MOST_NAMES = 110  # of the names in a list
_MOST_WORDS = 48, 100  # characters of later words and of the first, in too long a message


class UnlidarError(Exception):
    """One line that names the file, the value and what was expected."""

    exit_code = 1


class UsageError(UnlidarError):
    """The command line asks for something that does not exist or does not fit together."""

    exit_code = 2


class ConfigError(UnlidarError):
    """A scenario or configuration file has a wrong key or value."""

    exit_code = 3


class InputError(UnlidarError):
    """A recording, truth or trajectory cannot be read."""

    exit_code = 4


class OutputError(UnlidarError):
    """A result cannot be written."""

    exit_code = 5


class ForwardedError(UnlidarError):
    """A failure outside of the command itself, whose exit code is passed on."""

    def __init__(self, message: str, exit_code: int):
        super().__init__(message)
        self.exit_code = exit_code


class ProgramError(ForwardedError):
    """`unlidar_track` itself failed."""


class BatchError(ForwardedError):
    """Some of many recordings failed: their exit code, or 1 where they differ."""


def reason(error: BaseException) -> str:
    """The message of a library's exception on one line, without the path that it repeats."""
    text = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return " ".join(text.split())


def listed(names: Iterable[str], most: int = _MOST_NAMES) -> str:
    """Names for a message, as many as fit: `a, b, c and 5 more`."""
    known = [_cut(str(name), _MOST_NAMES) for name in names]
    shown, length = 0, 0
    while shown < len(known) and (not shown or length + len(known[shown]) <= most):
        length += len(known[shown]) + 2
        shown += 1
    rest = len(known) - shown
    return ", ".join(known[:shown]) + (f" and {rest} more" if rest else "")


def shortened(message: str) -> str:
    """The message as one printable line of bounded length.

    Long names lose their middle first, then the whole line does. The file at its begin is cut last,
    the expectation at its end never.
    """
    line = printable(hide_secrets(" ".join(message.split())))
    first, blank, rest = line.partition(" ")
    others, own = _MOST_WORDS
    if len(line) > _MOST:
        rest = re.sub(r"\S+", lambda word: _cut(word[0], others), rest)
    if len(first) + len(rest) >= _MOST:
        first = _cut(first, own)
    return _cut(first + blank + rest, _MOST)


def _cut(text: str, most: int) -> str:
    """The word without its middle: the end of a path is its name."""
    if len(text) <= most:
        return text
    head = most // 2 - 3
    return f"{text[:head]}...{text[head + 3 - most :]}"


def report_errors(act: Callable[[], None]) -> int:
    """Runs `act` and returns the exit code; an error becomes one line on stderr."""
    exit_code = _exit_code_of(act)
    try:
        if sys.stdout is not None:  # stdout may be closed
            sys.stdout.flush()
    except OSError as error:
        _forget_stdout()
        # A closed pipe is no error: its reader has seen enough.
        if exit_code == 0 and not isinstance(error, BrokenPipeError):
            _tell(f"stdout: cannot be written: {reason(error)}")
        exit_code = exit_code or OutputError.exit_code
    return exit_code


def _exit_code_of(act: Callable[[], None]) -> int:
    try:
        act()
    except UnlidarError as error:
        return _tell(str(error), error.exit_code)
    except SystemExit as end:  # argparse, after --help and --version
        return end.code if isinstance(end.code, int) else 0
    except BrokenPipeError:
        _forget_stdout()
        return OutputError.exit_code
    except Exception as error:
        if os.environ.get("UNLIDAR_DEBUG"):
            raise
        return _tell(f"internal: {type(error).__name__}: {reason(error)}", 1)
    return 0


def _forget_stdout() -> None:
    """Redirects stdout to /dev/null: flushing its buffer at exit would fail once more."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _tell(message: str, exit_code: int = 0) -> int:
    print(f"unlidar: error: {shortened(message)}", file=sys.stderr)
    return exit_code
