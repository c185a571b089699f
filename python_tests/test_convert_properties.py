"""Laws of the converters over any clouds, layouts, stamps and names that hypothesis thinks of."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from plyfile import PlyData, PlyElement
from unlidar_tools.convert.folder import _READERS
from unlidar_tools.convert.ply import read_ply
from unlidar_tools.errors import InputError
from unlidar_tools.frames_io import read_pcd, write_pcd

KINDS = ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")
NAMES = st.from_regex(r"[a-wA-W][a-zA-Z_0-9]{0,8}", fullmatch=True)
FLOATS = st.floats(width=32)


@contextmanager
def folder() -> Iterator[Path]:
    """A fresh one for each example: tmp_path is that of all."""
    with tempfile.TemporaryDirectory() as name:
        yield Path(name)


@st.composite
def tables(draw: st.DrawFn, kinds: tuple[str, ...] = KINDS, **named: int) -> np.ndarray:
    """Rows with x, y, z and other columns of any types, in any order."""
    others = draw(st.lists(NAMES, unique_by=str.lower, max_size=4))
    columns = draw(st.permutations(["x", "y", "z", *others]))
    layout = [(c, draw(st.sampled_from(("f4", "f8") if c in "xyz" else kinds))) for c in columns]
    return draw(arrays.arrays(np.dtype(layout), st.integers(0, 20), **named))


@given(tables(), st.sampled_from(("<", ">", "=")), st.booleans(), st.booleans())
@settings(max_examples=60)
@pytest.mark.filterwarnings("ignore:loadtxt")  # of plyfile, for no rows
def test_a_ply_file_reads_as_plyfile_wrote_it(rows, order, text, faces):
    elements = [PlyElement.describe(rows, "vertex")]
    if faces:
        found = np.empty(2, dtype=[("vertex_indices", "O")])
        found["vertex_indices"] = [np.array([0, 1, 2], "i4"), np.array([], "i4")]
        elements.append(PlyElement.describe(found, "face", val_types={"vertex_indices": "i4"}))
    with folder() as at:
        PlyData(elements, text=text, byte_order=order).write(str(at / "a.ply"))
        oracle = PlyData.read(str(at / "a.ply"))["vertex"]
        columns = read_ply(at / "a.ply")
    assert list(columns) == [name.lower() for name in rows.dtype.names]
    for name in rows.dtype.names:
        np.testing.assert_array_equal(columns[name.lower()], oracle[name])
        assert columns[name.lower()].dtype.newbyteorder("=") == rows.dtype[name]


@given(tables())
def test_a_pcd_file_reads_as_it_was_written(rows):
    with np.errstate(over="ignore"):
        xyz = np.stack([rows[axis].astype("f4") for axis in "xyz"], axis=1)
    others = {name: rows[name] for name in rows.dtype.names if name not in "xyz"}
    with folder() as at:
        write_pcd(at / "a.pcd", xyz, others)
        fields = read_pcd(at / "a.pcd")
    assert list(fields) == ["x", "y", "z", *(name.lower() for name in others)]
    np.testing.assert_array_equal(np.stack([fields[axis] for axis in "xyz"], axis=1), xyz)
    for name, column in others.items():
        np.testing.assert_array_equal(fields[name.lower()], column)
        assert fields[name.lower()].dtype == column.dtype


HEADS = {
    ".pcd": b"VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 1\n"
    b"POINTS 2\nDATA binary\n",
    ".ply": b"ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
    b"property float z\nend_header\n",
    ".bin": b"",
    ".npy": b"\x93NUMPY\x01\x00v\x00{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3), }",
}


@pytest.mark.parametrize("suffix", _READERS)
@given(data=st.data())
@settings(max_examples=150)
def test_no_bytes_make_a_reader_of_files_fail_but_by_name(suffix, data):
    head = bytearray(HEADS[suffix])
    for at, byte in data.draw(st.lists(st.tuples(st.integers(0, 200), st.integers(0, 255)))):
        if head:
            head[at % len(head)] = byte
    content = bytes(head) + data.draw(st.binary(max_size=60) | st.from_regex(rb"[0-9. \n-]*"))
    with folder() as below:
        path = below / f"1.5{suffix}"
        path.write_bytes(content)
        try:
            columns = _READERS[suffix](path)
        except InputError as error:
            assert str(path) in str(error)
            assert "\n" not in str(error)
        else:
            assert len({len(column) for column in columns.values()}) <= 1
