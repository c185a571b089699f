"""site.yaml: a station's position, outputs and alarm rules.

The text below a field is its description. Defaults stand here only.
"""

import contextlib
import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar
from uuid import UUID

import numpy as np
from pydantic import AfterValidator, Field, TypeAdapter

from unlidar.checking import NotNegative, checked, read_checked, require
from unlidar.errors import ConfigError, reason
from unlidar.events.event import refuse_constant
from unlidar.geodesy import Origin, from_geodetic
from unlidar.names import check_name
from unlidar.sanitize import is_visible, printable

if TYPE_CHECKING:
    import shapely

_COT_EVERY_S = 1.0
_MOST_NAME = 80
_MOST_ZONES = 10_000
_MOST_FILE_BYTES = 32_000_000
MOST_AWAY_M = 500_000.0  # largest distance of a zone's corner; the flat-earth limit is far below

T = TypeVar("T", "Output", "Tls")


def _node_id(text: str) -> str:
    with contextlib.suppress(ValueError):
        if str(value := UUID(text)) == text and value.version == 4:
            return text
    raise ValueError(f"'{printable(text[:40])}', expected a UUID of version 4 in lower case")


@checked
class Place:
    """Geodetic position of the tracks' origin."""

    latitude_deg: Annotated[float, Field(ge=-90, le=90)]
    longitude_deg: Annotated[float, Field(ge=-360, le=360)]
    height_m: Annotated[float, Field(ge=-100_000, le=100_000)]
    """Above the WGS 84 ellipsoid."""
    heading_deg: Annotated[float, Field(ge=-360, le=360)] = 90.0
    """Compass direction of the x axis; 90: x east, y north."""

    def origin(self) -> Origin:
        """The place as an Origin of geodesy."""
        return Origin(self.latitude_deg, self.longitude_deg, self.height_m, self.heading_deg)


@checked
class Tls:
    """TLS files for the broker of `watch mqtts://`."""

    ca_file: str | None = None
    """Whom to trust; the system's authorities where there is none."""
    certificate_file: str | None = None
    """Who we are, PEM."""
    key_file: str | None = None


@checked
class Output:
    """A receiver of events."""

    to: str
    """cot+udp://, cot+tcp://, cot+tls://, sapient+tcp://, mqtt://, mqtts:// or ws:// with
    HOST:PORT."""
    room: Annotated[int, Field(ge=10, le=1_000_000)] = 10_000
    """So many messages wait while nobody answers; then rows are left out, the oldest first."""
    every_s: NotNegative | None = None
    """A track is told at most so often: by Cursor on Target every 1 s; by SAPIENT as often as the
    standard's middleware takes it. The other outputs tell everything."""
    node_id: Annotated[str, AfterValidator(_node_id)] | None = None
    """SAPIENT: a UUID of version 4; one of station and computer where there is none."""
    ca_file: str | None = None
    """TLS: whom to trust; the system's authorities where there is none."""
    certificate_file: str | None = None
    """TLS: who we are, PEM."""
    key_file: str | None = None

    def interval_s(self, scheme: str) -> float:
        """`every_s`, or its default for an address of this scheme."""
        default_s = _COT_EVERY_S if scheme.startswith("cot") else 0.0
        return default_s if self.every_s is None else self.every_s


