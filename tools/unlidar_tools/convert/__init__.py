"""Recordings of any kind -> frame directories `<sensor>/<stamp>.pcd` and ground_truth.csv.

A kind of recording is one module with a class like `Source`; `KINDS` lists them in the order in
which they are tried.
"""

import json
from contextlib import closing
from pathlib import Path

from unlidar_tools import __version__
from unlidar_tools.convert.bag import RosBag
from unlidar_tools.convert.folder import FrameFolder
from unlidar_tools.convert.merge import merged
from unlidar_tools.convert.mmaud import MmaudFolder
from unlidar_tools.convert.point_times import OFFSET_FIELD, pcd_column
from unlidar_tools.convert.source import Options, Source, SourceFrame, Stream, TruthRow
from unlidar_tools.convert.truth_file import TruthFile
from unlidar_tools.errors import InputError, UsageError
from unlidar_tools.frames_io import is_return, write_pcd
from unlidar_tools.output import complete_directory
from unlidar_tools.progress import with_progress
from unlidar_tools.stamps import parse_stamp_ns
from unlidar_tools.truth import TRUTH_NAME

KINDS: tuple[type[Source], ...] = (RosBag, MmaudFolder, FrameFolder)
_DEFAULTS = Options()


def open_source(path: Path, options: Options = _DEFAULTS) -> Source:
    """The recording at `path`, of whichever kind it is."""
    if not path.exists():
        raise InputError(f"{path}: does not exist")
    for kind in KINDS:
        if kind.matches(path):
            return kind(path, options)
    expected = "; ".join(kind.description for kind in KINDS)
    raise InputError(f"{path}: no recording of a known kind, expected {expected}")


def list_streams(path: Path) -> tuple[str, list[Stream]]:
    """The kind of the recording at `path` and all it holds."""
    with closing(open_source(path)) as source:
        return source.kind, source.streams()


def convert(
    path: Path,
    out: Path,
    sensors: list[str] | None = None,
    force: bool = False,
    options: Options = _DEFAULTS,
) -> dict:
    """Converts the recording at `path` to the folder `out` and returns what it did.

    Frames keep the digits of their stamps; rays without a return and rows that are not finite are
    left out. `sensors` chooses among those of the recording, by default its LiDARs. Of a broken
    recording `out` keeps what came before, and InputError says so.
    """
    with closing(open_source(path, options)) as source:
        chosen = sensors or source.lidars()
        unknown = [name for name in chosen if name not in source.sensors]
        if unknown:
            raise UsageError(
                f"{path}: has no sensor '{unknown[0]}', it holds {', '.join(source.sensors)}"
            )
        with complete_directory(out, force, path) as work:
            writer = _Writer(path, work, chosen)
            broken = writer.write(source, options)
            report = {
                "source": str(path.resolve()),
                "kind": source.kind,
                "version": __version__,
                "complete": broken is None,
                "frames": writer.frames,
                "returns": writer.returns,
                "truth_rows": writer.truth_rows if source.truths else None,
                "notes": [*source.notes(), *writer.notes()],
                **source.facts(),
            }
            (work / "conversion.json").write_text(json.dumps(report, indent=2) + "\n")
    if broken is not None:
        kept = f"{sum(writer.frames.values())} frames and {writer.truth_rows} truth rows"
        raise InputError(f"{broken}; what could be read is in {out}: {kept}") from broken
    return report


class _Writer:
    """Writes frames and truth as they come, and counts them."""

    def __init__(self, path: Path, work: Path, sensors: list[str]) -> None:
        self._path, self._work = path, work
        self.frames = dict.fromkeys(sensors, 0)
        self.returns = dict.fromkeys(sensors, 0)
        self.truth_rows = 0
        self._written: dict[tuple[str, int], str] = {}
        self._truth_span: tuple[int, int] | None = None
        for name in sensors:
            (work / name).mkdir()

    def write(self, source: Source, options: Options) -> InputError | None:
        """All that the source gives; the error at which a broken one ends after some frames."""
        sensors = list(self.frames)
        said = f"Converting {self._path.name}"
        items = with_progress(source.items(sensors), source.total(sensors), said)
        broken = None
        with TruthFile(self._work / TRUTH_NAME, source.truths) as truth:
            try:
                for item in merged(items, options.merge):
                    if isinstance(item, TruthRow):
                        self._add_truth(item, truth)
                    else:
                        self._add_frame(item)
            except InputError as error:
                if not source.keeps_beginning:
                    raise
                broken = error
        if not any(self.frames.values()):
            if broken is not None:
                raise InputError(f"{broken}; no frame could be read") from broken
            if options.start_s or options.duration_s is not None:
                raise InputError(f"{self._path}: no frame lies in the time asked for")
        return broken

    def notes(self) -> list[str]:
        """Frames and truth of clocks that have nothing in common."""
        stamps = [stamp_ns for _, stamp_ns in self._written]
        if not stamps or self._truth_span is None:
            return []
        first, last = self._truth_span
        if first <= max(stamps) and min(stamps) <= last:
            return []
        return [
            f"no frame lies within the time of the truth: frames from {min(stamps) / 1e9:.3f} to "
            f"{max(stamps) / 1e9:.3f} s, truth from {first / 1e9:.3f} to {last / 1e9:.3f} s"
        ]

    def _add_truth(self, row: TruthRow, truth: TruthFile) -> None:
        truth.add(row)
        self.truth_rows += 1
        stamp_ns = parse_stamp_ns(row.stamp)
        first, last = self._truth_span or (stamp_ns, stamp_ns)
        self._truth_span = min(first, stamp_ns), max(last, stamp_ns)

    def _add_frame(self, frame: SourceFrame) -> None:
        key = (frame.sensor, parse_stamp_ns(frame.stamp))
        if key in self._written:
            raise InputError(
                f"{self._path}: two frames of {frame.sensor} at one time, "
                f"{self._written[key]} and {frame.stamp} "
                "(--stamp log may tell those of a bag apart)"
            )
        self._written[key] = frame.stamp
        kept = is_return(frame.xyz_m)
        columns = {name: column[kept] for name, column in frame.fields.items()}
        if OFFSET_FIELD in columns:
            columns[OFFSET_FIELD] = pcd_column(columns[OFFSET_FIELD])
        path = self._work / frame.sensor / f"{frame.stamp}.pcd"
        write_pcd(path, frame.xyz_m[kept], columns)
        self.frames[frame.sensor] += 1
        self.returns[frame.sensor] += int(kept.sum())
