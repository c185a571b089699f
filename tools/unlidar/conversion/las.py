"""LAS and LAZ files, whose points carry GPS times: cut into frames of a tenth of a second."""

import struct
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import ClassVar

import numpy as np

from unlidar.conversion.files import refuse_bag_options
from unlidar.conversion.one_file import OneFileSource, up_to_damage
from unlidar.conversion.source import Options, SourceFrame
from unlidar.errors import InputError, reason
from unlidar.extras import load_extra
from unlidar.limits import MOST_RECORD, MOST_TEXT
from unlidar.names import folder_names
from unlidar.point_times import OFFSET_FIELD
from unlidar.stamps import format_stamp_ns

_FRAME_NS = 100_000_000
_OPEN_FRAMES = 10  # frames kept open: points up to a second late are sorted in
CHUNK_POINTS = 1 << 20  # read at a time
_FARTHEST_M = 10_000.0  # float32 resolves a millimetre up to here
# Signature, global encoding, version, size of the header, where the points begin, number of records
# before them, format of the points.
_HEAD = struct.Struct("<4s2xH16xBB68xHIIB")
_LEAST_HEADER, _LEAST_RECORD = 227, 54
_PACKED = 0x80  # of the format of points of a LAZ file

_WEEK_S = 604_800
_GPS_EPOCH_S, _ADJUSTED_S = 315_964_800, 1_000_000_000  # 1980-01-06; offset of standard GPS time
# Leap seconds: (GPS seconds, offset of GPS time from UTC from then on).
_LEAP_S = ((-np.inf, 13), (820_108_814, 14), (914_803_215, 15), (1_025_136_016, 16),
           (1_119_744_017, 17), (1_167_264_018, 18))  # fmt: skip

# Times in nanoseconds, positions in metres.
_Points = tuple[np.ndarray, np.ndarray]


