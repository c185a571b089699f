"""Trajectories in the formats of other programs; docs/export.md describes each."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from unlidar.errors import InputError
from unlidar.export.bags import write_mcap, write_ros1
from unlidar.export.courageous import write_courageous
from unlidar.export.dates import DATED, note_dates
from unlidar.export.geo import write_geojson, write_kml
from unlidar.export.mmaud import read_stamps, write_mmaud
from unlidar.export.text import write_csv, write_tum
from unlidar.export.trajectory import Result, read_result, trajectory_of
from unlidar.export_options import Options
from unlidar.output import refuse_input
from unlidar.program import SUMMARY

__all__ = ["Result", "export", "read_result"]

_FARTHEST_M = 1e6  # as of events: a track that is farther has other coordinates


def export(
    sources: Sequence[tuple[str, Path]], out: Path, form: str, options: Options
) -> list[Path]:
    """Writes results, as (name, trajectory or folder of results), and returns the files.

    All formats but "mmaud" take exactly one source; `export_options.check` has seen to that.
    """
    read = [one for _, path in sources for one in (trajectory_of(path), path / SUMMARY)]
    refuse_input(out, options.at, options.points, *read)
    results = [(name, read_result(path, options.points)) for name, path in sources]
    if form == "mmaud":
        names = [name for name, _ in results]
        stamps = None if options.at is None else read_stamps(options.at, names)
        return write_mmaud(results, out, stamps, options.uav_type)
    result = results[0][1]
    if options.origin is not None:
        _check_places(sources[0][1], result)
    if form in DATED:
        note_dates(sources[0][1], result.tracks.stamp_ns, out.name)
    write: dict[str, Callable[[], list[Path]]] = {
        "tum": lambda: write_tum(result, out),
        "csv": lambda: write_csv(result, out, options.origin),
        "kml": lambda: write_kml(result, out, options.origin),
        "geojson": lambda: write_geojson(result, out, options.origin),
        "courageous": lambda: write_courageous(result, out, options.origin, options.geoid_m),
        "ros1": lambda: write_ros1(result, out, options.frame_id),
        "mcap": lambda: write_mcap(result, out, options.frame_id),
    }
    return write[form]()


def _check_places(path: Path, result: Result) -> None:
    """InputError for a trajectory that is not about its --origin, as one of a map's coordinates."""
    farthest_m = np.abs(result.tracks.xyz_m).max(initial=0.0)
    if farthest_m > _FARTHEST_M:
        raise InputError(
            f"{path}: a row is {farthest_m / 1000:.0f} km from --origin, expected metres from it, "
            "1000 km at most"
        )
