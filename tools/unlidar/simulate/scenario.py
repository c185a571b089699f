"""A scenario: what a simulated recording shows, read from YAML. Defaults stand here only.

The text below a field is its description in configs/scenarios/schema.json, which editors show.
"""

import itertools
from dataclasses import field
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, Field, TypeAdapter

from unlidar.checking import (
    NotNegative,
    Positive,
    checked,
    read_checked,
    require,
    schema_of,
)
from unlidar.configs import SCENARIO_DIR, scenario_names
from unlidar.errors import UsageError, listed
from unlidar.names import check_name
from unlidar.simulate.sensors import MODELS

Vector = tuple[float, float, float]
Share = Annotated[float, Field(gt=0, le=1)]
Count = Annotated[int, Field(ge=0)]
Size = tuple[Positive, Positive, Positive]


@checked
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
    """Mean number a frame, even in range and direction: dust, cross-talk; hundreds: a low sun."""
    window_dirt: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Share of the directions in which dirt or water on its window lets little through."""
    window_returns: NotNegative = 0.0
    """Mean number a frame of rays that return from within a metre if they meet the dirt."""
    on_carrier: bool = True
    """Where there is a carrier: borne by it, `position_m` its place on it; else at rest."""

    def __post_init__(self) -> None:
        require(self.model in MODELS, f"model '{self.model}', expected one of {list(MODELS)}")


@checked
class Carrier:
    """What bears LiDARs and moves: a gimbal, a mast, a vehicle, a drone. All motions add up."""

    start_m: Vector = (0.0, 0.0, 0.0)
    """Its place in the world at the start."""
    velocity_mps: Vector = (0.0, 0.0, 0.0)
    pan_dps: float = 0.0
    """Turns to the left about its upright axis by this many degrees a second."""
    drift_m: NotNegative = 0.0
    """Wanders slowly along each axis, by up to this to either side."""
    sway_deg: NotNegative = 0.0
    """Tilts to and fro by up to this."""
    sway_hz: Positive = 0.4
    mast_m: NotNegative = 0.0
    """Tilts about a foot this far below."""
    pose_rate_hz: Positive = 100.0
    """Of the poses written beside the frames."""
    pose_noise_m: NotNegative = 0.02
    """Standard deviation of their error along each axis."""
    pose_noise_deg: NotNegative = 0.05
    """And about each axis."""


@checked
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
        require((self.box_m is None) != (not self.waypoints), "needs either box_m or waypoints")
        if self.box_m is not None:
            low, high = self.box_m
            require(
                all(a <= b for a, b in zip(low, high, strict=True)),
                "box_m must be [lowest corner, highest corner]",
            )
        times = [w[0] for w in self.waypoints]
        require(
            all(a < b for a, b in itertools.pairwise(times)),
            "the times of waypoints must ascend",
        )
        require(len(times) != 1, "needs at least two waypoints")
        require(all(a < b for a, b in self.hover_s), "hover_s holds [begin, end] pairs")


@checked
class Drone:
    """A flying ellipsoid with holes: a share `fill` of the rays that meet its outline hit it."""

    flight: Flight
    size_m: Size = (0.45, 0.45, 0.2)
    fill: Share = 0.55
    reflectivity: Share = 0.2


@checked
class Building:
    """A box that stands on the ground."""

    centre_m: tuple[float, float]
    size_m: Size
    yaw_deg: float = 0.0


@checked
class Fog:
    """Returns near the sensor, the farther the fewer, and weaker echoes behind it."""

    returns: NotNegative
    """Mean number a frame and sensor."""
    visibility_m: Positive = 100.0
    """Meteorological: a tenth of it is the mean range of the returns."""


@checked
class Scene:
    """The surroundings: ground, the buildings listed, and random things around the station."""

    ground_z_m: float = -1.8
    radius_m: float = 60.0
    """Random things stand within this."""
    clear_m: Positive = 8.0
    """And no nearer than this."""
    along_m: NotNegative = 0.0
    """Random buildings, poles, trees, flags and chimneys stand beside this much of the x axis."""
    buildings: tuple[Building, ...] = ()
    random_buildings: Count = 3
    poles: Count = 6
    trees: Count = 12
    sway_m: NotNegative = 0.0
    """Crowns, and things on cables, swing to and fro by this."""
    walkers: Count = 0
    cars: Count = 0
    """Each passes once."""
    gantries: Count = 0
    """Signs hang in a row under a beam on two poles. All may reach beyond the field of view."""
    cables: Count = 0
    """From pole to pole, with things on them."""
    flags: Count = 0
    """On poles; they wave and turn with the wind."""
    steam: Count = 0
    """Puffs rise from a chimney, drift, grow and thin out."""
    birds: Count = 0
    """Smaller than 0.4 m; no drones: what is reported of them is false."""
    insects: Count = 0
    """Within some metres of the station."""
    rain_returns: NotNegative = 0.0
    """Mean number a frame and sensor, most of them near."""
    snow_returns: NotNegative = 0.0
    """Mean number a frame and sensor of flakes, within 30 m."""
    fog: Fog | None = None

    def __post_init__(self) -> None:
        require(self.clear_m < self.radius_m, "needs clear_m < radius_m")


@checked
class Scenario:
    """A recording to be simulated."""

    sensors: dict[Annotated[str, AfterValidator(check_name)], Sensor]
    """By names, which become those of folders."""
    drones: tuple[Drone, ...] = ()
    scene: Scene = field(default_factory=Scene)
    duration_s: Annotated[float, Field(gt=0, le=3600)] = 12.0
    carrier: Carrier | None = None
    """Else all sensors are at rest."""
    start_time_s: Annotated[int, Field(ge=0, le=9_000_000_000)] = 1_700_000_000
    """Unix time of the first ray."""
    point_times: bool = False
    """Write the field `t`, ns after the stamp of the frame."""

    def __post_init__(self) -> None:
        require(bool(self.sensors), "needs at least one sensor")


_SCENARIO = TypeAdapter(Scenario)


def load_scenario(name_or_path: str) -> Scenario:
    """A scenario file, or one of the scenarios that come along, by its name."""
    path = Path(name_or_path)
    if path.suffix not in (".yaml", ".yml"):
        path = SCENARIO_DIR / f"{name_or_path}.yaml"
        if not path.is_file():
            known = listed(scenario_names())
            raise UsageError(
                f"no scenario '{name_or_path}', expected a .yaml file or one of {known}"
            )
    return read_checked(path, _SCENARIO)


def schema() -> dict:
    """The JSON schema of scenarios, by which editors complete and check them."""
    return schema_of(_SCENARIO)
