"""Recordings of any kind -> frame directories `<sensor>/<stamp>.pcd` and ground_truth.csv.

A kind of recording is one module with a class like `Source`; `KINDS` lists them in the order in
which they are tried.
"""

import json
from contextlib import closing
from dataclasses import replace
from pathlib import Path

from unlidar import __version__
from unlidar.conversion.bag import RosBag
from unlidar.conversion.folder import FrameFolder
from unlidar.conversion.kept_items import KeptItems
from unlidar.conversion.las import LasFile
from unlidar.conversion.livox_capture import LivoxCapture, LivoxFile
from unlidar.conversion.mmaud import MmaudFolder
from unlidar.conversion.ouster_capture import OusterCapture
from unlidar.conversion.source import (
    Options,
    Source,
    SourceFrame,
    Stream,
    TruthRow,
)
from unlidar.conversion.truth_file import TruthFile
from unlidar.conversion.velodyne_capture import VelodyneCapture
from unlidar.errors import InputError, UsageError, listed
from unlidar.frames_io import write_pcd
from unlidar.names import check_name
from unlidar.output import complete_directory
from unlidar.point_times import OFFSET_FIELD, pcd_column
from unlidar.poses import write_all_poses
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


def choose_sensors(path: Path, source: Source, sensors: list[str] | None) -> list[str]:
    """Those asked for, by default its LiDARs; UsageError for one that it does not hold."""
    chosen = sensors or source.lidars()
    unknown = [name for name in chosen if name not in source.sensors]
    if unknown:
        raise UsageError(f"{path}: has no sensor '{unknown[0]}', it holds {listed(source.sensors)}")
    return chosen


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
        chosen = choose_sensors(path, source, sensors)
        with complete_directory(out, force, path) as work:
            writer = _Writer(path, work, chosen, options)
            broken = writer.write(source)
            poses = {n: p for n, p in source.station().items() if n in writer.frames}
            if poses:
                write_station(work, poses, f"Poses of the LiDARs of {path.name}")
            moving = {n: p for n, p in source.poses().items() if n in writer.frames}
            write_all_poses(work, moving, len(writer.frames), f"Poses of {path.name}")
            report = {
                "source": str(path.resolve()),
                "kind": source.kind,
                "version": __version__,
                "complete": broken is None,
                "broken": broken,
                "frames": writer.frames,
                "returns": writer.returns,
                "left_out": writer.left_out(),
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
        self._path, self._work = path, work
        self.frames = dict.fromkeys(sensors, 0)
        self.returns = dict.fromkeys(sensors, 0)
        self.truth_rows = 0
        self._kept = KeptItems(path, options)
        self._truth_span: tuple[int, int] | None = None
        for name in sensors:
            self._folder(name).mkdir()

    def write(self, source: Source) -> str | None:
        """Writes all items of the source; returns the reason if the recording breaks off."""
        sensors = list(self.frames)
        said = f"Converting {printable(self._path.name)}"
        items = with_progress(source.items(sensors), source.total(sensors), said)
        broken = None
        with TruthFile(self._work / TRUTH_NAME, source.truths) as truth:
            try:
                for item in self._kept.of(items):
                    if isinstance(item, TruthRow):
                        self._add_truth(item, truth)
                    else:
                        self._add_frame(item)
            except InputError as error:
                if not source.keeps_beginning:
                    raise
                broken = str(error)
        if not any(self.frames.values()):
            self._kept.refuse_nothing(broken)
        return broken

    def left_out(self) -> dict[str, int]:
        """Frames and rows of truth left out, by topic or sensor."""
        return self._kept.left_out

    def notes(self) -> list[str]:
        """Notes on items left out, and on truth of another time span than the frames."""
        notes = self._kept.notes()
        stamps = self._kept.stamps_ns()
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

    def _add_truth(self, row: TruthRow, truth: TruthFile) -> None:
        truth.add(row)
        self.truth_rows += 1
        stamp_ns = parse_stamp_ns(row.stamp)
        first, last = self._truth_span or (stamp_ns, stamp_ns)
        self._truth_span = min(first, stamp_ns), max(last, stamp_ns)

    def _add_frame(self, frame: SourceFrame) -> None:
        if frame.sensor not in self.frames:  # a sensor first seen during the conversion
            self._folder(frame.sensor).mkdir()
            self.frames[frame.sensor] = self.returns[frame.sensor] = 0
        columns = dict(frame.fields)
        if OFFSET_FIELD in columns:
            columns[OFFSET_FIELD] = pcd_column(columns[OFFSET_FIELD])
        path = self._folder(frame.sensor) / f"{frame.stamp}.pcd"
        write_pcd(path, frame.xyz_m, columns)
        self.frames[frame.sensor] += 1
        self.returns[frame.sensor] += len(frame.xyz_m)

    def _folder(self, sensor: str) -> Path:
        return self._work / check_name(sensor)


def _recordings_in(path: Path) -> list[str]:
    """The names of the recordings directly in a folder."""
    if not path.is_dir():
        return []
    return [p.name for p in sorted(path.iterdir()) if any(kind.matches(p) for kind in KINDS)]
