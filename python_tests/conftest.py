"""Fixtures of all Python tests."""

import json
import os
import signal
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# Machines that test are slow now and then; what was found is written into a test, not kept beside.
settings.register_profile(
    "tests", deadline=None, database=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("tests")

# Where it is ignored, as under nohup, programs that are started ignore it as well.
signal.signal(signal.SIGHUP, signal.SIG_DFL)

PROJECT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def program() -> Path:
    """The built program, from UNLIDAR_TRACK or the build folder."""
    path = Path(os.environ.get("UNLIDAR_TRACK", PROJECT / "build" / "unlidar_track"))
    if not path.is_file():
        pytest.skip(f"{path} is not built")
    return path


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder with real recordings beside the project."""
    path = PROJECT.parent / "shared"
    if not path.is_dir():
        pytest.skip("../shared is absent: no real recordings to test on")
    return path


@pytest.fixture
def fails(capsys):
    """Runs `unlidar` with arguments, expects an exit code and one line on stderr; returns it."""
    from unlidar.cli import main

    def call(exit_code: int, *arguments: object) -> str:
        capsys.readouterr()
        assert main([str(a) for a in arguments]) == exit_code
        lines = capsys.readouterr().err.splitlines()
        assert len(lines) == 1, lines
        assert lines[0].startswith("unlidar: error: ")
        return lines[0]

    return call


@pytest.fixture
def traced(tmp_path, monkeypatch):
    """Makes a finished run with a trace by hand; its program is stood in for."""
    from traced_run import TracedRun
    from unlidar import explain

    def make(**how):
        run = TracedRun(tmp_path / "run", **how)
        monkeypatch.setattr(explain, "run_program", run.program)
        return run

    return make


@pytest.fixture
def explained(capsys):
    """The targets in the JSON of `unlidar explain`."""
    from unlidar.cli import main

    def call(run, *options: object) -> list[dict]:
        folder = run if isinstance(run, Path) else run.write()
        capsys.readouterr()
        assert main(["explain", str(folder), "--json", *map(str, options)]) == 0
        return json.loads(capsys.readouterr().out)["targets"]

    return call
