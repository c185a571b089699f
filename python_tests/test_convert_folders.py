"""Folders of PCD, PLY, KITTI's .bin and .npy: the same points, stamps from names or lists."""

import os
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from bags import random_points, read_xyz, returns_of
from unlidar.cli import main
from unlidar.conversion import Options, convert
from unlidar.errors import InputError
from unlidar.frames_io import list_frames, read_pcd, write_pcd

STAMPS = ("1706255621.600227123", "1706255621700000000", "1706255622")
NAMES = ("1706255621.600227123.pcd", "1706255621.700000000.pcd", "1706255622.000000000.pcd")
CLOUDS = [random_points(seed) for seed in range(3)]


def write_ply(path: Path, xyz: np.ndarray, encoding: str, kind: str = "float") -> None:
    order = ">" if "big" in encoding else "<"
    head = (
        f"ply\nformat {encoding} 1.0\ncomment made by hand\nelement sensor 2\nproperty uchar id\n"
        f"element vertex {len(xyz)}\nproperty uchar red\nproperty {kind} x\nproperty {kind} y\n"
        f"property {kind} z\nelement face 1\nproperty list uchar int vertex_index\nend_header\n"
    )
    code = "d" if kind == "double" else "f"
    if encoding == "ascii":
        rows = "".join("9 " + " ".join(repr(float(v)) for v in p) + "\n" for p in xyz)
        path.write_bytes((head + "1\n2\n" + rows + "3 0 1 2\n").encode())
        return
    body = b"".join(struct.pack(f"{order}B3{code}", 9, *(float(v) for v in p)) for p in xyz)
    path.write_bytes(head.encode() + b"\1\2" + body + struct.pack(f"{order}B3i", 3, 0, 1, 2))


def write_kitti(path: Path, xyz: np.ndarray) -> None:
    path.write_bytes(np.column_stack([xyz, np.full(len(xyz), 0.5)]).astype("<f4").tobytes())


WRITERS = {
    "pcd": (".pcd", write_pcd),
    "ply ascii": (".ply", lambda p, xyz: write_ply(p, xyz, "ascii")),
    "ply little endian": (".ply", lambda p, xyz: write_ply(p, xyz, "binary_little_endian")),
    "ply big endian": (".ply", lambda p, xyz: write_ply(p, xyz, "binary_big_endian", "double")),
    "kitti": (".bin", write_kitti),
    "npy": (".npy", lambda p, xyz: np.save(p.with_suffix(p.suffix), xyz)),
}


def make_folder(folder: Path, form: str, stamps: tuple[str, ...] = STAMPS) -> Path:
    suffix, write = WRITERS[form]
    folder.mkdir(parents=True)
    for stamp, xyz in zip(stamps, CLOUDS, strict=True):
        write(folder / f"{stamp}{suffix}", xyz)
    return folder


def check_frames(folder: Path, names: tuple[str, ...] = NAMES) -> None:
    assert sorted(path.name for path in folder.iterdir()) == sorted(names)
    for name, xyz in zip(names, CLOUDS, strict=True):
        np.testing.assert_array_equal(read_xyz(folder / name), xyz[returns_of(xyz)])


@pytest.mark.parametrize("form", WRITERS)
def test_every_kind_of_file_gives_its_returns_under_its_exact_stamp(form, tmp_path):
    folder = make_folder(tmp_path / "station/mid360", form)
    report = convert(folder, tmp_path / "one")
    assert report["frames"] == {"mid360": 3}
    check_frames(tmp_path / "one/mid360")
    make_folder(tmp_path / "station/avia", form)
    (tmp_path / "station/ground_truth.csv").write_text("timestamp,x,y,z\n1706255620.5,1,2,0.1\n")
    assert set(convert(tmp_path / "station", tmp_path / "two")["frames"]) == {"avia", "mid360"}
    check_frames(tmp_path / "two/avia")
    truth = (tmp_path / "two/ground_truth.csv").read_text()
    assert truth == "timestamp,x,y,z\n1706255620.5,1.0,2.0,0.1\n"


