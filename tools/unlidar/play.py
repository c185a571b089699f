"""Playback of a recording as a live source."""

import math
import os
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import BinaryIO, Protocol

from unlidar.errors import InputError, OutputError, reason
from unlidar.frames_io import list_frames
from unlidar.stamps import format_stamp_ns

# Largest delay of the first sensor's first frame, less than `live.reorder_s`.
_MAX_LATE_NS = 200_000_000
_NO_RATES: Mapping[str, float | None] = MappingProxyType({})


@dataclass(frozen=True)
class PlayedFrame:
    """A frame with its due time, in seconds after the recording's first frame."""

    sensor: str
    stamp_ns: int
    path: Path
    due_s: float


@dataclass(frozen=True)
class Played:
    """Counts of sent frames, and the largest delay behind a due time."""

    frames: int
    wall_s: float
    most_behind_s: float


class Sink(Protocol):
    """Receiver of frames."""

    def send(self, frame: PlayedFrame, pcd: bytes) -> None:
        """Sends one frame, the bytes of its file unchanged."""


class MessageSink:
    """The framing of `unlidar_track --stdin`: a line `frame NAME STAMP LENGTH`, then the PCD."""

    def __init__(self, stream: BinaryIO):
        self._stream = stream

    def send(self, frame: PlayedFrame, pcd: bytes) -> None:
        """Sends a frame. BrokenPipeError if the reader has closed."""
        head = f"frame {frame.sensor} {format_stamp_ns(frame.stamp_ns)} {len(pcd)}\n"
        self._stream.write(head.encode() + pcd)
        self._stream.flush()


class FolderSink:
    """A folder for each sensor, as `unlidar_track --follow` watches it: files appear by rename."""

    def __init__(self, into: Path):
        self._into = into

    def send(self, frame: PlayedFrame, pcd: bytes) -> None:
        """Writes a frame. Throws OutputError."""
        folder = self._into / frame.sensor
        name = f"{format_stamp_ns(frame.stamp_ns)}.pcd"
        work = folder / f".{name}.part-{os.getpid()}"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            work.write_bytes(pcd)
            work.replace(folder / name)
        except OSError as error:
            work.unlink(missing_ok=True)
            raise OutputError(f"{folder / name}: cannot be written: {reason(error)}") from error


def frames_in_order(
    sensors: Mapping[str, Path],
    repeat: int = 1,
    rates_hz: Mapping[str, float | None] = _NO_RATES,
) -> Iterator[PlayedFrame]:
    """All frames by their stamps, `repeat` times one after the other.

    `rates_hz`: of sensors whose frames are numbered, as of `list_frames`.

    The first sensor goes first, as the program takes its output times from it: others that begin
    a little before it wait for its first frame.
    """
    frames = [
        (frame.stamp_ns, order, name, frame.path)
        for order, (name, directory) in enumerate(sensors.items())
        for frame in list_frames(directory, rates_hz.get(name))
    ]
    frames.sort(key=lambda frame: frame[:2])
    first = next((i for i, frame in enumerate(frames) if frame[1] == 0), 0)
    if frames and frames[first][0] - frames[0][0] <= _MAX_LATE_NS:
        frames.insert(0, frames.pop(first))
    begin_ns = min((frame[0] for frame in frames), default=0)
    length_ns = _length_ns(sorted(frame[0] for frame in frames), len(sensors))
    for turn in range(repeat):
        for stamp_ns, _, name, path in frames:
            shifted_ns = stamp_ns + turn * length_ns
            yield PlayedFrame(name, shifted_ns, path, (shifted_ns - begin_ns) * 1e-9)


def play(frames: Iterator[PlayedFrame], sink: Sink, rate: float) -> Played:
    """Sends each frame when it is due, `rate` times as fast as it was recorded; inf: at once."""
    begin = time.monotonic()
    count, most_behind_s = 0, 0.0
    for frame in frames:
        try:
            pcd = frame.path.read_bytes()
        except OSError as error:
            raise InputError(f"{frame.path}: cannot be read: {reason(error)}") from error
        if math.isfinite(rate):
            behind_s = time.monotonic() - begin - frame.due_s / rate
            most_behind_s = max(most_behind_s, behind_s)
            if behind_s < 0:
                time.sleep(-behind_s)
        sink.send(frame, pcd)
        count += 1
    return Played(count, time.monotonic() - begin, most_behind_s)


def _length_ns(stamps_ns: list[int], sensors: int) -> int:
    """Duration of a recording: to its last stamp plus one frame period."""
    if len(stamps_ns) < 2:
        return 100_000_000
    span_ns = stamps_ns[-1] - stamps_ns[0]
    return span_ns + span_ns * sensors // max(1, len(stamps_ns) - sensors)
