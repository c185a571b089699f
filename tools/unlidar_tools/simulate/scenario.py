"""A scenario: what a simulated recording shows, read from YAML. Defaults stand here only.

The text below a field is its description in configs/scenarios/schema.json, which editors show.
"""

import itertools
import json
from collections.abc import Sequence
from dataclasses import field
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, ConfigDict, Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass
from pydantic.json_schema import GenerateJsonSchema
from ruamel.yaml import YAML, YAMLError

from unlidar_tools.configs import SCENARIO_DIR, scenario_names
from unlidar_tools.errors import ConfigError, UsageError, reason
from unlidar_tools.names import check_name
from unlidar_tools.simulate.sensors import MODELS

# Strict: a text is no number, 1.5 no whole one.
_CONFIG = ConfigDict(
    extra="forbid", strict=True, allow_inf_nan=False, use_attribute_docstrings=True
)
_checked = dataclass(frozen=True, config=_CONFIG)

Vector = tuple[float, float, float]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(gt=0, le=1)]
Count = Annotated[int, Field(ge=0)]
Size = tuple[Positive, Positive, Positive]


@_checked
class Sensor:
    """A LiDAR of the station. Its frames are in its own place and clock, axes as the station's."""

    model: Annotated[str, Field(json_schema_extra={"enum": list(MODELS)})]
    position_m: Vector = (0.0, 0.0, 0.0)
    start_s: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """Its first frame begins this long after the scenario."""
    time_offset_s: float = 0.0
    """True time minus the stamps of its clock, as far as it is known."""
    clock_error_s: float = 0.0
    """And the rest, of which the program is not told."""
    stray_returns: NotNegative = 2.0
    """Mean number a frame: dust, cross-talk."""

    def __post_init__(self) -> None:
        _require(self.model in MODELS, f"model '{self.model}', expected one of {list(MODELS)}")


@_checked
class Flight:
    """A path with continuous acceleration: through waypoints, or a random one that stays in a box.

    On a random flight the speed never exceeds max_speed_mps, and the drone hovers in hover_s.
    Waypoints are passed through, or rested at: then the way between two is straight, and two at the
    same place are a hover.
    """

    box_m: tuple[Vector, Vector] | None = None
    """Lowest and highest corner."""
    max_speed_mps: Positive = 5.0
    turn_s: Positive = 2.0
    """Time between two changes of course."""
    hover_s: tuple[tuple[float, float], ...] = ()
    """[begin, end] of each hover."""
    waypoints: tuple[tuple[float, float, float, float], ...] = ()
    """time_s, x, y, z of each."""
    rest_at_waypoints: bool = False
    spread_m: NotNegative = 0.0
    """Waypoints are moved at random by up to this along each axis."""

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
        _require(all(a < b for a, b in self.hover_s), "hover_s holds [begin, end] pairs")


@_checked
class Drone:
    """A flying ellipsoid with holes: a share `fill` of the rays that meet its outline hit it."""

    flight: Flight
    size_m: Size = (0.45, 0.45, 0.2)
    fill: Share = 0.55
    reflectivity: Share = 0.2


@_checked
class Building:
    """A box that stands on the ground."""

    centre_m: tuple[float, float]
    size_m: Size
    yaw_deg: float = 0.0


@_checked
class Scene:
    """The surroundings: ground, the buildings listed, and random things around the station."""

    ground_z_m: float = -1.8
    radius_m: float = 60.0
    """Random things stand within this."""
    clear_m: Positive = 8.0
    """And no nearer than this."""
    buildings: tuple[Building, ...] = ()
    random_buildings: Count = 3
    poles: Count = 6
    trees: Count = 12
    sway_m: NotNegative = 0.0
    """Crowns swing to and fro by this."""
    walkers: Count = 0
    cars: Count = 0
    """Each passes once."""
    birds: Count = 0
    """Smaller than 0.4 m; no drones: what is reported of them is false."""
    insects: Count = 0
    """Within some metres of the station."""
    rain_returns: NotNegative = 0.0
    """Mean number a frame and sensor, most of them near."""

    def __post_init__(self) -> None:
        _require(self.clear_m < self.radius_m, "needs clear_m < radius_m")


