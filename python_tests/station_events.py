"""Events as the engine writes them, a site around them, and ports that are free."""

from __future__ import annotations

import base64
import json
import socket
from collections.abc import Callable
from pathlib import Path

import numpy as np
from unlidar.events.event import decode
from unlidar.stamps import format_stamp_ns

BEGIN_NS = 1_706_301_000_123_456_789
ORIGIN = {"latitude_deg": 47.0, "longitude_deg": 8.0, "height_m": 500.0, "heading_deg": 90.0}


def stamp(seconds: float) -> str:
    return format_stamp_ns(BEGIN_NS + round(seconds * 1e9))


def track(number: int, at: float = 0.0, **more) -> str:
    return _line("track", at, {"track": number}, {"first_evidence": at - 1.0}, more)


def row(
    number: int, at: float, xyz=(0.0, 0.0, 20.0), velocity=(1.0, 0.0, 0.0), late=False, **more
) -> str:
    values = dict(zip(("x", "y", "z", "vx", "vy", "vz"), (*xyz, *velocity), strict=True))
    values |= {"sigma_x": 0.05, "sigma_y": 0.07, "sigma_z": 0.09, "support": 9, "late": late}
    return _line("row", at + 0.9, {"track": number}, {"timestamp": at}, values | more)


def now(number: int, at: float, xyz=(0.0, 0.0, 20.0), velocity=(1.0, 0.0, 0.0), **more) -> str:
    values = dict(zip(("x", "y", "z", "vx", "vy", "vz"), (*xyz, *velocity), strict=True))
    values |= {"sigma_x": 0.1, "sigma_y": 0.2, "sigma_z": 0.3, "unseen_s": 0.0}
    return _line("now", at, {"track": number}, {"timestamp": at}, values | more)


def end(number: int, at: float) -> str:
    return _line("end", at, {"track": number}, {"timestamp": at - 10.0}, {})


def sensor(name: str, state: str, at: float = 0.0, **more: object) -> str:
    return _line("sensor", at, {"name": name, "state": state}, {}, more)


def state(name: str, at: float = 0.0, frames: int = 1, dropped: int = 0) -> str:
    return _line("state", at, {"state": name, "frames": frames, "dropped": dropped}, {}, {})


def returns(name: str, at: float, points_m, step_m: float = 0.01) -> str:
    steps = np.round(np.asarray(points_m, float).reshape(-1, 3) / step_m).astype("<i2")
    values = {"step_m": step_m, "xyz": base64.b64encode(steps.tobytes()).decode()}
    return _line("returns", at, {"name": name}, {"timestamp": at}, values)


def _line(event: str, at: float, first: dict, times: dict, more: dict) -> str:
    parts = [f'"event":"{event}"', f'"at":{stamp(at)}']
    parts += [f'"{key}":{json.dumps(value)}' for key, value in first.items()]
    parts += [f'"{key}":{stamp(value)}' for key, value in times.items()]
    parts += [f'"{key}":{json.dumps(value)}' for key, value in more.items()]
    line = "{" + ",".join(parts) + "}"
    decode(line)
    return line


def square(half_m: float, name: str | None = None, **properties) -> dict:
    """A GeoJSON feature about the origin of `ORIGIN`, small enough for a flat earth."""
    metres_north, metres_east = 111_170.0, 76_060.0  # a degree's, at 47 degrees north
    corners = [(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)]
    ring = [
        [
            ORIGIN["longitude_deg"] + x * half_m / metres_east,
            ORIGIN["latitude_deg"] + y * half_m / metres_north,
        ]
        for x, y in corners
    ]
    if name is not None:
        properties["name"] = name
    geometry = {"type": "Polygon", "coordinates": [ring]}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def write_site(folder: Path, features: list[dict] | None = None, **more) -> Path:
    site = {"station": "north", "origin": ORIGIN} | more
    if features is not None:
        collection = {"type": "FeatureCollection", "features": features}
        (folder / "zones.geojson").write_text(json.dumps(collection))
        site.setdefault("rules", [{"zones": "zones.geojson"}])
    path = folder / "site.yaml"
    path.write_text(json.dumps(site))  # JSON is YAML
    return path


def free_port(kind: int = socket.SOCK_STREAM) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def appended(path: Path) -> Callable[[str], None]:
    def append(*lines: str) -> None:
        with path.open("a") as file:
            file.write("".join(line + "\n" for line in lines))

    return append
