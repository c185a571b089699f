"""The harness of unlidar_track: recordings in, trajectories measured, figures out."""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("unlidar-tools")
except PackageNotFoundError:  # used from a source tree that was not installed
    __version__ = "0+uninstalled"