@checked
class Rule:
    """Raises an alarm for each track that dwells in a zone."""

    zones: str
    """GeoJSON file; every polygon in it is a zone."""
    min_probability: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Of being a drone, where the engine tells one; else a track counts as 1. 0: any track."""
    min_stay_s: NotNegative = 2.0


@checked
class Site:
    """The whole file."""

    station: Annotated[str, AfterValidator(check_name)] = "station"
    """Its name in everything that is sent."""
    origin: Place | None = None
    outputs: tuple[Output, ...] = ()
    rules: tuple[Rule, ...] = ()
    tls: Tls = Tls()

    def __post_init__(self) -> None:
        require(
            self.origin is not None or not self.rules,
            "rules: need 'origin', as zones are on the globe",
        )


_SITE = TypeAdapter(Site)


class Zone:
    """A prism: a polygon in the station's frame in m, with lower and upper height."""

    def __init__(self, name: str, rule: Rule, polygon: object, low_m: float, high_m: float):
        import shapely

        shapely.prepare(polygon)
        self.name, self.rule = name, rule
        self.polygon = polygon
        self.low_m, self.high_m = low_m, high_m

    def holds(self, x_m: float, y_m: float, z_m: float) -> bool:
        """True if a position is in the zone, surface included."""
        import shapely

        return self.low_m <= z_m <= self.high_m and bool(
            shapely.intersects_xy(self.polygon, x_m, y_m)
        )


def load_site(path: Path) -> Site:
    """The validated file; paths in it are relative to its folder. ConfigError with one line."""
    site = read_checked(path, _SITE)
    rules = tuple(replace(rule, zones=str(path.parent / rule.zones)) for rule in site.rules)
    return replace(
        site,
        outputs=tuple(_beside(path, output) for output in site.outputs),
        rules=rules,
        tls=_beside(path, site.tls),
    )


def _beside(path: Path, files: T) -> T:
    """Resolves the TLS files relative to the folder of `path`."""
    keys = "ca_file", "certificate_file", "key_file"
    found = {key: getattr(files, key) for key in keys}
    return replace(files, **{k: str(path.parent / v) for k, v in found.items() if v is not None})


class Zones:
    """A set of zones with a spatial index."""

    def __init__(self, zones: Sequence[Zone]) -> None:
        self._zones = list(zones)
        if zones:
            import shapely

            self._tree = shapely.STRtree([zone.polygon for zone in zones])

    def around(self, x_m: float, y_m: float, z_m: float) -> list[Zone]:
        """The zones that hold a position, in their order."""
        import shapely

        if not self._zones:
            return []
        near = sorted(self._tree.query(shapely.Point(x_m, y_m)))  # candidates by bounding box
        return [zone for zone in map(self._zones.__getitem__, near) if zone.holds(x_m, y_m, z_m)]


def load_zones(site: Site) -> list[Zone]:
    """The zones of all rules. ConfigError naming the file and the feature."""
    if site.origin is None:
        return []
    zones = [
        zone for rule in site.rules for zone in _read_zones(Path(rule.zones), rule, site.origin)
    ]
    if len(zones) > _MOST_ZONES:
        raise ConfigError(f"rules: {len(zones)} zones, expected at most {_MOST_ZONES}")
    names = Counter(zone.name for zone in zones)
    for name, count in names.items():
        if count > 1:
            raise ConfigError(f"rules: two zones have the name '{printable(name)}'")
    return zones


def _read_zones(path: Path, rule: Rule, place: Place) -> list[Zone]:
    import shapely

    try:
        if path.stat().st_size > _MOST_FILE_BYTES:
            raise ConfigError(f"{path}: is larger than {_MOST_FILE_BYTES / 1e6:g} MB")
        data = json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse_constant)
    except (OSError, ValueError, RecursionError) as error:
        raise ConfigError(f"{path}: cannot be read as GeoJSON: {reason(error)}") from error
    kind = data.get("type") if isinstance(data, dict) else None
    features = data.get("features") if kind == "FeatureCollection" else [data]
    if kind not in ("FeatureCollection", "Feature") or not isinstance(features, list):
        raise ConfigError(f"{path}: expected a GeoJSON FeatureCollection or Feature")
    if not _is_geographic(data.get("crs")):
        raise ConfigError(f"{path}: crs: expected none, as coordinates are longitude, latitude")
    zones = []
    for i, feature in enumerate(features):
        try:
            zones.append(_zone(feature, i, path, rule, place))
        except (
            ValueError,
            TypeError,
            KeyError,
            OverflowError,
            shapely.errors.ShapelyError,
        ) as error:
            raise ConfigError(f"{path}: features[{i}]: {reason(error)[:200]}") from error
    if not zones:
        raise ConfigError(f"{path}: holds no feature, expected at least one polygon")
    return zones


