"""Ctrl-C and SIGTERM end a process with one line and exit code 130, at whatever moment they come.

This module is imported before any other of the package and needs next to nothing itself.
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
    """Until `guarded` there is nothing to tidy up; an exception would be lost in an import."""
    for number in _SIGNALS:
        signal.signal(number, _end)


def guarded(act: Callable[[], int]) -> int:
    """The exit code of `act`, in which an interrupt is a KeyboardInterrupt.

    It comes once: a second one must not break the tidying up after the first. When `act` is done
    there is nothing left to interrupt.
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
    if _in_import(frame):  # where it might be lost or become an ImportError
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
        # Not SIG_IGN, which a process that a thread starts at this moment would inherit: it could
        # not be ended.
        signal.signal(number, lambda _number, _frame: None)
