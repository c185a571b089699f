"""Recordings of any kind -> frame directories `<sensor>/<stamp>.pcd` and ground_truth.csv.

A kind of recording is one module with a class like `Source`; `KINDS` lists them in the order in
which they are tried.
"""

import json
from collections.abc import Iterable, Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

from unlidar import __version__
from unlidar.conversion.bag import RosBag
from unlidar.conversion.folder import FrameFolder
from unlidar.conversion.las import LasFile
from unlidar.conversion.livox_capture import LivoxCapture, LivoxFile
from unlidar.conversion.merge import merged
from unlidar.conversion.mmaud import MmaudFolder
from unlidar.conversion.ouster_capture import OusterCapture
from unlidar.conversion.point_times import OFFSET_FIELD, pcd_column
from unlidar.conversion.source import (
    Options,
    Source,
    SourceFrame,
    Stream,
    TruthRow,
    Unreadable,
)
from unlidar.conversion.truth_file import TruthFile
from unlidar.conversion.velodyne_capture import VelodyneCapture
from unlidar.errors import InputError, UsageError, listed
from unlidar.frames_io import is_return, write_pcd
from unlidar.names import check_name
from unlidar.output import complete_directory
from unlidar.progress import with_progress
from unlidar.sanitize import printable
from unlidar.stamps import parse_stamp_ns
from unlidar.station import write_station
from unlidar.truth import TRUTH_NAME

KINDS: tuple[type[Source], ...] = (
    RosBag,
    VelodyneCapture,
    OusterCapture,
    LivoxCapture,
    LivoxFile,
    LasFile,
    MmaudFolder,
    FrameFolder,
)
_DEFAULTS = Options()
# Short form for messages; the full list is in docs/formats.md.
EXPECTED = "a ROS bag, a LiDAR's .pcap, .lvx or .las, an MMAUD sequence or a folder of frames"


def open_source(path: Path, options: Options = _DEFAULTS) -> Source:
    """Opens the recording at `path` with the first kind that matches."""
    if not path.exists():
        raise InputError(f"{path}: does not exist")
    if not path.is_dir() and not path.is_file():  # opening a pipe would block until it has a writer
        raise InputError(f"{path}: is a pipe or a device, expected a file or a folder")
    for kind in KINDS:
        if kind.matches(path):
            return kind(path, options)
    if several := _recordings_in(path):
        raise InputError(
            f"{path}: holds recordings ({listed(several, 36)}): name one, or unlidar run {path}"
        )
    raise InputError(f"{path}: no recording of a known kind, expected {EXPECTED}")


def list_streams(path: Path) -> tuple[str, list[Stream]]:
    """The kind of the recording at `path` and its streams."""
    with closing(open_source(path)) as source:
        spans_ns = source.spans_ns()
        return source.kind, [_timed(stream, spans_ns) for stream in source.streams()]


def _timed(stream: Stream, spans_ns: dict[str, tuple[int, int]]) -> Stream:
    first, last = spans_ns.get(stream.name, (0, 0))
    return replace(stream, span_s=(last - first) * 1e-9) if last > first else stream


def convert(
    path: Path,
    out: Path,
    sensors: list[str] | None = None,
    force: bool = False,
    options: Options = _DEFAULTS,
) -> dict:
    """Converts the recording at `path` to the folder `out` and returns a report.

    Frames keep the digits of their stamps; rays without a return and rows that are not finite are
    left out. `sensors` chooses among those of the recording, by default its LiDARs. Of a damaged
    recording the part before the damage is kept, and `broken` holds the reason, else None.
    InputError if nothing can be kept.
    """
    with closing(open_source(path, options)) as source:
        chosen = sensors or source.lidars()
        unknown = [name for name in chosen if name not in source.sensors]
        if unknown:
            raise UsageError(
                f"{path}: has no sensor '{unknown[0]}', it holds {listed(source.sensors)}"
            )
        with complete_directory(out, force, path) as work:
            writer = _Writer(path, work, chosen, options)
            broken = writer.write(source)
            poses = {n: p for n, p in source.station().items() if n in writer.frames}
            if poses:
                write_station(work, poses, f"Poses of the LiDARs of {path.name}")
            report = {
                "source": str(path.resolve()),
                "kind": source.kind,
                "version": __version__,
                "complete": broken is None,
                "broken": broken,
                "frames": writer.frames,
                "returns": writer.returns,
                "left_out": writer.left_out,
                "truth_rows": writer.truth_rows if source.truths else None,
                "notes": [*source.notes(), *writer.notes()],
                **source.facts(),
            }
            (work / "conversion.json").write_text(json.dumps(report, indent=2) + "\n")
    return report


def kept_of(report: dict) -> str:
    """The number of frames kept of a damaged recording, in words."""
    return f"{sum(report['frames'].values())} frames and {report['truth_rows'] or 0} truth rows"


