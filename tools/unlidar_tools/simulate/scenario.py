"""A scenario: what a simulated recording shows, read from YAML. Defaults stand here only."""

import dataclasses
import itertools
import math
import types
import typing
from dataclasses import dataclass, field
from pathlib import Path

from ruamel.yaml import YAML, YAMLError

from unlidar_tools.configs import SCENARIO_DIR, scenario_names
from unlidar_tools.errors import ConfigError, UsageError, reason
from unlidar_tools.simulate.sensors import MODELS

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Sensor:
    """A LiDAR of the station. Its frames are in its own place and clock, axes as the station's."""

    model: str
    position_m: Vector = (0.0, 0.0, 0.0)
    start_s: float = 0.0  # its first frame begins this long after the scenario
    time_offset_s: float = 0.0  # true time minus the stamps of its clock, as far as it is known
    clock_error_s: float = 0.0  # and the rest, of which the program is not told
    stray_returns: float = 2.0  # mean number a frame: dust, cross-talk

    def __post_init__(self) -> None:
        _require(self.model in MODELS, f"model '{self.model}', expected one of {list(MODELS)}")
        _require(self.stray_returns >= 0, "stray_returns must not be negative")
        _require(0 <= self.start_s < 1, "start_s must lie in [0, 1)")


@dataclass(frozen=True)
class Flight:
    """A path with continuous acceleration: through waypoints, or a random one that stays in a box.

    On a random flight the speed never exceeds max_speed_mps, and the drone hovers in hover_s.
    Waypoints are passed through, or rested at: then the way between two is straight, and two at the
    same place are a hover.
    """

    box_m: tuple[Vector, Vector] | None = None  # lowest and highest corner
    max_speed_mps: float = 5.0
    turn_s: float = 2.0  # time between two changes of course
    hover_s: tuple[tuple[float, float], ...] = ()
    waypoints: tuple[tuple[float, float, float, float], ...] = ()  # time_s, x, y, z
    rest_at_waypoints: bool = False
    spread_m: float = 0.0  # waypoints are moved at random by up to this along each axis

    def __post_init__(self) -> None:
        _require((self.box_m is None) != (not self.waypoints), "needs either box_m or waypoints")
        if self.box_m is not None:
            low, high = self.box_m
            _require(
                all(a <= b for a, b in zip(low, high, strict=True)),
                "box_m must be [lowest corner, highest corner]",
            )
        times = [w[0] for w in self.waypoints]
        _require(
            all(a < b for a, b in itertools.pairwise(times)),
            "the times of waypoints must ascend",
        )
        _require(len(times) != 1, "needs at least two waypoints")
        _require(self.spread_m >= 0, "spread_m must not be negative")
        _require(self.max_speed_mps > 0 and self.turn_s > 0, "speed and turn_s must be positive")
        _require(all(a < b for a, b in self.hover_s), "hover_s holds [begin, end] pairs")


@dataclass(frozen=True)
class Drone:
    """A flying ellipsoid with holes: a share `fill` of the rays that meet its outline hit it."""

    flight: Flight
    size_m: Vector = (0.45, 0.45, 0.2)
    fill: float = 0.55
    reflectivity: float = 0.2

    def __post_init__(self) -> None:
        _require(min(self.size_m) > 0, "size_m must be positive")
        _require(0 < self.fill <= 1, "fill must lie in (0, 1]")
        _require(0 < self.reflectivity <= 1, "reflectivity must lie in (0, 1]")


@dataclass(frozen=True)
class Building:
    """A box that stands on the ground."""

    centre_m: tuple[float, float]
    size_m: Vector
    yaw_deg: float = 0.0

    def __post_init__(self) -> None:
        _require(min(self.size_m) > 0, "size_m must be positive")


