"""The engine's events: a line of JSON each, as docs/live.md describes them.

All bounds on incoming numbers, names and lengths are here. Events are serialised anew from the
validated values: numbers keep the engine's digits, unchecked content is never passed on.
"""

import binascii
import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    Field,
    Strict,
    TypeAdapter,
    ValidationError,
)

from unlidar.checking import require
from unlidar.events.clock import AHEAD_S
from unlidar.sanitize import is_visible
from unlidar.stamps import format_stamp_ns, parse_seconds_ns

# The longest line of the engine, with the most returns, fits; other lines have some hundred.
MOST_BYTES = 16_384
MOST_NAME = 120
BACK_NS = 10_000_000_000  # a row older by more means that the clock was set back
_MOST_DIGITS = 40
_MOST_STAMP_NS = 4_000_000_000_000_000_000  # the engine's limit: 126 years before and after 1970
_MOST_COUNT = 2**53 - 1  # integers exact in JavaScript and SQLite
_MOST_M = 1e6
_MOST_MPS = 1e4
_OLDEST_S = 86_400.0  # largest delay of a row behind its event, by `live.delay_s`
# Bounds on unknown keys of later engines that are passed on.
_MOST_MORE, _MOST_MORE_CHARACTERS = 32, 4096
_MOST_RETURNS, _RETURN_BYTES = 2000, 6
_MORE_KEY = re.compile("[A-Za-z_][A-Za-z0-9_]{0,39}")


class Digits(str):
    """The original text of a JSON number, as opposed to a quoted string."""

    __slots__ = ()


def _digits(value: object) -> str:
    if type(value) is not Digits:
        raise ValueError("expected a number")
    require(len(value) <= _MOST_DIGITS, f"expected a number of at most {_MOST_DIGITS} digits")
    return value


def _stamp_ns(value: object) -> int:
    stamp_ns = parse_seconds_ns(_digits(value))
    require(abs(stamp_ns) <= _MOST_STAMP_NS, "expected seconds within 126 years of 1970")
    return stamp_ns


def _count(value: object) -> int:
    digits = _digits(value)
    require(digits.isdecimal() and int(digits) <= _MOST_COUNT, "expected a number from 0 to 2^53-1")
    return int(digits)


def _name(value: object) -> str:
    require(type(value) is str, "expected a text")
    require(is_visible(value), "expected a text of characters that can be seen")
    return value


def _returns(value: object) -> str:
    require(type(value) is str, "expected a text")
    try:
        size = len(binascii.a2b_base64(value, strict_mode=True))
    except ValueError as error:
        raise ValueError("expected base64") from error
    require(
        size % _RETURN_BYTES == 0 and size <= _MOST_RETURNS * _RETURN_BYTES,
        f"expected {_RETURN_BYTES} bytes for each of at most {_MOST_RETURNS} returns",
    )
    return value


StampNs = Annotated[int, BeforeValidator(_stamp_ns)]
Number = Annotated[int, BeforeValidator(_count)]
_Real = Annotated[float, BeforeValidator(lambda value: float(_digits(value)))]
Metres = Annotated[_Real, Field(ge=-_MOST_M, le=_MOST_M)]
Speed = Annotated[_Real, Field(ge=-_MOST_MPS, le=_MOST_MPS)]
Sigma = Annotated[_Real, Field(ge=0, le=_MOST_M)]
Share = Annotated[_Real, Field(ge=0, le=1)]
Latitude = Annotated[_Real, Field(ge=-90, le=90)]
Longitude = Annotated[_Real, Field(ge=-360, le=360)]
Name = Annotated[str, BeforeValidator(_name), Field(max_length=MOST_NAME)]
State = Annotated[str, BeforeValidator(_name), Field(max_length=40)]


class _Bounded:
    """Annotations are bounds on what is decoded; an engine in this process is believed."""

    # Unknown keys of later engines are passed on, and are no error.
    __pydantic_config__: ClassVar = ConfigDict(extra="ignore", allow_inf_nan=False)


