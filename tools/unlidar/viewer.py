"""Shows the results of a run: in the rerun viewer where it is installed, else in the browser."""

import subprocess
import sys
import webbrowser
from importlib.util import find_spec
from pathlib import Path

from unlidar.report import load_run, write_page


def show(run: Path) -> tuple[str, Path, bool]:
    """Opens the results of the folder `run`; returns what, its file, and whether it was opened.

    Nothing is opened where there is no browser, as over SSH.
    """
    data = load_run(run)
    if find_spec("rerun") is not None:
        from unlidar.report.rrd import write_rrd

        path = write_rrd(data, run)
        viewer = [sys.executable, "-m", "rerun", str(path)]
        subprocess.Popen(viewer, stdin=subprocess.DEVNULL, start_new_session=True)
        return "recording", path, True
    page = write_page(data, run)
    return "page", page, webbrowser.open(page.resolve().as_uri())