@dataclass(frozen=True)
class Scene:
    """The surroundings: ground, the buildings listed, and random things around the station."""

    ground_z_m: float = -1.8
    radius_m: float = 60.0  # random things stand within this
    clear_m: float = 8.0  # and no nearer than this
    buildings: tuple[Building, ...] = ()
    random_buildings: int = 3
    poles: int = 6
    trees: int = 12
    sway_m: float = 0.0  # crowns swing to and fro by this
    walkers: int = 0
    cars: int = 0  # each passes once
    birds: int = 0  # smaller than 0.4 m; no drones: what is reported of them is false
    insects: int = 0  # within some metres of the station
    rain_returns: float = 0.0  # mean number a frame and sensor, most of them near

    def __post_init__(self) -> None:
        _require(0 < self.clear_m < self.radius_m, "needs 0 < clear_m < radius_m")
        counts = (self.random_buildings, self.poles, self.trees)
        movers = (self.walkers, self.cars, self.birds, self.insects)
        _require(min(*counts, *movers) >= 0, "numbers of things must not be negative")
        _require(
            self.sway_m >= 0 and self.rain_returns >= 0,
            "sway_m and rain_returns must not be negative",
        )


@dataclass(frozen=True)
class Scenario:
    """A recording to be simulated."""

    sensors: dict[str, Sensor]
    drones: tuple[Drone, ...] = ()
    scene: Scene = field(default_factory=Scene)
    duration_s: float = 12.0
    start_time_s: int = 1_700_000_000  # Unix time of the first ray
    point_times: bool = False  # write the field `t`, ns after the stamp of the frame

    def __post_init__(self) -> None:
        _require(bool(self.sensors), "needs at least one sensor")
        _require(0 < self.duration_s <= 3600, "duration_s must lie in (0, 3600]")
        _require(self.start_time_s >= 0, "start_time_s must not be negative")


def load_scenario(name_or_path: str) -> Scenario:
    """A scenario file, or one of the scenarios that come along, by its name."""
    path = Path(name_or_path)
    if path.suffix not in (".yaml", ".yml"):
        path = SCENARIO_DIR / f"{name_or_path}.yaml"
        if not path.is_file():
            known = ", ".join(scenario_names())
            raise UsageError(
                f"no scenario '{name_or_path}', expected a .yaml file or one of {known}"
            )
    try:
        data = YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, YAMLError) as error:
        raise ConfigError(f"{path}: cannot be read as YAML: {reason(error)}") from error
    try:
        return _build(Scenario, data, "")
    except ValueError as error:
        raise ConfigError(f"{path}: {error}") from error


def _require(holds: bool, message: str) -> None:
    if not holds:
        raise ValueError(message)


def _build(kind: typing.Any, value: typing.Any, where: str) -> typing.Any:
    """`value` as the annotated type `kind`. ValueError names the key and what was expected."""
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if dataclasses.is_dataclass(kind):
        return _build_dataclass(kind, value, where)
    if origin is types.UnionType:
        return None if value is None else _build(arguments[0], value, where)
    if origin is dict:
        _require(isinstance(value, dict), f"{where}: expected names with values")
        return {str(k): _build(arguments[1], v, f"{where}.{k}") for k, v in value.items()}
    if origin is tuple:
        _require(isinstance(value, list), f"{where}: expected a list")
        if arguments[-1] is Ellipsis:
            kinds = (arguments[0],) * len(value)
        else:
            kinds = arguments
            _require(len(value) == len(kinds), f"{where}: expected {len(kinds)} values")
        items = zip(kinds, value, strict=True)
        return tuple(_build(k, v, f"{where}[{i}]") for i, (k, v) in enumerate(items))
    return _build_scalar(kind, value, where)


def _build_dataclass(kind: typing.Any, value: typing.Any, where: str) -> typing.Any:
    here = f"{where}: " if where else ""
    _require(isinstance(value, dict), f"{here}expected keys with values")
    hints = typing.get_type_hints(kind)
    known = [f.name for f in dataclasses.fields(kind)]
    for key in value:
        _require(key in known, f"{here}unknown key '{key}', expected one of {', '.join(known)}")
    for f in dataclasses.fields(kind):
        no_default = f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING
        _require(not no_default or f.name in value, f"{here}key '{f.name}' is missing")
    prefix = f"{where}." if where else ""
    built = {key: _build(hints[key], v, f"{prefix}{key}") for key, v in value.items()}
    try:
        return kind(**built)
    except ValueError as error:
        raise ValueError(f"{here}{error}") from error


def _build_scalar(kind: typing.Any, value: typing.Any, where: str) -> typing.Any:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if kind is float and is_number and math.isfinite(value):
        return float(value)
    if kind is not float and type(value) is kind:
        return value
    expected = {float: "a number", int: "a whole number", bool: "true or false", str: "a text"}
    raise ValueError(f"{where}: '{value}', expected {expected[kind]}")
