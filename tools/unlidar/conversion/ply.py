"""PLY point clouds: the vertices of ascii and binary files.

Parsed by hand for speed: plyfile takes eight times as long for ascii vertices and also reads the
faces, row by row. The tests compare with it.
"""

import warnings
from collections.abc import Iterator
from io import BytesIO
from itertools import islice
from pathlib import Path

import numpy as np

from unlidar.errors import InputError, reason
from unlidar.limits import MOST_FRAME, MOST_HEADER, read_limited

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1",
    "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2",
    "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}


def read_ply(path: Path) -> dict[str, np.ndarray]:
    """The properties of the vertices by lower-case name, (N,) each.

    Throws InputError naming the file and the fault.
    """
    try:
        return _parse(read_limited(path, MOST_FRAME))
    except (OSError, ValueError, KeyError, IndexError, OverflowError) as error:
        raise InputError(f"{path}: not a readable PLY file: {reason(error)}") from error


def _parse(content: bytes) -> dict[str, np.ndarray]:
    end = content.find(b"end_header", 0, MOST_HEADER)
    if not content.startswith(b"ply") or end < 0:
        raise ValueError("it has no header from 'ply' to 'end_header'")
    body = content[content.index(b"\n", end) + 1 :]
    lines = [line.split() for line in content[:end].decode("ascii", "replace").splitlines()]
    encoding = next((words[1] for words in lines if words[:1] == ["format"]), "missing")
    if encoding != "ascii" and encoding not in _ORDERS:
        raise ValueError(f"its format is {encoding}, expected ascii or {' or '.join(_ORDERS)}")
    elements = _elements(lines)
    names = [name for name, _, _ in elements]
    if "vertex" not in names:
        raise ValueError(f"it has no element vertex, only {' '.join(names) or 'none'}")
    offset = 0
    for name, count, properties in elements:
        if any(kind == "list" for _, kind in properties):
            raise ValueError(f"element {name} before the vertices has lists")
        if encoding == "ascii":
            width = count
            if name == "vertex":
                lines = islice(BytesIO(body), offset, offset + count)
                return _ascii_columns(lines, count, properties)
        else:
            row = np.dtype([(p, _ORDERS[encoding] + _TYPES[kind]) for p, kind in properties])
            width = count * row.itemsize
            if name == "vertex":
                if len(body) < offset + width:
                    raise ValueError(f"{count} vertices announced, only {len(body)} bytes follow")
                rows = np.frombuffer(body, row, count, offset)
                return {p.lower(): rows[p] for p, _ in properties}
        offset += width
    raise AssertionError("unreachable: there is an element vertex")


def _elements(lines: list[list[str]]) -> list[tuple[str, int, list[tuple[str, str]]]]:
    """(name, count, [(property, type)]); of a list property the type is 'list'."""
    elements: list[tuple[str, int, list[tuple[str, str]]]] = []
    for words in lines:
        match words:
            case ["element", name, count]:
                if int(count) < 0:
                    raise ValueError(f"negative number of elements {count}")
                elements.append((name, int(count), []))
            case ["property", kind, *_, name]:
                elements[-1][2].append((name, kind))
    return elements


def _ascii_columns(
    lines: Iterator[bytes], count: int, properties: list[tuple[str, str]]
) -> dict[str, np.ndarray]:
    row = np.dtype([(name, _TYPES[kind]) for name, kind in properties])
    if not count or not properties:
        return {name.lower(): np.zeros(0, _TYPES[kind]) for name, kind in properties}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of an empty file, which is reported below
        # Surplus values in a line are ignored.
        rows = np.loadtxt(lines, row, comments=None, usecols=range(len(properties)), ndmin=1)
    if len(rows) < count:
        raise ValueError(f"{count} vertices announced, only {len(rows)} lines follow")
    return {name.lower(): rows[name] for name, _ in properties}