def test_truth_of_a_folder_may_be_one_file_per_stamp(tmp_path):
    make_folder(tmp_path / "seq/mid360", "npy")
    (tmp_path / "seq/ground_truth").mkdir()
    np.save(tmp_path / "seq/ground_truth/1706255621.7.npy", np.array([1.0, 2.0, 3.0]))
    assert convert(tmp_path / "seq", tmp_path / "out")["truth_rows"] == 1


def test_what_truth_says_of_targets_and_view_comes_along(tmp_path, fails):
    make_folder(tmp_path / "seq/mid360", "npy")
    table = tmp_path / "seq/ground_truth.csv"
    text = "timestamp,x,y,z,target,in_view\n1.5,1.0,2.0,3.0,0,0\n1.5,1.0,2.0,3.0,1,1\n"
    table.write_text(text)
    convert(tmp_path / "seq", tmp_path / "out")
    assert (tmp_path / "out/ground_truth.csv").read_text() == text
    for wrong in ("nan", "-inf"):
        table.write_text(text.replace("2.0", wrong, 1))
        line = fails(4, "convert", tmp_path / "seq", tmp_path / "none")
        assert f"ground_truth.csv:2: y is '{wrong}', expected a finite number" in line


def test_numbered_files_are_frames_of_the_rate_that_is_said_or_given(tmp_path, capsys):
    folder = make_folder(tmp_path / "velodyne", "kitti", ("000000", "000001", "000010"))
    assert main(["convert", str(folder), str(tmp_path / "out")]) == 0
    assert "10 frames a second" in capsys.readouterr().err
    check_frames(
        tmp_path / "out/velodyne", ("0.000000000.pcd", "0.100000000.pcd", "1.000000000.pcd")
    )
    assert main(["convert", str(folder), str(tmp_path / "slow"), "--rate", "0.5"]) == 0
    assert capsys.readouterr().err == ""
    check_frames(
        tmp_path / "slow/velodyne", ("0.000000000.pcd", "2.000000000.pcd", "20.000000000.pcd")
    )


@pytest.mark.parametrize("rate", ["1e-300", "1e300"])
def test_a_rate_that_no_sensor_has_is_refused(rate, tmp_path, fails):
    folder = make_folder(tmp_path / "seq", "npy", ("1", "2", "3"))
    assert "--rate" in fails(4, "convert", folder, tmp_path / "out", "--rate", rate)


def test_kitti_lists_of_stamps_belong_to_the_files_in_order(tmp_path, fails):
    drive = tmp_path / "drive"
    make_folder(drive / "velodyne_points/data", "kitti", ("0000", "0001", "0002"))
    listed = drive / "velodyne_points/timestamps.txt"
    listed.write_text(
        "2011-09-26 13:02:25.964389445\n2011-09-26 13:02:26.067\n2011-09-26 13:02:26.170719132\n"
    )
    assert set(convert(drive, tmp_path / "out")["frames"]) == {"velodyne_points"}
    check_frames(
        tmp_path / "out/velodyne_points",
        ("1317042145.964389445.pcd", "1317042146.067000000.pcd", "1317042146.170719132.pcd"),
    )
    listed.unlink()
    (drive / "velodyne_points/times.txt").write_text("0.0\n1.036224e-01\n2.0e-01\n")
    convert(drive, tmp_path / "odometry")
    check_frames(
        tmp_path / "odometry/velodyne_points",
        ("0.000000000.pcd", "0.103622400.pcd", "0.200000000.pcd"),
    )
    (drive / "velodyne_points/times.txt").write_text("0.0\n1.0\n")
    assert "2 stamps for 3 files" in fails(4, "convert", drive, tmp_path / "none")


