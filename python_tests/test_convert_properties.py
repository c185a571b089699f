"""Laws of the converters over any clouds, layouts, stamps and names that hypothesis thinks of."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from bags import BEGIN_NS, Layout, plain_cloud, point_cloud, returns_of, write_bag
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from plyfile import PlyData, PlyElement
from unlidar.conversion import Options, convert
from unlidar.conversion.folder import _READERS
from unlidar.conversion.ply import read_ply
from unlidar.errors import InputError
from unlidar.frames_io import read_pcd, write_pcd
from unlidar.stamps import format_stamp_ns, parse_stamp_ns
from unlidar.truth import read_truth

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


@st.composite
def layouts(draw: st.DrawFn, rows: int) -> Layout:
    """Fields of any types in any order, with gaps, in one row or several, of either byte order."""
    others = draw(st.lists(st.sampled_from(["ring", "tag", "rgb"]), unique=True))
    names = draw(st.permutations(["x", "y", "z", *others]))
    upper = draw(st.booleans())
    fields, at = [], 0
    for name in names:
        kind = draw(st.sampled_from(("f4", "f8", "i2", "u1") if name in "xyz" else KINDS))
        at += draw(st.integers(0, 5))
        fields.append((name.upper() if upper else name, kind, at))
        at += np.dtype(kind).itemsize
    heights = [h for h in range(1, rows + 1) if rows % h == 0] or [1]
    return Layout(
        tuple(fields),
        step=at + draw(st.integers(0, 5)),
        height=draw(st.sampled_from(heights)),
        padding=draw(st.integers(0, 9)),
        big_endian=draw(st.booleans()),
    )


@settings(max_examples=40)
@given(st.data(), st.sampled_from(("ros1", "mcap-file", "db3-file", "mcap-of-ros1")))
def test_any_cloud_of_any_layout_arrives_in_pcd_point_by_point_under_its_stamp(data, form):
    messages, expected = [], {}
    stamps = st.integers(1, 2**31 * 10**9 - 1)
    for stamp_ns in data.draw(st.lists(stamps, min_size=1, max_size=3, unique=True)):
        rows = data.draw(st.integers(0, 12))
        layout = data.draw(layouts(rows))
        columns = {}
        for name, kind, _ in layout.fields:
            columns[name] = data.draw(arrays.arrays(np.dtype(kind), rows))
        messages.append(point_cloud("/p", stamp_ns, columns, layout, BEGIN_NS))
        with np.errstate(over="ignore"):
            lower = {name.lower(): column for name, column in columns.items()}
            xyz = np.stack([lower[axis].astype("f4") for axis in "xyz"], axis=1)
        kept = returns_of(xyz)
        is_tag = "tag" in lower and lower["tag"].dtype == np.uint8
        tags = lower["tag"][kept] if is_tag else None
        expected[stamp_ns] = (xyz[kept], tags)
    with folder() as at:
        convert(write_bag(at, form, messages), at / "out")
        found = {parse_stamp_ns(path.stem): path for path in (at / "out/p").iterdir()}
        assert set(found) == set(expected)
        for stamp_ns, (xyz, tags) in expected.items():
            fields = read_pcd(found[stamp_ns])
            np.testing.assert_array_equal(np.stack([fields[a] for a in "xyz"], axis=1), xyz)
            if len(xyz) == 0:
                continue  # a frame without returns need not say what they would have had
            assert ("tag" in fields) == (tags is not None)
            if tags is not None:
                np.testing.assert_array_equal(fields["tag"], tags)


@settings(max_examples=40)
@given(st.lists(st.integers(0, 2**31 * 10**9 - 1), min_size=1, max_size=12), st.booleans())
def test_of_any_stamps_each_is_one_frame_and_repeats_are_counted(stamps, files):
    xyz = np.ones((2, 3), "f4")
    with folder() as at:
        if files:
            (at / "rec").mkdir()
            for i, stamp_ns in enumerate(stamps):  # one stamp may be spelled in many ways
                name = f"{format_stamp_ns(stamp_ns)}{'0' * i}.npy"
                np.save(at / "rec" / name, xyz)
            source = at / "rec"
        else:
            # A header without a stamp has the log time.
            stamps = [stamp_ns or 1 for stamp_ns in stamps]
            clouds = [plain_cloud("/rec", s, xyz, BEGIN_NS + i) for i, s in enumerate(stamps)]
            source = write_bag(at, "mcap-file", clouds)
        report = convert(source, at / "out", options=Options(skip_bad=True))
        found = {parse_stamp_ns(path.stem) for path in (at / "out/rec").iterdir()}
    assert found == set(stamps)
    assert report["frames"] == {"rec": len(found)}
    assert report["left_out"].get("rec", 0) == len(stamps) - len(found)


@settings(max_examples=40)
@given(
    st.lists(st.tuples(st.integers(0, 2**62), st.lists(FLOATS, min_size=3, max_size=3)), max_size=9)
)
def test_truth_of_any_positions_keeps_every_digit(rows):
    with folder() as at:
        (at / "seq/lidar").mkdir(parents=True)
        np.save(at / "seq/lidar/1.5.npy", np.ones((1, 3)))
        lines = [f"{format_stamp_ns(ns)},{x!r},{y!r},{z!r}\n" for ns, (x, y, z) in rows]
        (at / "seq/ground_truth.csv").write_text("timestamp,x,y,z\n" + "".join(lines))
        if not all(np.isfinite(xyz).all() for _, xyz in rows):
            with pytest.raises(InputError, match=r"ground_truth\.csv"):
                convert(at / "seq", at / "out")
            return
        report = convert(at / "seq", at / "out")
        assert report["truth_rows"] == len(rows)
        if rows:
            truth = read_truth(at / "out/ground_truth.csv")
            np.testing.assert_array_equal(truth.xyz_m, [xyz for _, xyz in rows])
