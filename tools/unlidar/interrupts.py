"""Ctrl-C and SIGTERM end a process with one line and exit code 130 at any time.

Imported before any other module of the package, so it has next to no dependencies.
"""

import os
import signal
from collections.abc import Callable
from types import FrameType
from typing import NoReturn

INTERRUPTED = 130
_SIGNALS = signal.SIGINT, signal.SIGTERM
_IMPORT_SYSTEM = "<frozen importlib._bootstrap>"
_RETRY_S = 0.01
_LINE = b"unlidar: error: interrupted\n"


def end_at_once() -> None:
    """Exits at once on signals until `guarded`: no cleanup is due, and imports lose exceptions."""
    for number in _SIGNALS:
        signal.signal(number, _end)


def guarded(act: Callable[[], int]) -> int:
    """Runs `act`, in which an interrupt raises KeyboardInterrupt; returns its exit code.

    It is raised once, as a second one would break the cleanup of the first, and never after
    `act` has returned.
    """
    try:
        for number in _SIGNALS:
            signal.signal(number, _raise)
        exit_code = act()
        _ignore()
    except KeyboardInterrupt:
        _ignore()
        os.write(2, _LINE)
        return INTERRUPTED
    return exit_code


def _end(_number: int, _frame: object) -> NoReturn:
    os.write(2, _LINE)
    os._exit(INTERRUPTED)


def _raise(_number: int, frame: FrameType | None) -> None:
    if _in_import(frame):  # imports may swallow it or turn it into an ImportError
        signal.signal(signal.SIGALRM, _raise)
        signal.setitimer(signal.ITIMER_REAL, _RETRY_S)
        return
    _ignore()
    raise KeyboardInterrupt


def _in_import(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename == _IMPORT_SYSTEM:
            return True
        frame = frame.f_back
    return False


def _ignore() -> None:
    signal.setitimer(signal.ITIMER_REAL, 0)
    for number in (*_SIGNALS, signal.SIGALRM):
        # Not SIG_IGN: a child process started by a thread at this moment would inherit it and could
        # not be terminated.
        signal.signal(number, lambda _number, _frame: None)