@dataclass(frozen=True, kw_only=True)
class TrackBegins(_Bounded):
    """A track is confirmed."""

    event: Literal["track"]
    at: StampNs
    track: Number
    first_evidence: StampNs
    drone: Share | None = None
    bird_like: Share | None = None
    unknown: Share | None = None


@dataclass(frozen=True, kw_only=True)
class _OfTrack(_Bounded):
    """State of a track at an instant: metres, m/s, standard deviations in metres."""

    at: StampNs
    track: Number
    timestamp: StampNs
    x: Metres
    y: Metres
    z: Metres
    vx: Speed
    vy: Speed
    vz: Speed
    sigma_x: Sigma
    sigma_y: Sigma
    sigma_z: Sigma
    drone: Share | None = None
    bird_like: Share | None = None
    unknown: Share | None = None
    # Added by a relay whose station has an origin.
    latitude_deg: Latitude | None = None
    longitude_deg: Longitude | None = None
    height_m: Metres | None = None


@dataclass(frozen=True, kw_only=True)
class Row(_OfTrack):
    """A row of the trajectory, `live.delay_s` late or more."""

    event: Literal["row"]
    support: Annotated[_Real, Field(ge=0, le=1e9)]
    late: Annotated[bool, Strict()]


@dataclass(frozen=True, kw_only=True)
class Now(_OfTrack):
    """Where a track is at the newest stamp, predicted where it was not measured."""

    event: Literal["now"]
    unseen_s: Annotated[_Real, Field(ge=0, le=_OLDEST_S)]  # since its last evidence


@dataclass(frozen=True, kw_only=True)
class TrackEnds(_Bounded):
    """A track has ended, `timestamp` is its last evidence."""

    event: Literal["end"]
    at: StampNs
    track: Number
    timestamp: StampNs
    drone: Share | None = None
    bird_like: Share | None = None
    unknown: Share | None = None


@dataclass(frozen=True, kw_only=True)
class SensorState(_Bounded):
    """A LiDAR started or stopped delivering frames, or its clock lost its synchronisation."""

    event: Literal["sensor"]
    at: StampNs
    name: Name
    state: State
    clock: State | None = None  # of a LiDAR whose packets tell


@dataclass(frozen=True, kw_only=True)
class EngineState(_Bounded):
    """Load and losses of the engine; counts since its start."""

    event: Literal["state"]
    at: StampNs
    state: State
    frames: Number
    dropped: Number


@dataclass(frozen=True, kw_only=True)
class Returns(_Bounded):
    """Some of the returns of a LiDAR's frame, for a view of them; never stored nor sent on."""

    event: Literal["returns"]
    at: StampNs
    name: Name
    timestamp: StampNs
    step_m: Annotated[_Real, Field(gt=0, le=1)]
    xyz: Annotated[str, BeforeValidator(_returns)]  # little-endian int16, in steps


def _in_time(event: "Event") -> "Event":
    """Checks a stamp against its event's: not after it, at most `live.delay_s` before it."""
    for key in ("timestamp", "first_evidence"):
        stamp_ns = getattr(event, key, event.at)
        require(
            -AHEAD_S <= (event.at - stamp_ns) * 1e-9 <= _OLDEST_S,
            f"{key}: expected a time of at most {_OLDEST_S:g} s before 'at'",
        )
    return event


Event = TrackBegins | Row | Now | TrackEnds | SensorState | EngineState | Returns
Tokens = dict[str, str]  # keys of an event with values as JSON, in order
_EVENT: TypeAdapter[Event] = TypeAdapter(
    Annotated[Event, Field(discriminator="event"), AfterValidator(_in_time)]
)


