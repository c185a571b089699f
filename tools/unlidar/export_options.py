"""Options of `export`, in a module of their own so that --help need not load rosbags."""

from dataclasses import dataclass
from pathlib import Path

from unlidar.errors import UsageError
from unlidar.geodesy import Origin

FORMATS = {
    "tum": "timestamp tx ty tz qx qy qz qw, a file for each track",
    "csv": "one table with UTC, and with --origin places",
    "kml": "Google Earth, with times; needs --origin",
    "geojson": "maps; needs --origin",
    "courageous": "log of CEN CWA 18150 (OUT.courageous.json); needs --origin",
    "ros1": "a ROS 1 bag",
    "mcap": "ROS 2: one .mcap file, or a folder where OUT has no suffix",
    "mmaud": "mmaud_results.csv of the UG2+ challenge, or a .zip with it",
}
_BY_SUFFIX = {
    ".tum": "tum",
    ".txt": "tum",
    ".csv": "csv",
    ".kml": "kml",
    ".geojson": "geojson",
    ".json": "geojson",
    ".bag": "ros1",
    ".mcap": "mcap",
    ".zip": "mmaud",
}
_MMAUD_NAME = "mmaud_results.csv"
_COURAGEOUS_SUFFIX = ".courageous.json"
_FARTHEST_GEOID_M = 110  # EGM96 is between -107 and 86 m
_PLACED = ("kml", "geojson", "courageous")


@dataclass(frozen=True)
class Options:
    """Inputs of the formats beyond the trajectory."""

    origin: Origin | None = None
    frame_id: str = "map"
    points: Path | None = None  # default: what lies in the folder of results
    at: Path | None = None  # stamps that the challenge asks for
    uav_type: int = 0  # of the challenge's Classification
    geoid_m: float | None = None  # sea level above the ellipsoid; default: by PROJ's grid


def guess_format(out: Path) -> str:
    """The format by the output's name. UsageError for an unknown suffix."""
    name = out.name.lower()
    form = "courageous" if name.endswith(_COURAGEOUS_SUFFIX) else _BY_SUFFIX.get(out.suffix.lower())
    form = "mmaud" if out.name == _MMAUD_NAME else form
    if form is None:
        raise UsageError(
            f"{out}: the name tells no format, give --format: {', '.join(FORMATS)}; or a name in "
            + ", ".join((*_BY_SUFFIX, _COURAGEOUS_SUFFIX))
        )
    return form


def check(sources: int, form: str, options: Options) -> None:
    """UsageError if format and options are incompatible."""
    if form != "mmaud" and sources > 1:
        raise UsageError(f"--format {form} takes one trajectory, {sources} are given")
    if form in _PLACED and options.origin is None:
        raise UsageError(f"--format {form} needs --origin LAT,LON,HEIGHT: where the sensor stands")
    if form != "mmaud" and options.at is not None:
        raise UsageError(f"--at belongs to --format mmaud, not to {form}")
    if form != "courageous" and options.geoid_m is not None:
        raise UsageError(f"--geoid belongs to --format courageous, not to {form}")
    if options.geoid_m is not None and abs(options.geoid_m) > _FARTHEST_GEOID_M:
        raise UsageError(
            f"--geoid {options.geoid_m:g}: expected metres from -{_FARTHEST_GEOID_M} to "
            f"{_FARTHEST_GEOID_M}, as far as the sea is from the ellipsoid anywhere"
        )
