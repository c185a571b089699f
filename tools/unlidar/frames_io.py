"""Frame directories: `<sensor>/<stamp>.pcd`, read and written without PCL."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np

from unlidar.errors import InputError, reason
from unlidar.frame_clock import stamps_of_table, times_of_names
from unlidar.limits import (
    MOST_FRAME,
    MOST_HEADER,
    MOST_LINE,
    MOST_RECORD,
    TooLargeError,
    read_limited,
    require_file,
)
from unlidar.names import folder_names
from unlidar.output import is_run

_NO_FIELDS: Mapping[str, np.ndarray] = MappingProxyType({})
_PIECE_BYTES = 1 << 20  # of a text parsed at a time
_IS_VALUE = bytes(code not in b" \t\n\r\v\f" for code in range(256))
_HEADER_KEYS = {"VERSION", "FIELDS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "VIEWPOINT",
                "POINTS", "DATA"}  # fmt: skip


@dataclass(frozen=True)
class FrameFile:
    """One frame of one sensor."""

    stamp_ns: int
    path: Path


def find_sensors(recording: Path) -> dict[str, Path]:
    """The frame directories of a recording by sensor name: its subfolders that hold PCD files.

    Those of runs, whose results may lie beside the frames, do not count.

    A folder that holds PCD files itself is a recording of one sensor. Sensors are called after
    their folders, as `folder_names` has it.
    """
    if _holds_pcd(recording):
        return {folder_names([recording.resolve().name])[0]: recording}
    folders = sorted(d for d in recording.iterdir() if d.is_dir() and not is_run(d))
    found = [d for d in folders if _holds_pcd(d)]
    return dict(zip(folder_names(d.name for d in found), found, strict=True))


def list_frames(directory: Path, rate_hz: float | None = None) -> list[FrameFile]:
    """The frames of a directory in order of time, by the same rules as the program.

    `rate_hz`: of frames that are numbered, as of `times_of_names`.
    """
    paths = sorted(directory.glob("*.pcd"))
    table = directory / "timestamps.csv"
    stamps_ns: Sequence[int | None]
    if table.is_file():
        stamps_ns = stamps_of_table(table, paths)
    else:
        stamps_ns = times_of_names(directory, [path.stem for path in paths], rate_hz).stamps_ns
    frames = []
    for stamp_ns, path in zip(stamps_ns, paths, strict=True):
        if stamp_ns is None:
            raise InputError(f"{path}: the name is no time stamp and there is no timestamps.csv")
        frames.append(FrameFile(stamp_ns, path))
    return sorted(frames, key=lambda f: (f.stamp_ns, f.path.name))


def write_pcd(path: Path, xyz_m: np.ndarray, fields: Mapping[str, np.ndarray] = _NO_FIELDS) -> None:
    """Writes a binary PCD v0.7 of x y z (float32), then `fields` in their own types, (N,) each."""
    columns = {name: np.asarray(column) for name, column in fields.items()}
    types = [np.dtype("<f4")] * 3 + [column.dtype.newbyteorder("<") for column in columns.values()]
    names = ["x", "y", "z", *columns]
    rows = np.empty(len(xyz_m), dtype=list(zip(names, types, strict=True)))
    for axis, name in enumerate("xyz"):
        rows[name] = xyz_m[:, axis]
    for name, column in columns.items():
        rows[name] = column
    header = (
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n"
        f"FIELDS {' '.join(names)}\nSIZE {' '.join(str(t.itemsize) for t in types)}\n"
        f"TYPE {' '.join(t.kind.upper() for t in types)}\nCOUNT {' '.join('1' for _ in types)}\n"
        f"WIDTH {len(rows)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(rows)}\nDATA binary\n"
    )
    with path.open("wb") as file:
        file.write(header.encode())
        file.write(rows.data)


def read_pcd(path: Path) -> dict[str, np.ndarray]:
    """The fields of a PCD file by lower-case name, (N,) each; of a field of count n, column 0.

    Throws InputError naming the file and the fault.
    """
    try:
        require_file(path)
        content = read_limited(path, MOST_FRAME)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read: {reason(error)}") from error
    try:
        return _parse_pcd(content)
    except (ValueError, KeyError, IndexError, OverflowError, TypeError) as error:
        raise InputError(f"{path}: not a readable PCD file: {reason(error)}") from error


def read_returns(path: Path) -> np.ndarray:
    """The returns of a PCD file, (N, 3) in m: finite and not 0, 0, 0 (a ray without a return)."""
    return keep_returns(positions_of(path, read_pcd(path)))


def positions_of(path: Path, fields: Mapping[str, np.ndarray]) -> np.ndarray:
    """The rows of a PCD file, (N, 3); InputError if a coordinate is missing."""
    missing = [axis for axis in "xyz" if axis not in fields]
    if missing:
        raise InputError(f"{path}: has no field {missing[0]}, expected x, y and z")
    return np.stack([fields[axis].astype(float) for axis in "xyz"], axis=1)


def keep_returns(xyz_m: np.ndarray) -> np.ndarray:
    """The rows that are returns."""
    return xyz_m[is_return(xyz_m)]


def is_return(xyz_m: np.ndarray) -> np.ndarray:
    """(N,) bool: rows that are finite and not 0, 0, 0 (a ray without a return)."""
    x, y, z = xyz_m.T
    finite = np.isfinite(x) & np.isfinite(y) & np.isfinite(z)
    return finite & ((x != 0) | (y != 0) | (z != 0))


def _holds_pcd(directory: Path) -> bool:
    return next(directory.glob("*.pcd"), None) is not None


def _parse_pcd(content: bytes) -> dict[str, np.ndarray]:
    header: dict[str, list[str]] = {}
    offset = 0
    while "DATA" not in header:
        end = content.find(b"\n", offset, MOST_HEADER)
        if end < 0:
            raise ValueError("the header has no DATA line")
        words = content[offset:end].decode("ascii", "replace").split()
        offset = end + 1
        if words and not words[0].startswith("#"):
            if words[0] not in _HEADER_KEYS:
                raise ValueError(f"unknown header line '{words[0][:40]}'")
            header[words[0]] = words[1:]

    names = [name.lower() for name in header["FIELDS"]]
    counts = [int(n) for n in header.get("COUNT", ["1"] * len(names))]
    points = _value_of(header, "WIDTH") * _value_of(header, "HEIGHT", 1)
    announced = _value_of(header, "POINTS", points)
    if announced != points:
        raise ValueError(f"WIDTH x HEIGHT is {points} and POINTS is {announced}")
    if points < 0:
        raise ValueError(f"negative number of points {points}")
    types = [
        np.dtype(f"<{kind.lower()}{size}")
        for kind, size in zip(header["TYPE"], header["SIZE"], strict=True)
    ]
    row = np.dtype(
        {
            "names": [f"{i}" for i in range(len(names))],
            "formats": [(t, (n,)) for t, n in zip(types, counts, strict=True)],
        }
    )
    body = content[offset:]
    match header["DATA"]:
        case ["ascii"]:
            columns = _ascii_columns(body, points, counts)
        case ["binary"]:
            if len(body) < points * row.itemsize:
                raise ValueError(f"{points} points announced, only {len(body)} bytes follow")
            rows = np.frombuffer(body, row, points)
            columns = [rows[f"{i}"][:, 0] if n else rows[f"{i}"] for i, n in enumerate(counts)]
        case ["binary_compressed"]:
            columns = _compressed_columns(body, points, types, counts)
        case other:
            raise ValueError(f"DATA {' '.join(other)}, expected ascii, binary or binary_compressed")
    return {name: column for name, column in zip(names, columns, strict=True) if name != "_"}


def _value_of(header: Mapping[str, list[str]], key: str, default: int | None = None) -> int:
    if key not in header and default is not None:
        return default
    if not header[key]:
        raise ValueError(f"the header's {key} has no value")
    return int(header[key][0])


def _ascii_columns(body: bytes, points: int, counts: list[int]) -> list[np.ndarray]:
    width = sum(counts)
    table = _rows(body, points, width)
    if len(table) < points:
        raise ValueError(f"{points} rows of {width} values announced, {len(table)} follow")
    return [table[:, first] for first in np.cumsum([0, *counts[:-1]])]


def _rows(body: bytes, most: int, width: int) -> np.ndarray:
    """The first lines of a text, parsed in pieces: Python objects take ten times the memory."""
    parts, begin, left = [np.zeros((0, width))], 0, most
    while begin < len(body) and left > 0:
        line_end = body.find(b"\n", begin + _PIECE_BYTES, begin + _PIECE_BYTES + MOST_LINE)
        end = line_end if line_end >= 0 else len(body)
        if end > begin + _PIECE_BYTES + MOST_LINE:
            raise ValueError(f"a line of more than {MOST_LINE:,} bytes")
        piece = _lines_of(body[begin:end], left, width)
        if b"_" in piece:  # Python takes 1_000 for a number
            raise ValueError("a value with '_', expected numbers")
        parts.append(np.array(piece.split(), dtype=float).reshape(-1, width))
        begin, left = end, left - len(parts[-1])
    return np.concatenate(parts)


def _lines_of(text: bytes, most: int, width: int) -> bytes:
    """A text up to its line number `most` that is not blank; ValueError for another width."""
    codes = np.frombuffer(text + b"\n", np.uint8)
    is_value = np.frombuffer(text.translate(_IS_VALUE), bool)
    begins = np.flatnonzero(np.diff(is_value, prepend=False) & is_value)
    ends = np.flatnonzero(codes == ord("\n"))
    widths = np.diff(np.searchsorted(begins, ends), prepend=0)
    ends, widths = ends[widths > 0][:most], widths[widths > 0][:most]
    if len(odd := widths[widths != width]):
        raise ValueError(f"a row of {odd[0]} values, expected {width}")
    return text[: ends[-1]] if len(ends) else b""


def _compressed_columns(
    body: bytes, points: int, types: list[np.dtype], counts: list[int]
) -> list[np.ndarray]:
    """A binary_compressed file holds its fields one after another, compressed with LZF."""
    packed, size = (int(v) for v in np.frombuffer(body, "<u4", 2))
    expected = points * sum(t.itemsize * n for t, n in zip(types, counts, strict=True))
    if size > MOST_RECORD:
        raise TooLargeError("it, unpacked,", size, MOST_RECORD)
    if size != expected or packed > len(body) - 8:
        raise ValueError(f"{size} bytes in {packed} compressed, expected {expected} bytes")
    plain = _lzf_decompress(body[8 : 8 + packed], size)
    columns, offset = [], 0
    for kind, count in zip(types, counts, strict=True):
        columns.append(np.frombuffer(plain, kind, points * count, offset).reshape(points, -1)[:, 0])
        offset += points * count * kind.itemsize
    return columns


def _lzf_decompress(packed: bytes, size: int) -> bytes:
    out = bytearray()
    i = 0
    while i < len(packed):
        control = packed[i]
        i += 1
        if control < 32:  # a run of literal bytes
            out += packed[i : i + control + 1]
            i += control + 1
            continue
        length = control >> 5
        if length == 7:
            length += packed[i]
            i += 1
        start = len(out) - ((control & 31) << 8) - packed[i] - 1
        i += 1
        if start < 0:
            raise ValueError("a back reference in the compressed data points before its start")
        for k in range(start, start + length + 2):  # source and destination may overlap
            out.append(out[k])
        if len(out) > size:
            break
    if len(out) != size:
        raise ValueError(f"compressed data holds {len(out)} bytes, expected {size}")
    return bytes(out)