def test_a_table_of_stamps_goes_before_the_names(tmp_path):
    folder = make_folder(tmp_path / "seq", "ply ascii", ("a", "b", "c"))
    rows = zip(("a.ply", "b.ply", "c.ply"), STAMPS, strict=True)
    (folder / "timestamps.csv").write_text(
        "file,timestamp\n" + "".join(f"{name},{stamp}\n" for name, stamp in rows)
    )
    convert(folder, tmp_path / "out")
    check_frames(tmp_path / "out/seq")


def test_a_row_of_a_table_of_stamps_for_a_file_that_is_missing_is_refused(tmp_path, fails):
    folder = make_folder(tmp_path / "seq", "npy", ("a", "b", "gone"))
    (folder / "gone.npy").unlink()
    rows = zip(("a.npy", "b.npy", "gone.npy"), STAMPS, strict=True)
    text = "".join(f"{name},{stamp}\n" for name, stamp in rows)
    (folder / "timestamps.csv").write_text("file,timestamp\n" + text)
    assert "'gone.npy' is no frame" in fails(4, "convert", folder, tmp_path / "out")


@pytest.mark.parametrize("name", ["a.db3", "a.bag", "a.mcap", "a.pcap", "a.las", "a.pcd", "a"])
def test_a_pipe_is_no_recording_and_is_not_waited_for(name, tmp_path):
    os.mkfifo(tmp_path / name)
    command = [sys.executable, "-m", "unlidar", "convert", tmp_path / name, tmp_path / "out"]
    result = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert result.returncode == 4
    assert result.stderr.count("\n") == 1 and "is a pipe" in result.stderr


@pytest.mark.parametrize("name", ["1.5.npy", "1.5.pcd"])
def test_a_pipe_among_the_frames_is_not_waited_for(name, tmp_path):
    (tmp_path / "seq").mkdir()
    os.mkfifo(tmp_path / "seq" / name)
    command = [sys.executable, "-m", "unlidar", "convert", tmp_path / "seq", tmp_path / "out"]
    result = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert result.returncode == 4
    assert result.stderr.count("\n") == 1 and "is a pipe" in result.stderr


@pytest.mark.parametrize("row", ["", "000000.npy,today\n"])
def test_a_table_of_stamps_has_a_stamp_for_every_file(row, tmp_path, fails):
    """The number in a name is no time beside those of a table."""
    folder = make_folder(tmp_path / "seq", "npy", ("000000", "b", "c"))
    (folder / "timestamps.csv").write_text(f"file,timestamp\nb.npy,{STAMPS[0]}\n{row}")
    line = fails(4, "convert", folder, tmp_path / "out")
    assert "timestamps.csv" in line
    assert "'000000.npy'" in line


HEAD = "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"


@pytest.mark.parametrize(
    ("rest", "said"),
    [
        ("WIDTH 2\nDATA ascii\n1 2 3 9\n4 5 6 9\n", "a row of 4 values, expected 3"),
        ("WIDTH 2\nDATA ascii\n1 2\n3 4 5 6\n", "a row of 2 values, expected 3"),
        ("WIDTH 2\nDATA ascii\n1 2 3\n\n", "2 rows of 3 values announced, 1 follow"),
        ("WIDTH 1\nDATA ascii\n1_0 2 3\n", "a value with '_', expected numbers"),
        ("WIDTH 1\nPOINTS 2\nDATA ascii\n1 2 3\n", "WIDTH x HEIGHT is 1 and POINTS is 2"),
        ("WIDTH 1\nPOINTS\nDATA ascii\n1 2 3\n", "the header's POINTS has no value"),
        ("WIDTH\nDATA ascii\n1 2 3\n", "the header's WIDTH has no value"),
        ("WIDTH 1\nHEIGHT\nDATA ascii\n1 2 3\n", "the header's HEIGHT has no value"),
        ("WIDTH 600000\nDATA ascii\n" + "1 " * 1_800_000, "a line of more than 65,536 bytes"),
    ],
)
def test_rows_of_a_pcd_have_the_values_that_its_header_says(rest, said, tmp_path):
    """As the program has it; a row more of values would shift all that follow."""
    (tmp_path / "1.5.pcd").write_text(HEAD + rest)
    with pytest.raises(InputError, match=f"1.5.pcd: not a readable PCD file: {said}"):
        read_pcd(tmp_path / "1.5.pcd")


