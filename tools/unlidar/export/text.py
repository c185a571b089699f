"""Trajectories as lines of text: TUM and CSV."""

import csv
from pathlib import Path

import numpy as np

from unlidar.export.dates import utc
from unlidar.export.trajectory import Result, Track
from unlidar.geodesy import Origin, to_geodetic
from unlidar.output import write_file
from unlidar.stamps import format_stamp_ns

_AXES = ("x", "y", "z")


def write_tum(result: Result, out: Path) -> list[Path]:
    """A file for each track, the identity for the attitude: as the program's own --format tum.

    The track with the most returns (rows, where these are not known) is `out`, the others are
    STEM_track<ID> beside it.
    """
    best = max(result.by_track, key=_weight, default=None)
    paths = []
    for track in result.by_track or [None]:
        path = out
        if track is not best:
            path = out.with_name(f"{out.stem}_track{track.track_id}{out.suffix}")
        text = "# timestamp tx ty tz qx qy qz qw\n" + _tum_lines(track)
        write_file(path, lambda work, text=text: work.write_text(text))
        paths.append(path)
    return paths


def write_csv(result: Result, out: Path, origin: Origin | None) -> list[Path]:
    """One table of all tracks: stamp, UTC, position, optional columns; with an origin, lat/lon."""
    write_file(out, lambda work: _write_csv(result, work, origin))
    return [out]


def _weight(track: Track) -> float:
    return len(track) if track.support is None else float(track.support.sum())


def _tum_lines(track: Track | None) -> str:
    if track is None:
        return ""
    return "".join(
        f"{format_stamp_ns(int(stamp))} {' '.join(repr(float(v)) for v in xyz)} 0 0 0 1\n"
        for stamp, xyz in zip(track.stamp_ns, track.xyz_m, strict=True)
    )


def _write_csv(result: Result, work: Path, origin: Origin | None) -> None:
    known = result.tracks
    columns = ["timestamp", "utc", "track_id", *_AXES]
    columns += [f"v{axis}" for axis in _AXES] if known.velocity_mps is not None else []
    columns += [f"sigma_{axis}" for axis in _AXES] if known.sigma_m is not None else []
    columns += ["support"] if known.support is not None else []
    columns += ["latitude", "longitude", "height"] if origin is not None else []
    with work.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        for track in result.by_track:
            parts = [track.xyz_m, track.velocity_mps, track.sigma_m]
            values = np.concatenate([part for part in parts if part is not None], axis=1)
            places = None if origin is None else to_geodetic(origin, track.xyz_m)
            for i, stamp in enumerate(track.stamp_ns):
                row = [format_stamp_ns(int(stamp)), utc(stamp), track.track_id]
                row += [repr(float(v)) for v in values[i]]
                row += [] if track.support is None else [f"{track.support[i]:g}"]
                row += [] if places is None else place_digits(places[i])
                writer.writerow(row)


def place_digits(place: np.ndarray) -> list[str]:
    """Latitude and longitude to a tenth of a millimetre, height to a millimetre's hundredth."""
    return [f"{place[0]:.10f}", f"{place[1]:.10f}", f"{place[2]:.5f}"]
