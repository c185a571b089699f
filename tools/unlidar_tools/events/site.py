"""site.yaml: where a station stands, whom it tells and when it raises an alarm.

The text below a field is its description. Defaults stand here only.
"""

import json
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field, TypeAdapter

from unlidar_tools.checking import NotNegative, checked, read_checked, require
from unlidar_tools.errors import ConfigError, reason
from unlidar_tools.geodesy import Origin, from_geodetic
from unlidar_tools.names import check_name
from unlidar_tools.printable import printable

_MOST_NAME = 80


@checked
class Place:
    """Where 0, 0, 0 of the tracks is."""

    latitude_deg: Annotated[float, Field(ge=-90, le=90)]
    longitude_deg: Annotated[float, Field(ge=-360, le=360)]
    height_m: float
    """Above the WGS 84 ellipsoid."""
    heading_deg: float = 90.0
    """Compass direction of the x axis; 90: x east, y north."""

    def origin(self) -> Origin:
        """As the functions of geodesy take it."""
        return Origin(self.latitude_deg, self.longitude_deg, self.height_m, self.heading_deg)


@checked
class Output:
    """Somebody who is told."""

    to: str
    """cot+udp://, cot+tcp://, cot+tls://, mqtt://, mqtts:// or ws:// with HOST:PORT."""
    room: Annotated[int, Field(ge=10, le=1_000_000)] = 10_000
    """So many messages wait while nobody answers; then rows are left out, the oldest first."""
    every_s: NotNegative = 1.0
    """Cursor on Target: a track is told at most so often. The other outputs tell every row."""
    ca_file: str | None = None
    """TLS: whom to trust; the system's authorities where there is none."""
    certificate_file: str | None = None
    """TLS: who we are, PEM."""
    key_file: str | None = None


@checked
class Rule:
    """An alarm for each track that stays in a zone."""

    zones: str
    """GeoJSON file; every polygon in it is a zone."""
    min_probability: Annotated[float, Field(ge=0, le=1)] = 0.1
    """Of being a drone, where the engine tells one; else a track counts as 1."""
    min_stay_s: NotNegative = 2.0


@checked
class Site:
    """All of it."""

    station: Annotated[str, AfterValidator(check_name)] = "station"
    """Its name in everything that is sent."""
    origin: Place | None = None
    outputs: tuple[Output, ...] = ()
    rules: tuple[Rule, ...] = ()

    def __post_init__(self) -> None:
        require(
            self.origin is not None or not self.rules,
            "rules: need 'origin', as zones are on the globe",
        )


_SITE = TypeAdapter(Site)


class Zone:
    """A prism: a polygon in the station's metres, with the heights between which it reaches."""

    def __init__(self, name: str, rule: Rule, polygon: object, low_m: float, high_m: float):
        import shapely

        shapely.prepare(polygon)
        self.name, self.rule = name, rule
        self.polygon = polygon
        self.low_m, self.high_m = low_m, high_m

    def holds(self, x_m: float, y_m: float, z_m: float) -> bool:
        """Whether a position is in it; its surface belongs to it."""
        import shapely

        return self.low_m <= z_m <= self.high_m and bool(
            shapely.intersects_xy(self.polygon, x_m, y_m)
        )


def load_site(path: Path) -> Site:
    """Checked; files named in it are taken from its folder. ConfigError with one line."""
    site = read_checked(path, _SITE)
    files = "ca_file", "certificate_file", "key_file"
    outputs = tuple(
        replace(o, **{f: str(path.parent / v) for f in files if (v := getattr(o, f)) is not None})
        for o in site.outputs
    )
    rules = tuple(replace(rule, zones=str(path.parent / rule.zones)) for rule in site.rules)
    return replace(site, outputs=outputs, rules=rules)


def load_zones(site: Site) -> list[Zone]:
    """The zones of all rules. ConfigError naming the file and the feature."""
    if site.origin is None:
        return []
    zones = [
        zone for rule in site.rules for zone in _read_zones(Path(rule.zones), rule, site.origin)
    ]
    names = [zone.name for zone in zones]
    for name in names:
        if names.count(name) > 1:
            raise ConfigError(f"rules: two zones have the name '{printable(name)}'")
    return zones


def _read_zones(path: Path, rule: Rule, place: Place) -> list[Zone]:
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise ConfigError(f"{path}: cannot be read as GeoJSON: {reason(error)}") from error
    kind = data.get("type") if isinstance(data, dict) else None
    features = data.get("features") if kind == "FeatureCollection" else [data]
    if kind not in ("FeatureCollection", "Feature") or not isinstance(features, list):
        raise ConfigError(f"{path}: expected a GeoJSON FeatureCollection or Feature")
    zones = []
    for i, feature in enumerate(features):
        try:
            zones.append(_zone(feature, i, path, rule, place))
        except (ValueError, TypeError, AttributeError, KeyError) as error:
            raise ConfigError(f"{path}: features[{i}]: {reason(error)}") from error
    if not zones:
        raise ConfigError(f"{path}: holds no feature, expected at least one polygon")
    return zones


def _zone(feature: dict, number: int, path: Path, rule: Rule, place: Place) -> Zone:
    import shapely

    geometry = feature.get("geometry") or {}
    require(
        geometry.get("type") in ("Polygon", "MultiPolygon"),
        f"geometry is '{geometry.get('type')}', expected a Polygon or MultiPolygon",
    )
    shape = shapely.from_geojson(json.dumps(geometry))
    degrees = shapely.get_coordinates(shape)
    require(len(degrees) > 0, "geometry is empty")
    require(bool((np.abs(degrees) <= (360, 90)).all()), "coordinates are not longitude, latitude")
    origin = place.origin()
    polygon = shapely.transform(
        shape,
        lambda lonlat: from_geodetic(
            origin, np.column_stack([lonlat[:, ::-1], np.full(len(lonlat), origin.height_m)])
        )[:, :2],
    )
    require(bool(shapely.is_valid(polygon)), f"{shapely.is_valid_reason(polygon)}")
    properties = feature.get("properties") or {}
    low_m, high_m = (
        _height(properties, key, default)
        for key, default in (("min_height_m", -np.inf), ("max_height_m", np.inf))
    )
    require(low_m < high_m, "min_height_m is not below max_height_m")
    name = properties.get("name", f"{path.stem}_{number + 1}")
    require(
        isinstance(name, str) and 0 < len(name) <= _MOST_NAME,
        f"name: expected a text of at most {_MOST_NAME} characters",
    )
    return Zone(name, rule, polygon, low_m, high_m)


def _height(properties: dict, key: str, default: float) -> float:
    value = properties.get(key)
    if value is None:
        return default
    require(
        isinstance(value, int | float) and not isinstance(value, bool) and np.isfinite(value),
        f"{key}: '{value}', expected a number of metres above the station's origin",
    )
    return float(value)