def test_rows_of_a_long_pcd_are_read_across_pieces(tmp_path):
    xyz = np.random.default_rng(1).uniform(-9, 9, (60_000, 3)).astype(np.float32)
    lines = "\r\n".join(" ".join(map(repr, row)) for row in xyz.tolist())
    (tmp_path / "1.5.pcd").write_text(f"{HEAD}WIDTH {len(xyz)}\nDATA ascii\n{lines}", newline="")
    found = read_pcd(tmp_path / "1.5.pcd")
    np.testing.assert_array_equal(np.stack([found[axis] for axis in "xyz"], axis=1), xyz)


def test_what_stands_after_the_rows_of_a_pcd_is_not_read(tmp_path):
    after = "\n\n \t4_0 end\n"
    (tmp_path / "1.5.pcd").write_text(f"{HEAD}WIDTH 2\nDATA ascii\n\n1 2\t3\r\n \n4\v5  6 {after}")
    found = read_pcd(tmp_path / "1.5.pcd")
    assert [found[axis].tolist() for axis in "xyz"] == [[1, 4], [2, 5], [3, 6]]


@pytest.mark.parametrize("columns", [3, 4, 32])
def test_an_array_of_one_point_may_have_one_dimension(columns, tmp_path):
    (tmp_path / "seq/l").mkdir(parents=True)
    np.save(tmp_path / "seq/l/1.5.npy", np.arange(1.0, columns + 1))
    np.save(tmp_path / "seq/l/1.6.npy", np.arange(1.0, columns + 1)[None])
    convert(tmp_path / "seq", tmp_path / "out")
    for frame in list_frames(tmp_path / "out/l"):
        assert read_xyz(frame.path).tolist() == [[1, 2, 3]]


@pytest.mark.parametrize("shape", [(3, 50), (2,), (33,), (5, 33), (2, 50, 3)])
def test_arrays_that_are_no_rows_of_points_are_refused(shape, tmp_path, fails):
    (tmp_path / "seq/l").mkdir(parents=True)
    np.save(tmp_path / "seq/l/1.5.npy", np.ones(shape))
    said = fails(4, "convert", tmp_path / "seq", tmp_path / "out")
    assert f"1.5.npy: the array has shape {shape}, expected (N, 3)" in said


def test_what_float32_cannot_hold_is_no_return(tmp_path, recwarn):
    (tmp_path / "seq/l").mkdir(parents=True)
    np.save(tmp_path / "seq/l/1.5.npy", np.array([[1e39, 1, 1], [1, 2, 3], [1e-50, 0, 0]]))
    report = convert(tmp_path / "seq", tmp_path / "out")
    assert report["returns"] == {"l": 1}
    (frame,) = list_frames(tmp_path / "out/l")
    assert read_xyz(frame.path).tolist() == [[1, 2, 3]]
    assert not recwarn.list


def test_frames_are_listed_by_a_whole_table_alone(tmp_path):
    folder = make_folder(tmp_path / "seq", "pcd", ("000000", "b", "c"))
    table = folder / "timestamps.csv"
    rows = [
        f"{name}.pcd,{stamp}\n" for name, stamp in zip(("000000", "b", "c"), STAMPS, strict=True)
    ]
    table.write_text("file,timestamp\n" + "".join(rows))
    assert [f.path.stem for f in list_frames(folder)] == ["000000", "b", "c"]
    for listed in ([], rows[1:], [*rows, rows[0]]):
        table.write_text("file,timestamp\n" + "".join(listed))
        with pytest.raises(InputError, match=r"timestamps\.csv.*: .*expected one"):
            list_frames(folder)


