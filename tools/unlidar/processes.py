"""Parallel jobs, each in a process of its own.

A crashed or killed job affects no other, and no job outlives the process that started it.
"""

import ctypes
import os
import pickle
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import dataclass
from typing import Any, TypeVar

from unlidar import interrupts, reporting
from unlidar.errors import report_errors

T = TypeVar("T")
R = TypeVar("R")

_VERBOSE = "--verbose"
_NOTICE_S = 0.5
_PR_SET_PDEATHSIG = 1  # <linux/prctl.h>


@dataclass(frozen=True)
class Ended:
    """The outcome of a process."""

    exit_code: int  # negative: minus the signal that ended it
    result: Any  # None if it failed
    stderr: str  # its stderr

    @property
    def failure(self) -> tuple[str, int]:
        """The reason of a failure in one line, and the exit code of `unlidar` for it."""
        if self.exit_code < 0:
            name = signal.Signals(-self.exit_code).name
            hint = " (out of memory?)" if self.exit_code == -signal.SIGKILL else ""
            return f"its process was ended by {name}{hint}", 1
        last = (self.stderr.strip().splitlines() or ["ended without a result"])[-1]
        return last.removeprefix("unlidar: error: "), self.exit_code or 1


class Launcher:
    """Starts `python -m MODULE`, whose `main` is `serve`, from any number of threads."""

    def __init__(self, module: str) -> None:
        self._command = [sys.executable, "-m", module, str(os.getpid())]
        self._lock = threading.Lock()
        self._running: set[subprocess.Popen] = set()
        self._stopped = False

    def __call__(self, work: object, name: str) -> Ended:
        """Runs `work` in a new process and waits for it; forwards its messages with `name`."""
        with self._lock:
            if self._stopped:
                return Ended(interrupts.INTERRUPTED, None, "interrupted")
            process = subprocess.Popen(
                [*self._command, *([_VERBOSE] if reporting.is_verbose() else [])],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                process_group=0,  # Ctrl-C reaches this process only, which then stops the others
            )
            self._running.add(process)
        try:
            answer, stderr = process.communicate(pickle.dumps(work))
        finally:
            with self._lock:
                self._running.discard(process)
        reporting.forward_messages(stderr.decode(errors="replace"), name)
        result = pickle.loads(answer) if process.returncode == 0 else None
        return Ended(process.returncode, result, stderr.decode(errors="replace"))

    def stop(self) -> None:
        """Terminates running processes and prevents new ones."""
        with self._lock:
            self._stopped = True
            for process in self._running:
                process.terminate()


def side_by_side(
    work: Callable[[T], R], items: Sequence[T], at_once: int, stop: Callable[[], None]
) -> Generator[tuple[T, R], None, None]:
    """Yields each item with its result in the order of completion; close the generator.

    `work` is called from threads and only waits for processes; `stop` terminates these when the
    caller closes the generator.
    """
    with ThreadPoolExecutor(at_once) as pool:
        try:
            futures = {pool.submit(work, item): item for item in items}
            waiting = set(futures)
            while waiting:
                # With a timeout: a signal just before the wait would not wake it.
                done, waiting = wait(waiting, _NOTICE_S, FIRST_COMPLETED)
                for future in done:
                    yield futures[future], future.result()
        finally:
            stop()


def serve(act: Callable[[Any], object]) -> int:
    """The `main` of a launched process: returns the result of its work to the parent.

    Returns the exit code; an error becomes one line on stderr.
    """
    interrupts.end_at_once()
    _end_with(int(sys.argv[1]))
    reporting.show_on_stderr(_VERBOSE in sys.argv)
    answer = os.dup(1)
    os.dup2(2, 1)  # prints must not mix with the answer on stdout

    def work() -> None:
        result = act(pickle.load(sys.stdin.buffer))
        with os.fdopen(answer, "wb") as file:
            pickle.dump(result, file)

    return interrupts.guarded(lambda: report_errors(work))


def _end_with(parent: int) -> None:
    """Asks the kernel to end this process, as by SIGTERM, when its parent is gone."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:  # the parent has already ended
        sys.exit(1)