class LasFile(OneFileSource):
    """The points of one LiDAR in its own frame, named after its file."""

    kind: ClassVar[str] = "LAS"
    description: ClassVar[str] = "a LAS file of points with times (.las, .laz)"
    _holds: ClassVar[str] = "points"

    @classmethod
    def matches(cls, path: Path) -> bool:
        """True if the suffix is .las or .laz."""
        return path.suffix.lower() in (".las", ".laz") and path.is_file()

    def __init__(self, path: Path, options: Options) -> None:
        refuse_bag_options(path, options, "holds points")
        self._laspy = _laspy(path)
        self._path, self._options = path, options
        self._is_standard, self._is_week = _check_header(path), False
        numbers: set[int] = set()
        oldest_ns, newest_ns, count, self._is_in_order = 1 << 62, -(1 << 62), 0, True
        with up_to_damage(numbers):
            for times_ns, _ in self._chunks():
                highest_ns = np.maximum(np.maximum.accumulate(times_ns), newest_ns)
                late = bool((times_ns < highest_ns - _OPEN_FRAMES * _FRAME_NS).any())
                self._is_in_order = self._is_in_order and not late
                oldest_ns = min(oldest_ns, int(times_ns.min()))
                newest_ns, count = int(highest_ns[-1]), count + len(times_ns)
                numbers.update(np.unique(times_ns // _FRAME_NS).tolist())
        if not numbers:
            raise InputError(f"{path}: holds no points, expected some")
        if count > 1 and oldest_ns == newest_ns:
            raise InputError(f"{path}: its {count} points have one time, expected each its own")
        self._begin_ns = min(numbers) * _FRAME_NS
        self.sensors = {folder_names([path.stem])[0]: len(numbers)}
        self._spans_ns = dict.fromkeys(self.sensors, (oldest_ns, newest_ns))

    def items(self, sensors: list[str]) -> Iterator[SourceFrame]:
        """Frames in order of time; an unordered file is held in memory for that."""
        window = self._options.window(self._begin_ns)
        chunks = self._chunks() if self._is_in_order else iter([self._sorted()])
        for name in sensors:
            for number, (times_ns, xyz_m) in _frames(chunks):
                stamp_ns = number * _FRAME_NS
                if stamp_ns in window:
                    offsets = {OFFSET_FIELD: times_ns - stamp_ns}
                    yield SourceFrame(name, format_stamp_ns(stamp_ns), xyz_m, offsets)

    def notes(self) -> list[str]:
        """A note on the time base assumed."""
        if self._is_standard:
            return []
        taken = "seconds of a GPS week" if self._is_week else "Unix time"
        return [
            f"{self._path.name}: its header does not say that its times are standard GPS time, "
            f"taken for {taken}"
        ]

    def _chunks(self) -> Iterator[_Points]:
        """Chunks in the order of the file; InputError at damage."""
        read = 0
        try:
            with self._laspy.open(self._path, read_evlrs=False) as file:
                count = file.header.point_count
                at_once = min(CHUNK_POINTS, max(1, MOST_RECORD // file.header.point_format.size))
                while read < count:
                    points = file.read_points(min(at_once, count - read))
                    if len(points) == 0:
                        break
                    read += len(points)
                    times_s = np.asarray(points.gps_time)
                    xyz_m = np.stack([points.x, points.y, points.z], axis=1)
                    self._check(times_s, xyz_m)
                    yield self._unix_ns(times_s), xyz_m.astype(np.float32)
        except (InputError, KeyboardInterrupt, GeneratorExit):
            raise
        except BaseException as error:  # damage makes lazrs panic, which is no Exception
            raise InputError(f"{self._path}: cannot be read: {reason(error)}") from error
        if read < count:
            raise InputError(f"{self._path}: ends after {read} of {count} points")

    def _check(self, times_s: np.ndarray, xyz_m: np.ndarray) -> None:
        if not np.isfinite(times_s).all() or np.abs(times_s).max() > 4e9:
            raise InputError(f"{self._path}: a point has a time that is none, expected GPS times")
        if np.median(np.abs(xyz_m).max(axis=1)) > _FARTHEST_M:
            x, y, z = (f"{v:.0f}" for v in np.median(xyz_m, axis=0))
            raise InputError(
                f"{self._path}: the points lie about {x}, {y}, {z} m, expected them in the "
                "LiDAR's own frame, less than 10 km away"
            )

    def _unix_ns(self, times_s: np.ndarray) -> np.ndarray:
        if not self._is_standard:
            self._is_week = bool(times_s.max() <= _WEEK_S)
            return np.rint(times_s * 1e9).astype(np.int64)
        gps_s = times_s + _ADJUSTED_S
        begins, ahead_s = zip(*_LEAP_S, strict=True)
        leap_s = np.array(ahead_s)[np.searchsorted(begins, gps_s, side="right") - 1]
        whole_s = np.floor(times_s)
        unix_s = whole_s.astype(np.int64) + (_ADJUSTED_S + _GPS_EPOCH_S) - leap_s
        return unix_s * 10**9 + np.rint((times_s - whole_s) * 1e9).astype(np.int64)

    def _sorted(self) -> _Points:
        times_ns, xyz_m = (np.concatenate(part) for part in zip(*self._chunks(), strict=True))
        order = np.argsort(times_ns, kind="stable")
        return times_ns[order], xyz_m[order]


def _check_header(path: Path) -> bool:
    """True if times are standard GPS time; InputError for headers that laspy cannot handle."""
    try:
        with path.open("rb") as file:
            head = file.read(_LEAST_HEADER)
            size = path.stat().st_size
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {reason(error)}") from error
    if len(head) < _LEAST_HEADER or not head.startswith(b"LASF"):
        raise InputError(f"{path}: does not begin as LAS files do, expected 'LASF' and a header")
    _, encoding, major, minor, header, begin, records, form = _HEAD.unpack_from(head)
    if major != 1 or minor > 4:
        raise InputError(f"{path}: has version {major}.{minor}, expected 1.0 to 1.4")
    if begin > MOST_TEXT:
        raise InputError(f"{path}: its header has {begin} bytes, expected at most {MOST_TEXT}")
    if not header + records * _LEAST_RECORD <= begin <= size:
        raise InputError(f"{path}: its header does not fit its {size} bytes")
    if form & _PACKED:
        _check_chunks(path, begin, size)
    if form & ~_PACKED in (0, 2):
        raise InputError(
            f"{path}: has points of format {form & ~_PACKED}, which have no times, expected format "
            "1 or 3 to 10"
        )
    return bool(encoding & 1)


def _check_chunks(path: Path, begin: int, size: int) -> None:
    """Checks the chunk table's size: lazrs allocates what it declares, and aborts on failure."""
    with path.open("rb") as file:
        file.seek(begin)
        at = int.from_bytes(file.read(8), "little", signed=True)
        if at == -1:  # a streaming writer puts the offset at the end of the file
            file.seek(-8, 2)
            at = int.from_bytes(file.read(8), "little", signed=True)
        if begin < at <= size - 8:
            file.seek(at + 4)
            if int.from_bytes(file.read(4), "little") <= size:
                return
    raise InputError(f"{path}: has no table of its chunks at its byte {begin}, or a broken one")


def _frames(chunks: Iterator[_Points]) -> Iterator[tuple[int, _Points]]:
    """Frame numbers with their points, as they become complete or the file breaks off."""
    waiting: dict[int, list[_Points]] = {}
    broken = None
    try:
        for times_ns, xyz_m in chunks:
            numbers = times_ns // _FRAME_NS
            order = np.argsort(numbers, kind="stable")
            found, begins = np.unique(numbers[order], return_index=True)
            for number, rows in zip(found.tolist(), np.split(order, begins[1:]), strict=True):
                waiting.setdefault(number, []).append((times_ns[rows], xyz_m[rows]))
            complete = [n for n in sorted(waiting) if n < max(waiting) - _OPEN_FRAMES]
            yield from ((n, _joined(waiting.pop(n))) for n in complete)
    except InputError as error:
        broken = error
    yield from ((n, _joined(waiting[n])) for n in sorted(waiting))
    if broken is not None:
        raise broken


def _joined(parts: list[_Points]) -> _Points:
    times_ns, xyz_m = zip(*parts, strict=True)
    return np.concatenate(times_ns), np.concatenate(xyz_m)


def _laspy(path: Path) -> ModuleType:
    missing = f"{path}: needs the Python packages laspy and lazrs"
    load_extra("lazrs", "las", missing)  # laspy's decoder of .laz
    return load_extra("laspy", "las", missing)