class _Writer:
    """Writes frames and truth as they come, and counts them."""

    def __init__(self, path: Path, work: Path, sensors: list[str], options: Options) -> None:
        self._path, self._work, self._options = path, work, options
        self.frames = dict.fromkeys(sensors, 0)
        self.returns = dict.fromkeys(sensors, 0)
        self.truth_rows = 0
        self.left_out: dict[str, int] = {}  # frames and rows of truth, by topic or sensor
        self._why: dict[str, str] = {}  # reason for the first of them
        self._written: dict[tuple[str, int], str] = {}
        self._truth_span: tuple[int, int] | None = None
        for name in sensors:
            self._folder(name).mkdir()

    def write(self, source: Source) -> str | None:
        """Writes all items of the source; returns the reason if the recording breaks off."""
        sensors, options = list(self.frames), self._options
        said = f"Converting {printable(self._path.name)}"
        items = with_progress(source.items(sensors), source.total(sensors), said)
        broken = None
        with TruthFile(self._work / TRUTH_NAME, source.truths) as truth:
            try:
                for item in merged(self._readable(items), options.merge):
                    if isinstance(item, TruthRow):
                        self._add_truth(item, truth)
                    else:
                        self._add_frame(item)
            except InputError as error:
                if not source.keeps_beginning:
                    raise
                broken = str(error)
        if not any(self.frames.values()):
            why = broken or next(iter(self._why.values()), None)
            if why is not None:
                raise InputError(f"{why}; no frame could be read")
            if options.start_s or options.duration_s is not None:
                raise InputError(f"{self._path}: no frame lies in the time asked for")
        return broken

    def notes(self) -> list[str]:
        """Notes on items left out, and on truth of another time span than the frames."""
        notes = [
            f"{where}: left out {count}, the first: {self._why[where]}"
            for where, count in self.left_out.items()
        ]
        stamps = [stamp_ns for _, stamp_ns in self._written]
        if not stamps or self._truth_span is None:
            return notes
        first, last = self._truth_span
        if first <= max(stamps) and min(stamps) <= last:
            return notes
        return [
            *notes,
            f"no frame lies within the time of the truth: frames from {min(stamps) / 1e9:.3f} to "
            f"{max(stamps) / 1e9:.3f} s, truth from {first / 1e9:.3f} to {last / 1e9:.3f} s",
        ]

    def _readable(
        self, items: Iterable[SourceFrame | TruthRow | Unreadable]
    ) -> Iterator[SourceFrame | TruthRow]:
        for item in items:
            if isinstance(item, Unreadable):
                self._leave_out(item.where, item.why)
            else:
                yield item

    def _leave_out(self, where: str, why: str) -> None:
        if not self._options.skip_bad:
            raise InputError(f"{why} (--skip-bad leaves such out)")
        self.left_out[where] = self.left_out.get(where, 0) + 1
        self._why.setdefault(where, why)

    def _add_truth(self, row: TruthRow, truth: TruthFile) -> None:
        truth.add(row)
        self.truth_rows += 1
        stamp_ns = parse_stamp_ns(row.stamp)
        first, last = self._truth_span or (stamp_ns, stamp_ns)
        self._truth_span = min(first, stamp_ns), max(last, stamp_ns)

    def _add_frame(self, frame: SourceFrame) -> None:
        key = (frame.sensor, parse_stamp_ns(frame.stamp))
        if key in self._written:
            self._leave_out(
                frame.sensor,
                f"{self._path}: two frames of {frame.sensor} at one time, {self._written[key]} and "
                f"{frame.stamp}; --stamp log may tell those of a bag apart",
            )
            return
        if frame.sensor not in self.frames:  # a sensor first seen during the conversion
            self._folder(frame.sensor).mkdir()
            self.frames[frame.sensor] = self.returns[frame.sensor] = 0
        self._written[key] = frame.stamp
        kept = is_return(frame.xyz_m)
        columns = {name: column[kept] for name, column in frame.fields.items()}
        if OFFSET_FIELD in columns:
            columns[OFFSET_FIELD] = pcd_column(columns[OFFSET_FIELD])
        path = self._folder(frame.sensor) / f"{frame.stamp}.pcd"
        write_pcd(path, frame.xyz_m[kept], columns)
        self.frames[frame.sensor] += 1
        self.returns[frame.sensor] += int(kept.sum())

    def _folder(self, sensor: str) -> Path:
        return self._work / check_name(sensor)


def _recordings_in(path: Path) -> list[str]:
    """The names of the recordings directly in a folder."""
    if not path.is_dir():
        return []
    return [p.name for p in sorted(path.iterdir()) if any(kind.matches(p) for kind in KINDS)]