def parse(line: str | bytes) -> dict[str, Any]:
    """Parses a JSON object with numbers as `Digits`. ValueError with the fault."""
    if len(line) > MOST_BYTES:
        raise ValueError(f"has {len(line)} characters, expected at most {MOST_BYTES}")
    try:
        values = json.loads(
            line.decode() if isinstance(line, bytes) else line,
            parse_float=Digits,
            parse_int=Digits,
            parse_constant=refuse_constant,
            object_pairs_hook=_each_once,
        )
    except RecursionError as error:
        raise ValueError("is nested too deeply") from error
    except ValueError as error:
        raise ValueError(f"is no JSON: {error}") from error
    if not isinstance(values, dict):
        raise ValueError("is no JSON object")
    return values


def understand(values: Mapping[str, Any]) -> tuple[Event, Tokens]:
    """Validates a parsed object. ValueError with the key and the expectation."""
    try:
        event = _EVENT.validate_python(values)
    except ValidationError as error:
        fault = error.errors(include_url=False, include_input=False)[0]
        key = ".".join(str(part)[:MOST_NAME] for part in fault["loc"][1:2]) or "event"
        raise ValueError(f"{key}: {fault['msg']}"[:200]) from error
    own = event.__dataclass_fields__
    tokens = {key: _own_token(value) for key, value in values.items() if key in own}
    room = _MOST_MORE_CHARACTERS
    for key in [key for key in values if key not in own][:_MOST_MORE]:
        token = _token(values[key])
        room -= len(key) + len(token)
        if token and _MORE_KEY.fullmatch(key) and room >= 0:
            tokens[key] = token
    return event, tokens


def decode(line: str | bytes) -> tuple[Event, str]:
    """An event and its text, one line of JSON that decodes to the same. ValueError as above.

    Stamps are exact: a float would lose their last digits.
    """
    event, tokens = understand(parse(line))
    return event, joined(tokens)


def track_ends(track: int, at_ns: int, stamp_ns: int) -> tuple[Event, Tokens]:
    """The `end` event of a track whose engine sent none; the stamp is clamped to the bounds."""
    at_ns = min(max(at_ns, -_MOST_STAMP_NS), _MOST_STAMP_NS)
    stamp_ns = min(max(stamp_ns, at_ns - round(_OLDEST_S * 1e9), -_MOST_STAMP_NS), at_ns)
    values = {"event": "end", "at": at_ns, "track": track, "timestamp": stamp_ns}
    stamps = {key: Digits(format_stamp_ns(values[key])) for key in ("at", "timestamp")}
    return understand(values | stamps | {"track": Digits(track)})


def extended(text: str, more: Mapping[str, str | float | bool | None]) -> str:
    """An event's text with further, new keys appended."""
    own = joined({key: token(value) for key, value in more.items()})
    return f"{text[:-1]},{own[1:]}" if more else text


def joined(tokens: Tokens) -> str:
    """The text of an event."""
    return f"{{{','.join(f'{_quoted(key)}:{token}' for key, token in tokens.items())}}}"


def token(value: str | float | bool | None) -> str:
    """An own value as JSON; ValueError for NaN and infinity."""
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def _own_token(value: object) -> str:
    """A validated value as JSON: of a text the bounds have been checked."""
    return _quoted(value) if type(value) is str else _token(value)


def _token(value: object) -> str:
    """A foreign value as JSON; empty if it is not passed on."""
    match value:
        case Digits():
            bounded = len(value) <= _MOST_DIGITS and math.isfinite(float(value))
            return str(value) if bounded else ""
        case str():
            return _quoted(value) if len(value) <= MOST_NAME and value.isprintable() else ""
        case bool() | None:
            return token(value)
    return ""


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)


def refuse_constant(name: str) -> None:
    """ValueError: NaN and Infinity are no JSON."""
    raise ValueError(f"{name} is no number of JSON")


def _each_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    values = dict(pairs)
    if len(values) < len(pairs):
        raise ValueError("a key is there twice")
    return values