@_checked
class Scenario:
    """A recording to be simulated."""

    sensors: dict[Annotated[str, AfterValidator(check_name)], Sensor]
    """By names, which become those of folders."""
    drones: tuple[Drone, ...] = ()
    scene: Scene = field(default_factory=Scene)
    duration_s: Annotated[float, Field(gt=0, le=3600)] = 12.0
    start_time_s: Annotated[int, Field(ge=0, le=9_000_000_000)] = 1_700_000_000
    """Unix time of the first ray."""
    point_times: bool = False
    """Write the field `t`, ns after the stamp of the frame."""

    def __post_init__(self) -> None:
        _require(bool(self.sensors), "needs at least one sensor")


_SCENARIO = TypeAdapter(Scenario)


class _Untitled(GenerateJsonSchema):
    """Without titles, which would but repeat the keys."""

    def field_title_should_be_set(self, _schema: object) -> bool:
        return False


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
    except (OSError, ValueError, RecursionError, YAMLError) as error:
        raise ConfigError(f"{path}: cannot be read as YAML: {reason(error)}") from error
    try:
        # By way of JSON, whose arrays are tuples to a strict check and whose keys are texts.
        return _SCENARIO.validate_json(json.dumps(data, default=str))
    except ValidationError as error:
        raise ConfigError(f"{path}: {_first(error)}") from error
    except (TypeError, ValueError, RecursionError) as error:
        raise ConfigError(f"{path}: expected keys with values: {reason(error)}") from error


def schema() -> dict:
    """The JSON schema of scenarios, by which editors complete and check them."""
    return _SCENARIO.json_schema(schema_generator=_Untitled)


def _require(holds: bool, message: str) -> None:
    if not holds:
        raise ValueError(message)


# What pydantic calls a fault -> what was expected.
_EXPECTED = {
    "float_type": "a number",
    "finite_number": "a number",
    "int_type": "a whole number",
    "bool_type": "true or false",
    "string_type": "a text",
    "tuple_type": "a list",
    "dict_type": "names with values",
    "dataclass_type": "keys with values",
    "greater_than": "a number above {gt:g}",
    "greater_than_equal": "a number from {ge:g} on",
    "less_than": "a number below {lt:g}",
    "less_than_equal": "a number up to {le:g}",
    "too_long": "{max_length} values",
}
_UNKNOWN = "unexpected_keyword_argument"


def _first(error: ValidationError) -> str:
    """The first fault on one line: the key, its value and what was expected."""
    found = error.errors(include_url=False)
    # An unknown key may be the reason why another one is missing.
    fault = next((f for f in found if f["type"] == _UNKNOWN), found[0])
    kind, value = fault["type"], fault["input"]
    *parents, last = fault["loc"] or ("",)
    if kind == _UNKNOWN:
        known = ", ".join(_keys_of(parents))
        return f"{_spell(parents)}unknown key '{last}', expected one of {known}"
    if kind == "missing" and isinstance(last, str):
        return f"{_spell(parents)}key '{last}' is missing"
    if kind == "missing":
        return f"{_spell(parents)}'{value}', expected at least {last + 1} values"
    if kind == "value_error":
        named = parents[:-1] if last == "[key]" else fault["loc"]
        return f"{_spell(named)}{fault['ctx']['error']}"
    expected = _EXPECTED[kind].format(**fault.get("ctx", {})) if kind in _EXPECTED else fault["msg"]
    shown = "" if isinstance(value, dict | list) or value is None else f"'{value}', "
    return f"{_spell(fault['loc'])}{shown}expected {expected}"


def _spell(where: Sequence[str | int]) -> str:
    """`drones[0].flight: ` of the way to a value, nothing of the whole scenario."""
    text = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in where)
    return f"{text.removeprefix('.')}: " if text else ""


def _keys_of(where: Sequence[str | int]) -> list[str]:
    """The keys that a part of a scenario may have."""
    whole = schema()
    node = whole
    for part in where:
        inner = ("items", "additionalProperties")
        node = node.get("properties", {}).get(part) or next(node[k] for k in inner if k in node)
        node = whole["$defs"][node["$ref"].rpartition("/")[2]] if "$ref" in node else node
    return list(node["properties"])