def test_times_of_points_of_pcd_files_are_kept(tmp_path):
    (tmp_path / "seq").mkdir()
    times = np.linspace(0, 0.0999, 40).astype("f4")
    write_pcd(tmp_path / "seq/1706255621.5.pcd", CLOUDS[0], {"time": times})
    convert(tmp_path / "seq", tmp_path / "out")
    fields = read_pcd(tmp_path / "out/seq/1706255621.500000000.pcd")
    expected = times[returns_of(CLOUDS[0])].astype(float) * 1e9
    np.testing.assert_allclose(fields["offset_time"], expected, atol=1)


def test_start_duration_and_merge_work_on_folders_too(tmp_path):
    folder = make_folder(tmp_path / "seq", "npy")
    report = convert(folder, tmp_path / "out", options=Options(start_s=0.05, duration_s=0.3))
    assert report["frames"] == {"seq": 1}
    assert [path.name for path in (tmp_path / "out/seq").iterdir()] == [NAMES[1]]
    assert convert(folder, tmp_path / "merged", options=Options(merge=2))["frames"] == {"seq": 2}
    fields = read_pcd(tmp_path / "merged/seq" / NAMES[0])
    counts = [returns_of(xyz).sum() for xyz in CLOUDS[:2]]
    np.testing.assert_array_equal(fields["offset_time"], np.repeat([0, 99_772_877], counts))


def test_real_pcd_files_of_other_libraries_are_converted(shared, tmp_path):
    (tmp_path / "seq").mkdir()
    for i, name in enumerate(("milk", "pcdrs_large_compressed", "pdal_autzen_f64_uppercase")):
        source = shared / f"data/formats/pcd/readable/{name}.pcd"
        (tmp_path / f"seq/170000000{i}.5.pcd").write_bytes(source.read_bytes())
    assert convert(tmp_path / "seq", tmp_path / "out")["frames"] == {"seq": 3}


@pytest.mark.parametrize("form", WRITERS)
def test_a_broken_file_is_named_and_nothing_is_left(form, tmp_path, fails):
    folder = make_folder(tmp_path / "seq", form)
    broken = sorted(folder.iterdir())[1]
    content = broken.read_bytes()
    is_ply = broken.suffix == ".ply"  # whose faces at the end nobody needs
    broken.write_bytes(content.replace(b"vertex 40", b"vertex 60") if is_ply else content[:-9])
    assert broken.name in fails(4, "convert", folder, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_what_is_no_ply_or_has_no_coordinates_is_refused(tmp_path, fails):
    folder = tmp_path / "seq"
    folder.mkdir()
    for text in (
        "",
        "plx\nend_header\n",
        "ply\nformat ascii 1.0\nelement vertex x\nend_header\n",
        "ply\nformat ascii 1.0\nelement vertex -1\nproperty float x\nend_header\n",
        "ply\nformat zip 1.0\nelement vertex 0\nproperty float x\nend_header\n",
        "ply\nformat ascii 1.0\nelement face 0\nend_header\n",
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n",
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty list uchar int x\nend_header\n1 1\n",
        "ply\nproperty float x\nend_header\n",
        "ply\nelement vertex 0\nproperty float x\nend_header\n",
    ):
        (folder / "1706255621.5.ply").write_text(text)
        assert "1706255621.5.ply" in fails(4, "convert", folder, tmp_path / "out"), text


def test_folders_that_leave_a_doubt_are_refused(tmp_path, fails):
    folder = make_folder(tmp_path / "seq", "npy")
    write_pcd(folder / "1.5.pcd", CLOUDS[0])
    line = fails(4, "convert", folder, tmp_path / "out")
    assert ".pcd" in line
    assert ".npy" in line
    words = make_folder(tmp_path / "words", "kitti", ("one", "two", "three"))
    assert "timestamps" in fails(4, "convert", words, tmp_path / "out")