def _is_geographic(crs: object) -> bool:
    """True if the `crs` member (GeoJSON before 2016) is absent or WGS 84."""
    properties = crs.get("properties") if isinstance(crs, dict) else None
    name = properties.get("name") if isinstance(properties, dict) else None
    return crs is None or (isinstance(name, str) and name.endswith(("CRS84", ":4326")))


def _zone(feature: dict, number: int, path: Path, rule: Rule, place: Place) -> Zone:
    import shapely

    require(isinstance(feature, dict), "expected a GeoJSON Feature")
    geometry = feature.get("geometry")
    properties = feature.get("properties")
    properties = {} if properties is None else properties
    require(isinstance(properties, dict), "properties: expected names with values")
    kind = geometry.get("type") if isinstance(geometry, dict) else None
    require(
        kind in ("Polygon", "MultiPolygon"),
        f"geometry is '{kind}', expected a Polygon or MultiPolygon",
    )
    parts = geometry.get("coordinates")
    parts = [parts] if kind == "Polygon" else parts
    require(isinstance(parts, list) and len(parts) > 0, "geometry is empty")
    polygon = shapely.union_all([_polygon(part, place.origin()) for part in parts])
    name = properties.get("name", f"{path.stem}_{number + 1}"[:_MOST_NAME])
    require(
        isinstance(name, str) and len(name) <= _MOST_NAME and is_visible(name),
        f"name: expected a text of at most {_MOST_NAME} characters that can be seen",
    )
    low_m, high_m = (
        _height(properties, key, default)
        for key, default in (("min_height_m", -np.inf), ("max_height_m", np.inf))
    )
    require(low_m < high_m, "min_height_m is not below max_height_m")
    return Zone(name, rule, polygon, low_m, high_m)


def _polygon(rings: object, origin: Origin) -> "shapely.Polygon":
    """The polygon in the station's frame in m."""
    import shapely

    require(isinstance(rings, list) and len(rings) > 0, "geometry is empty")
    shell, *holes = (_ring(ring, origin) for ring in rings)
    polygon = shapely.Polygon(shell, holes)
    require(bool(shapely.is_valid(polygon)), f"{shapely.is_valid_reason(polygon)}")
    require(polygon.area > 0, "a polygon has no area")
    return polygon


def _ring(ring: object, origin: Origin) -> np.ndarray:
    """The ring (N, 2) in the station's frame in m."""
    require(isinstance(ring, list) and len(ring) > 0, "geometry is empty")
    for position in ring:
        require(
            isinstance(position, list)
            and len(position) >= 2
            and all(type(value) in (int, float) for value in position[:2]),
            f"coordinates: '{printable(str(position)[:40])}', expected numbers",
        )
    degrees = np.array([position[:2] for position in ring], dtype=float)
    require(bool((np.abs(degrees) <= (360, 90)).all()), "coordinates are not longitude, latitude")
    require(len(ring) >= 4 and bool((degrees[0] == degrees[-1]).all()), "a ring is not closed")
    places = np.column_stack([degrees[:, ::-1], np.full(len(degrees), origin.height_m)])
    metres = from_geodetic(origin, places)
    far_m = float(np.linalg.norm(metres, axis=1).max())
    require(
        far_m <= MOST_AWAY_M,
        f"reaches {far_m / 1e3:.0f} km from the station, expected at most "
        f"{MOST_AWAY_M / 1e3:g}: longitude comes before latitude",
    )
    return metres[:, :2]


def _height(properties: dict, key: str, default: float) -> float:
    value = properties.get(key)
    if value is None:
        return default
    require(
        isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= 1e6,
        f"{key}: '{printable(str(value)[:40])}', expected a number of metres above the station's "
        "origin",
    )
    return float(value)
