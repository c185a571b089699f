"""The interface between a kind of recording and the converter."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, Literal, Protocol

import numpy as np

from unlidar.call_checks import (
    expect,
    expect_bool,
    expect_names,
    expect_number,
    expect_positive,
    expect_whole,
)
from unlidar.geodesy import Origin
from unlidar.poses import Poses
from unlidar.stamps import NS_PER_S
from unlidar.station import Pose


@dataclass(frozen=True)
class Window:
    """A half-open time interval [begin, end)."""

    start_ns: int | None
    stop_ns: int | None

    def __contains__(self, stamp_ns: int) -> bool:
        """True if a time lies in the interval."""
        after = self.start_ns is None or stamp_ns >= self.start_ns
        return after and (self.stop_ns is None or stamp_ns < self.stop_ns)


@dataclass(frozen=True)
class Options:
    """Options of a conversion."""

    topics: tuple[str, ...] = ()  # of a bag; else all clouds and its truth
    truths: tuple[str, ...] = ()  # topics of a bag, each a target; else one whose name says so
    skip_bad: bool = False  # skip and count unreadable items and repeated stamps
    start_s: float = 0.0  # after the begin of the recording
    duration_s: float | None = None
    stamp: Literal["header", "log"] = "header"  # which time of a bag's message is the frame's
    merge: int = 1  # messages of one topic per frame
    rate_hz: float | None = None  # of files that are numbered instead of stamped
    poses_topic: str | None = (
        None  # of a bag, "none" without motion; else as docs/formats.md has it
    )
    origin: Origin | None = None  # of the local frame of NavSatFix; else the first fix

    def __post_init__(self) -> None:
        """Throws UsageError for a value that is none."""
        expect_names("topics", self.topics)
        expect_names("truths", self.truths)
        expect_bool("skip_bad", self.skip_bad)
        expect_number("start_s", self.start_s, 0)
        if self.duration_s is not None:
            expect_positive("duration_s", self.duration_s)
        expect(self.stamp in ("header", "log"), "stamp", self.stamp, "'header' or 'log'")
        expect_whole("merge", self.merge, 1)
        if self.rate_hz is not None:
            expect_positive("rate_hz", self.rate_hz)
        is_topic = self.poses_topic is None or isinstance(self.poses_topic, str)
        expect(is_topic, "poses_topic", self.poses_topic, "the name of a topic, or None")
        is_origin = self.origin is None or isinstance(self.origin, Origin)
        expect(is_origin, "origin", self.origin, "an unlidar.Origin(...)")

    def window(self, begin_ns: int) -> Window:
        """The time window of a recording that begins at `begin_ns`."""
        start_ns = begin_ns + round(self.start_s * NS_PER_S)
        stop_ns = None
        if self.duration_s is not None:
            stop_ns = start_ns + round(self.duration_s * NS_PER_S)
        return Window(start_ns if self.start_s else None, stop_ns)


@dataclass(frozen=True)
class SourceFrame:
    """One frame of one sensor, or one of several messages that make a frame."""

    sensor: str
    stamp: str  # original text, or seconds with nine decimals
    xyz_m: np.ndarray  # (N, 3)
    fields: dict[str, np.ndarray] = field(default_factory=dict)  # more columns of the PCD file


@dataclass(frozen=True)
class TruthRow:
    """The position of a target at an instant."""

    stamp: str
    xyz_m: tuple[float, float, float]
    target: int = 0
    in_view: bool | None = None  # True if a sensor could see it; None: unknown


@dataclass(frozen=True)
class Unreadable:
    """A frame or truth row that cannot be read; reading goes on behind it."""

    where: str  # its topic or sensor
    why: str  # with file, value and expectation


@dataclass(frozen=True)
class Stream:
    """One line of `--list`: a topic or a folder."""

    name: str
    type: str
    items: int
    becomes: str  # the result of conversion, or the reason for none
    span_s: float | None = None  # from first to last item; None: unknown

    @property
    def rate_hz(self) -> float | None:
        """Items per second; None with fewer than two."""
        return (self.items - 1) / self.span_s if self.span_s and self.items > 1 else None


class Source(Protocol):
    """An open recording; holds at most one frame in memory at a time."""

    kind: ClassVar[str]
    description: ClassVar[str]  # name in messages
    keeps_beginning: ClassVar[bool]  # True if frames before damage are kept
    sensors: dict[str, int]  # number of frames (messages, for a bag) by name
    truths: int  # number of truth targets

    def __init__(self, path: Path, options: Options) -> None: ...

    @classmethod
    def matches(cls, path: Path) -> bool:
        """True if `path` looks like this kind, without reading it."""
        ...

    def lidars(self) -> list[str]:
        """The sensors converted by default; InputError if none."""
        ...

    def streams(self) -> list[Stream]:
        """All that the recording holds."""
        ...

    def spans_ns(self) -> dict[str, tuple[int, int]]:
        """First and last time of each stream by name, as far as known.

        Taken from the index if there is one; accurate to a chunk for MCAP and ROS 1.
        """
        ...

    def total(self, sensors: list[str]) -> int:
        """The approximate number of items of these sensors, for the progress bar."""
        ...

    def items(self, sensors: list[str]) -> Iterator[SourceFrame | TruthRow | Unreadable]:
        """Frames of these sensors and truth, each sensor in order of time.

        Throws InputError at damage behind which nothing can be read.
        """
        ...

    def station(self) -> dict[str, Pose]:
        """The sensor poses, valid after the items were read; empty if unknown.

        Of a sensor that moves: that on its carrier.
        """
        ...

    def poses(self) -> dict[str, Poses]:
        """Poses of what carries a sensor that moves, valid after the items were read."""
        ...

    def notes(self) -> list[str]:
        """Notes for the user, complete after the items were read."""
        ...

    def facts(self) -> dict:
        """The source's part of conversion.json."""
        ...

    def close(self) -> None:
        """Closes its files."""
        ...
