"""The log of COURAGEOUS (CEN CWA 18150), by which tests of counter-drone systems are judged."""

import json
from pathlib import Path

import numpy as np

from unlidar.export.trajectory import Kind, Result, Track
from unlidar.geodesy import Origin, to_east_north_up, to_geodetic
from unlidar.geoid import GRID_NAME, find_geoid_grid, geoid_height_m
from unlidar.output import write_file
from unlidar.reporting import note

_VERSION = "0.4.1"  # of the format
_SYSTEM, _VENDOR = "unlidar_track", "unlidar_track"
_MORE_LIKELY_THAN_NOT = 0.5
_DEGREE_DIGITS, _METRE_DIGITS = 10, 5  # 0.02 mm


def write_courageous(
    result: Result, out: Path, origin: Origin, geoid_m: float | None
) -> list[Path]:
    """One JSON document: a track each, a record for each row, in order of time.

    Heights are above the geoid EGM96, which is taken as level around the station.
    """
    geoid_m = _geoid_m(origin) if geoid_m is None else geoid_m
    number = 0
    tracks = []
    for track in result.by_track:
        tracks.append(_track(track, result.kinds.get(track.track_id), origin, geoid_m, number))
        number += len(track)
    station = np.array([origin.latitude_deg, origin.longitude_deg, origin.height_m])
    log = {
        "version": _VERSION,
        "vendor_name": _VENDOR,
        "system_name": _SYSTEM,
        "static_cuas_location": _position(station, geoid_m),
        "detection": [],  # of what is not tracked; every row is of a track
        "tracks": tracks,
    }
    text = json.dumps(log, indent=1) + "\n"
    write_file(out, lambda work: work.write_text(text))
    return [out]


def _geoid_m(origin: Origin) -> float:
    grid = find_geoid_grid()
    if grid is not None:
        return geoid_height_m(grid, origin.latitude_deg, origin.longitude_deg)
    note(
        f"{GRID_NAME} of PROJ was not found (Debian: proj-data) and --geoid is not given: "
        "height_amsl is above the ellipsoid, not above the sea"
    )
    return 0.0


def _track(track: Track, kind: Kind | None, origin: Origin, geoid_m: float, first: int) -> dict:
    places = to_geodetic(origin, track.xyz_m)
    velocity = track.velocity_mps
    enu_mps = None if velocity is None else to_east_north_up(origin, velocity).tolist()
    # Without a kind a track counts as a drone, as for the alarms of a station.
    alarm = {"active": True, "certainty": 1.0 if kind is None else kind.drone}
    records = []
    for i, stamp_ns in enumerate(track.stamp_ns.tolist()):
        record = {
            "record_number": first + i,
            "time": (stamp_ns + 500_000) // 1_000_000,
            "classification": _classification(kind),
            "alarm": alarm,
            "location": {"$type": "Position3d"} | _position(places[i], geoid_m),
        }
        if enu_mps is not None:
            record["velocity"] = dict(zip(("east", "north", "up"), enu_mps[i], strict=True))
        records.append(record)
    name = f"track {track.track_id}"
    return {"name": name, "uas_id": track.track_id, "records": records}


def _classification(kind: Kind | None) -> str:
    if kind is not None and kind.drone > _MORE_LIKELY_THAN_NOT:
        return "UAV"
    if kind is not None and kind.bird_like > _MORE_LIKELY_THAN_NOT:
        return "Other"
    return "Unknown"


def _position(place: np.ndarray, geoid_m: float) -> dict:
    return {
        "lat": round(float(place[0]), _DEGREE_DIGITS),
        "lon": round(float(place[1]), _DEGREE_DIGITS),
        "height_amsl": round(float(place[2]) - geoid_m, _METRE_DIGITS),
    }
