"""The harness of unlidar_track: recordings in, trajectories measured, figures out."""

from typing import Any


def __getattr__(name: str) -> Any:
    # When it is asked for, lest every command wait for it.
    if name == "__version__":
        from importlib.metadata import PackageNotFoundError, version

        try:
            return version("unlidar-tools")
        except PackageNotFoundError:  # used from a source tree that was not installed
            return "0+uninstalled"
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
