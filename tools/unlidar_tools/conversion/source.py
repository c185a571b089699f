"""What a kind of recording offers to the converter."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, Literal, Protocol

import numpy as np

from unlidar_tools.geodesy import Origin
from unlidar_tools.station import Pose

_NS_PER_S = 1_000_000_000


@dataclass(frozen=True)
class Window:
    """From a time up to, but without, another."""

    start_ns: int | None
    stop_ns: int | None

    def __contains__(self, stamp_ns: int) -> bool:
        """Whether a time lies in it."""
        after = self.start_ns is None or stamp_ns >= self.start_ns
        return after and (self.stop_ns is None or stamp_ns < self.stop_ns)


@dataclass(frozen=True)
class Options:
    """What to take from a recording, and how."""

    topics: tuple[str, ...] = ()  # of a bag; else all clouds and its truth
    truths: tuple[str, ...] = ()  # topics of a bag, each a target; else one whose name says so
    skip_bad: bool = False  # leave out, and count, what cannot be read, and stamps that repeat
    start_s: float = 0.0  # after the begin of the recording
    duration_s: float | None = None
    stamp: Literal["header", "log"] = "header"  # which time of a bag's message is the frame's
    merge: int = 1  # messages of one topic per frame
    rate_hz: float | None = None  # of files that are numbered instead of stamped
    origin: Origin | None = None  # of the local frame of NavSatFix; else the first fix

    def window(self, begin_ns: int) -> Window:
        """The times asked for of a recording with this begin."""
        start_ns = begin_ns + round(self.start_s * _NS_PER_S)
        stop_ns = None
        if self.duration_s is not None:
            stop_ns = start_ns + round(self.duration_s * _NS_PER_S)
        return Window(start_ns if self.start_s else None, stop_ns)


@dataclass(frozen=True)
class SourceFrame:
    """One frame of one sensor, or one of several messages that make a frame."""

    sensor: str
    stamp: str  # as the recording spells it, or seconds with nine decimals
    xyz_m: np.ndarray  # (N, 3)
    fields: dict[str, np.ndarray] = field(default_factory=dict)  # more columns of the PCD file


@dataclass(frozen=True)
class TruthRow:
    """Where a target is."""

    stamp: str
    xyz_m: tuple[float, float, float]
    target: int = 0
    in_view: bool | None = None  # whether a sensor could see it; None where no row says so


@dataclass(frozen=True)
class Unreadable:
    """A frame or a row of truth that cannot be read; what follows it can."""

    where: str  # its topic or sensor
    why: str  # names the file, the value and what was expected


@dataclass(frozen=True)
class Stream:
    """One line of `--list`: a topic or a folder."""

    name: str
    type: str
    items: int
    becomes: str  # what convert makes of it, or why nothing
    span_s: float | None = None  # from its first to its last item; None where that is not known

    @property
    def rate_hz(self) -> float | None:
        """Items in a second, None where no two are known."""
        return (self.items - 1) / self.span_s if self.span_s and self.items > 1 else None


class Source(Protocol):
    """A recording that was opened; holds at most one frame in memory at a time."""

    kind: ClassVar[str]
    description: ClassVar[str]  # what the messages call it
    keeps_beginning: ClassVar[bool]  # whether frames before a broken one are worth keeping
    sensors: dict[str, int]  # number of frames (messages, for a bag) by name
    truths: int  # number of truth targets

    def __init__(self, path: Path, options: Options) -> None: ...

    @classmethod
    def matches(cls, path: Path) -> bool:
        """Whether `path` looks like this kind, without reading it."""
        ...

    def lidars(self) -> list[str]:
        """The sensors that are converted unless others are asked for; InputError if none."""
        ...

    def streams(self) -> list[Stream]:
        """All that the recording holds."""
        ...

    def spans_ns(self) -> dict[str, tuple[int, int]]:
        """When the first and the last item of a stream was, by its name, as far as is known.

        By an index where there is one; of an MCAP or ROS 1 to within a chunk.
        """
        ...

    def total(self, sensors: list[str]) -> int:
        """About how many items these sensors give, for the progress bar."""
        ...

    def items(self, sensors: list[str]) -> Iterator[SourceFrame | TruthRow | Unreadable]:
        """Frames of these sensors and truth, each sensor in order of time.

        Throws InputError where nothing further can be read.
        """
        ...

    def station(self) -> dict[str, Pose]:
        """Where the sensors stand, once the items were read; empty if nothing is known."""
        ...

    def notes(self) -> list[str]:
        """What the user should know once the items were read."""
        ...

    def facts(self) -> dict:
        """What conversion.json keeps of it."""
        ...

    def close(self) -> None:
        """Lets go of its files."""
        ...
