"""The engine's events: a line of JSON each, as docs/live.md describes them."""

import json
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, ConfigDict, Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from unlidar_tools.stamps import parse_seconds_ns

# More than ten times the longest that the engine writes.
MOST_BYTES = 16_384


def _stamp_ns(value: object) -> int:
    return parse_seconds_ns(str(value))


StampNs = Annotated[int, BeforeValidator(_stamp_ns)]
Number = Annotated[int, Field(ge=0)]
Share = Annotated[float, Field(ge=0, le=1)]
Sigma = Annotated[float, Field(ge=0)]

# What a later engine adds to an event is passed on, and is no error.
_event = dataclass(
    frozen=True, kw_only=True, config=ConfigDict(extra="ignore", allow_inf_nan=False)
)


@_event
class TrackBegins:
    """A track is confirmed."""

    event: Literal["track"]
    at: StampNs
    track: Number
    first_evidence: StampNs
    drone: Share | None = None


@_event
class Row:
    """Where a track is at an instant: metres, m/s, standard deviations in metres."""

    event: Literal["row"]
    at: StampNs
    track: Number
    timestamp: StampNs
    x: float
    y: float
    z: float
    vx: float
    vy: float
    vz: float
    sigma_x: Sigma
    sigma_y: Sigma
    sigma_z: Sigma
    support: Annotated[float, Field(ge=0)]
    late: bool
    drone: Share | None = None


@_event
class TrackEnds:
    """A track has ended, `timestamp` is its last evidence."""

    event: Literal["end"]
    at: StampNs
    track: Number
    timestamp: StampNs


@_event
class SensorState:
    """A LiDAR gives frames, or none any more."""

    event: Literal["sensor"]
    at: StampNs
    name: Annotated[str, Field(max_length=120)]
    state: Annotated[str, Field(max_length=40)]


@_event
class EngineState:
    """How the engine gets along; counts since its start."""

    event: Literal["state"]
    at: StampNs
    state: Annotated[str, Field(max_length=40)]
    frames: Number
    dropped: Number


Event = TrackBegins | Row | TrackEnds | SensorState | EngineState
KINDS = ("track", "row", "end", "sensor", "state")
_EVENT: TypeAdapter[Event] = TypeAdapter(Annotated[Event, Field(discriminator="event")])


def decode(line: str | bytes) -> tuple[Event, str]:
    """An event and its text, one line without its end. ValueError naming what is wrong with it.

    Stamps are exact: a float would lose their last digits.
    """
    if len(line) > MOST_BYTES:
        raise ValueError(f"has {len(line)} characters, expected at most {MOST_BYTES}")
    text = line.decode() if isinstance(line, bytes) else line
    try:
        values = json.loads(text, parse_float=str, parse_constant=_refuse)
    except RecursionError as error:
        raise ValueError("is nested too deeply") from error
    except ValueError as error:
        raise ValueError(f"is no JSON: {error}") from error
    if not isinstance(values, dict):
        raise ValueError("is no JSON object")
    try:
        return _EVENT.validate_python(values), text.strip()
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        key = ".".join(map(str, fault["loc"][1:])) or "event"
        raise ValueError(f"{key}: {fault['msg']}") from error


def extended(text: str, more: Mapping[str, Any]) -> str:
    """An event's text with more keys at its end; what was there keeps every digit."""
    return f"{text[:-1].rstrip()},{json.dumps(more, separators=(',', ':'))[1:]}" if more else text


def _refuse(name: str) -> None:
    raise ValueError(f"{name} is no number of JSON")
