"""The trace of `unlidar_track --trace`: JSON lines, checked one at a time as they are read."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BeforeValidator, ConfigDict, Field, TypeAdapter, ValidationError

from unlidar.csv_rows import numbered_lines
from unlidar.errors import InputError, listed
from unlidar.limits import MOST_TRACE, MOST_TRACE_LINE
from unlidar.stamps import MOST_STAMP_NS, parse_seconds_ns

_STRICT = ConfigDict(strict=True)


def _stamp_ns(value: object) -> int:
    if not isinstance(value, str):
        raise ValueError("expected a text of decimal seconds")
    return parse_seconds_ns(value)


_StampNs = Annotated[int, BeforeValidator(_stamp_ns), Field(ge=-MOST_STAMP_NS, le=MOST_STAMP_NS)]
_Metres = Annotated[float, Field(ge=-1e9, le=1e9)]
_Finite = Annotated[float, Field(allow_inf_nan=False)]
_Count = Annotated[int, Field(ge=0)]
_Name = Annotated[str, Field(pattern=r"^[a-z][a-z_]{0,39}$")]


@dataclass(frozen=True)
class TracedDetection:
    """Neighbouring returns of one frame that the scene does not explain."""

    __pydantic_config__ = _STRICT

    x: _Metres  # in the common frame
    y: _Metres
    z: _Metres
    returns: _Count
    height_m: _Finite | None  # above the ground; None where none is seen
    # Of the expected number of clutter detections per m^3 and frame; None where strays are so dense
    # that there is no bound to the groups they form.
    log_clutter: _Finite | None
    unsupported: bool  # nothing holds it up
    # Of streams:
    log_likelihood_ratio: _Finite | None = None  # of the best path to it
    rejection: _Name | None = None  # the rule that refused this path
    track: _Count | None = None  # number of the track that has it


@dataclass(frozen=True)
class TracedFrame:
    """The program's result for one frame."""

    __pydantic_config__ = _STRICT

    trace: Literal["frame"]
    sensor: str
    stamp: _StampNs  # file stamp on the common clock
    middle: _StampNs  # mid-time of the measurement
    returns: _Count
    bodies: list[tuple[_Metres, _Metres, _Metres]]  # returns of people and vehicles
    detections: list[TracedDetection]
    # Of streams:
    threshold: _Finite | None = None
    rejection: _Name | None = None  # the reason for which it is not searched


@dataclass(frozen=True)
class TracedPath:
    """A path of detections, accepted as a track or rejected."""

    __pydantic_config__ = _STRICT

    trace: Literal["path"]
    first: _StampNs
    last: _StampNs
    log_likelihood_ratio: _Finite  # its track score
    crowding_penalty: _Finite  # crowding penalty, subtracted from the score
    threshold: _Finite
    rejection: _Name | None  # the rejecting gate; None: it became a track
    detections: list[tuple[_StampNs, _Metres, _Metres, _Metres]]
    # Of streams:
    cuts: list[tuple[_Name, _Count]] = field(default_factory=list)  # leading detections, by rule
    track: _Count | None = None  # that it became

    def parts(self) -> Iterator[tuple[slice, str | None]]:
        """The detections that each rule refuses, and the rest with the rejection of the path."""
        begin = 0
        for rule, count in self.cuts:
            yield slice(begin, begin + count), rule
            begin += count
        yield slice(begin, None), self.rejection


@dataclass(frozen=True)
class TracedTrack:
    """A decision on a track of a stream."""

    __pydantic_config__ = _STRICT

    trace: Literal["track"]
    at: _StampNs  # stamp of the last frame searched
    track: _Count
    state: Literal["initiated", "waiting", "confirmed", "rejected", "deleted"]
    rejection: _Name | None  # the rule for which it waits, is rejected or deleted
    first: _StampNs  # evidence
    last: _StampNs


@dataclass(frozen=True)
class _Header:
    __pydantic_config__ = _STRICT

    trace: Literal["header"]
    version: str
    method: str
    sensors: list[str]  # none of a stream, whose sensors appear with their frames


Traced = TracedFrame | TracedPath | TracedTrack
_LINE = TypeAdapter(Annotated[_Header | Traced, Field(discriminator="trace")])


def read_trace(path: Path) -> Iterator[Traced]:
    """Frames, paths and tracks in the order of the file.

    Throws InputError naming the line, the field and what was expected.
    """
    sensors = None
    for number, text in numbered_lines(path, MOST_TRACE, MOST_TRACE_LINE):
        line = _line(f"{path}:{number}", text)
        if (sensors is None) != isinstance(line, _Header):
            expected = "a header in the first line, and only there"
            raise InputError(f"{path}:{number}: a {line.trace}, expected {expected}")
        if isinstance(line, _Header):
            sensors = line.sensors
            continue
        if isinstance(line, TracedFrame) and sensors and line.sensor not in sensors:
            raise InputError(
                f"{path}:{number}: sensor is '{line.sensor[:40]}', expected one of "
                f"{listed(sensors)}"
            )
        yield line
    if sensors is None:
        raise InputError(f"{path}: it is empty, expected a trace of unlidar_track")


def _line(where: str, text: str) -> _Header | Traced:
    try:
        return _LINE.validate_json(text)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        key = ".".join(map(str, fault["loc"][1:]))
        found = str(fault["input"])[:40]
        at = f"{key} is '{found}', " if key else ""
        raise InputError(f"{where}: {at}{fault['msg'].removeprefix('Value error, ')}") from error
