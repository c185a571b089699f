"""Export of a time span of a store in the formats of `unlidar export`."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from unlidar.errors import UsageError
from unlidar.export.bags import write_mcap
from unlidar.export.geo import write_geojson, write_kml
from unlidar.export.text import write_csv
from unlidar.export.trajectory import Result, Track
from unlidar.export_options import Options
from unlidar.geodesy import Origin
from unlidar.history.reader import StoredTrack
from unlidar.reporting import note
from unlidar.truth import Tracks


def write_history(
    tracks: list[StoredTrack], out: Path, form: str, name: str, origin: Origin | None
) -> list[Path]:
    """Writes tracks of one station; returns the files. UsageError if `form` needs an origin."""
    if form in ("geojson", "kml") and origin is None:
        raise UsageError(
            f"--format {form} needs an origin: none is stored, give --origin LAT,LON,HEIGHT"
        )
    result = to_result(tracks, name)
    write: dict[str, Callable[[], list[Path]]] = {
        "csv": lambda: write_csv(result, out, origin),
        "geojson": lambda: write_geojson(result, out, _needed(origin)),
        "kml": lambda: write_kml(result, out, _needed(origin)),
        "mcap": lambda: write_mcap(result, out, Options().frame_id),
    }
    return write[form]()


def stamps_of(tracks: list[StoredTrack]) -> np.ndarray:
    """The stamps of all rows, (N,) int64."""
    return np.array([row[0] for track in tracks for row in track.rows], dtype=np.int64)


def to_result(tracks: list[StoredTrack], name: str) -> Result:
    """The tracks as a Result. Track numbers used twice are replaced by the store's."""
    numbers = [track.number for track in tracks]
    if len(set(numbers)) < len(numbers):
        note("an engine has begun its numbers anew: tracks are numbered as the store has them")
        numbers = [track.identity for track in tracks]
    by_track = []
    for number, track in zip(numbers, tracks, strict=True):
        stamps = np.array([row[0] for row in track.rows], dtype=np.int64)
        values = np.array([row[1:11] for row in track.rows], dtype=float).reshape(-1, 10)
        by_track.append(
            Track(number, stamps, values[:, :3], values[:, 3:6], values[:, 6:9], values[:, 9])
        )
    return Result(name, _together(by_track), by_track, None)


def _together(by_track: list[Track]) -> Tracks:
    def column(name: str, shape: tuple[int, ...]) -> np.ndarray:
        return np.concatenate([np.empty(shape), *(getattr(track, name) for track in by_track)])

    stamp_ns = np.concatenate([np.empty(0, np.int64), *(track.stamp_ns for track in by_track)])
    return Tracks(
        stamp_ns * 1e-9,
        np.repeat([float(t.track_id) for t in by_track], [len(t) for t in by_track]),
        column("xyz_m", (0, 3)),
        column("sigma_m", (0, 3)),
        column("velocity_mps", (0, 3)),
        column("support", (0,)),
        stamp_ns,
    )


def _needed(origin: Origin | None) -> Origin:
    assert origin is not None
    return origin
