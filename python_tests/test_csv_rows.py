"""Every table that is read refuses what is no table of its columns, by file and line."""

import os
import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from unlidar.conversion.files import truth_targets
from unlidar.csv_rows import Row, csv_rows, numbered_lines
from unlidar.errors import InputError
from unlidar.evaluation.sequences import read_manifest
from unlidar.export.mmaud import read_stamps
from unlidar.frame_clock import stamps_of_table
from unlidar.truth import read_tracks, read_truth

# By what is read: how, its columns, and the values of a row.
READERS: dict[str, tuple[Callable[[Path], object], str, str]] = {
    "truth": (read_truth, "timestamp,x,y,z", "1,2,3,4"),
    "trajectory": (read_tracks, "timestamp,x,y,z", "1,2,3,4"),
    "truth of a folder": (lambda p: truth_targets(p.parent), "timestamp,x,y,z", "1,2,3,4"),
    "stamps of files": (lambda p: stamps_of_table(p, [Path("1.pcd")]), "file,timestamp", "1.pcd,1"),
    "manifest": (read_manifest, "truth,trajectory", "a.csv,b.csv"),
    "stamps of a challenge": (lambda p: read_stamps(p, ["a"]), "Sequence,Timestamp", "a,1.5"),
    "clusters": (lambda p: list(csv_rows(p)), "rank,score", "1,2"),
}
DAMAGE = {
    "a value less": (lambda row: row.rpartition(",")[0], "values, expected"),
    "a value more": (lambda row: row + ",1", "values, expected"),
    "no UTF-8": (lambda row: row + "\udcff", "has the byte 0xff, expected UTF-8 text"),
    "a NUL": (lambda row: row + "\0", "has the byte 0x00, expected UTF-8 text"),
    "an open quote": (lambda row: row.rpartition(",")[0] + ',"1', "no row of a CSV file"),
    "a long line": (lambda row: row + " " * 70_000, "has more than 65,536 characters"),
}


def table(folder: Path, *lines: str) -> Path:
    path = folder / "ground_truth.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8", errors="surrogateescape")
    return path


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("damage", DAMAGE)
def test_a_damaged_row_is_refused_by_file_and_line(
    reader: str, damage: str, tmp_path: Path
) -> None:
    read, columns, row = READERS[reader]
    spoil, named = DAMAGE[damage]
    read(table(tmp_path, columns, "", row))
    path = table(tmp_path, columns, "", spoil(row))
    with pytest.raises(InputError) as refused:
        read(path)
    assert str(refused.value).startswith(f"{path}:3: ")
    assert named in str(refused.value)


@pytest.mark.parametrize("reader", READERS)
def test_a_column_that_comes_twice_is_refused(reader: str, tmp_path: Path) -> None:
    read, columns, row = READERS[reader]
    name, value = columns.split(",")[0], row.split(",")[0]
    path = table(tmp_path, f"{columns},{name}", f"{row},{value}")
    with pytest.raises(InputError, match=f"has a second column {name}, expected each name once"):
        read(path)


@pytest.mark.parametrize("reader", [name for name in READERS if name != "clusters"])
def test_a_missing_column_is_named_with_what_is_there(reader: str, tmp_path: Path) -> None:
    read, columns, _ = READERS[reader]
    last = columns.split(",")[-1]
    for other, found in (
        ("a,b", "it has a, b"),
        ("1,2.5", "its first line is 2 numbers"),
        ("1_000,inf", "it has 1_000, inf"),
    ):
        with pytest.raises(InputError, match=f"has no column {last}|no column .*, {found}"):
            read(table(tmp_path, other, "1,2"))


def test_a_table_may_come_through_a_pipe_where_that_is_meant(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(InputError, match="a pipe"):
        next(csv_rows(pipe))
    writer = threading.Thread(target=pipe.write_text, args=("a,b\n1,2\n \n3,4\n",))
    writer.start()
    rows = list(csv_rows(pipe, lines=numbered_lines(pipe, pipes=True)))
    writer.join()
    assert [(row.line, row.values) for row in rows] == [
        (2, {"a": "1", "b": "2"}),
        (4, {"a": "3", "b": "4"}),  # the line between is blank
    ]


@pytest.mark.parametrize("reader", READERS)
def test_blanks_about_names_are_none_of_them(reader: str, tmp_path: Path) -> None:
    read, columns, row = READERS[reader]
    plain = repr(read(table(tmp_path, columns, row)))
    assert repr(read(table(tmp_path, columns.replace(",", ", ") + " ", row))) == plain


@pytest.mark.parametrize("reader", READERS)
def test_bytes_of_spreadsheets_change_nothing(reader: str, tmp_path: Path) -> None:
    read, columns, row = READERS[reader]
    plain = repr(read(table(tmp_path, columns, row)))
    path = tmp_path / "ground_truth.csv"
    path.write_bytes(f"\ufeff{columns}\r\n{row}\r\n".encode())
    assert repr(read(path)) == plain


def test_utf_16_is_refused_in_its_first_line(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("timestamp,x,y,z\n1,2,3,4\n", encoding="utf-16")
    for read in (read_truth, lambda path: list(csv_rows(path))):
        with pytest.raises(InputError, match=r"t\.csv:1: has the byte 0xff, expected UTF-8 text"):
            read(path)


@pytest.mark.parametrize("text", ["", "abc", "nan", "inf", "1_000", "1,5", "0x10"])
def test_only_finite_numbers_are_numbers(text: str) -> None:
    row = Row(Path("t.csv"), 7, {"x": text})
    with pytest.raises(InputError, match=f"t.csv:7: x is '{text}', expected a finite number"):
        row.number("x")
    assert Row(Path("t.csv"), 7, {"x": " -1.5e2 "}).number("x") == -150
    assert row.number("y", 3.0) == 3


@pytest.mark.parametrize("target", ["0.5", "-1", "nan", "a", "1e300", "2147483648"])
def test_targets_of_a_recording_are_whole_numbers(target: str, tmp_path: Path) -> None:
    path = table(tmp_path, "timestamp,x,y,z,target", "1,2,3,4,0", f"2,2,3,4,{target}")
    with pytest.raises(InputError, match=f"{path}:3: target is "):
        truth_targets(path.parent)
    assert truth_targets(table(tmp_path, "timestamp,x,y,z,target", "1,2,3,4,2").parent) == 3
