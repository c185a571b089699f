"""Fixtures of all Python tests."""

import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# Machines that test are slow now and then; what was found is written into a test, not kept beside.
settings.register_profile(
    "tests", deadline=None, database=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("tests")

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
    from unlidar_tools.cli import main

    def call(exit_code: int, *arguments: object) -> str:
        capsys.readouterr()
        assert main([str(a) for a in arguments]) == exit_code
        lines = capsys.readouterr().err.splitlines()
        assert len(lines) == 1, lines
        assert lines[0].startswith("unlidar: error: ")
        return lines[0]

    return call
