"""`unlidar convert`: what comes out is what the recording holds, complete or not at all."""

import csv
import json
import subprocess
import sys
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest
from unlidar.cli import main
from unlidar.conversion import convert
from unlidar.errors import InputError
from unlidar.frames_io import read_pcd, write_pcd
from unlidar.stamps import format_stamp, parse_stamp_ns

# The command, interrupted as soon as a frame is written.
INTERRUPTED = """
import os, signal, sys
from unlidar import conversion
from unlidar.__main__ import main
write = conversion.write_pcd
def interrupt(*frame):
    write(*frame)
    os.kill(os.getpid(), signal.SIGTERM)
conversion.write_pcd = interrupt
sys.exit(main())
"""
STAMPS = ("1706255621.600227", "1706255621.7", "1706255621.80023700")


def make_sequence(root: Path) -> Path:
    """A small recording in the layout of the data set, with rows that are no returns."""
    rng = np.random.default_rng(1)
    for name in ("lidar_360", "livox_avia", "radar_enhance_pcl", "ground_truth"):
        (root / name).mkdir(parents=True)
    for stamp in STAMPS:
        rows = rng.normal(size=(50, 3))
        rows[::5] = 0.0
        rows[3] = np.nan
        np.save(root / "lidar_360" / f"{stamp}.npy", rows)
        np.save(root / "livox_avia" / f"{stamp}.npy", np.zeros(0))
        np.save(root / "radar_enhance_pcl" / f"{stamp}.npy", np.ones((5, 3)))
        np.save(root / "ground_truth" / f"{stamp}.npy", rng.normal(size=3))
    return root


def contents(directory: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(directory)): path.read_bytes()
        for path in sorted(directory.rglob("*"))
        if path.is_file()
    }


def test_every_return_of_a_real_sequence_arrives_and_no_row_without_return(shared, tmp_path):
    source = shared / "data/mmaud/val/seq0001"
    assert main(["convert", str(source), str(tmp_path / "out")]) == 0
    for sensor in ("lidar_360", "livox_avia"):
        files = sorted((source / sensor).glob("*.npy"))
        frames = sorted(path.name for path in (tmp_path / "out" / sensor).glob("*.pcd"))
        assert frames == [path.name.replace(".npy", ".pcd") for path in files]
        for path in files:
            rows = np.load(path)
            fields = read_pcd(tmp_path / "out" / sensor / path.name.replace(".npy", ".pcd"))
            written = np.stack([fields[axis] for axis in "xyz"], axis=1)
            np.testing.assert_array_equal(written, rows[(rows != 0).any(axis=1)].astype("f4"))


def test_truth_of_a_real_sequence_keeps_every_digit(shared, tmp_path):
    source = shared / "data/mmaud/val/seq0001"
    convert(source, tmp_path / "out")
    written = list(csv.reader((tmp_path / "out/ground_truth.csv").open()))
    original = list(csv.reader((source / "ground_truth.csv").open()))
    assert written[0] == original[0] == ["timestamp", "x", "y", "z"]
    assert [[Decimal(v) for v in row] for row in written[1:]] == [
        [Decimal(v) for v in row] for row in original[1:]
    ]


def test_names_keep_the_digits_of_the_stamps_and_empty_frames_stay_frames(tmp_path):
    report = convert(make_sequence(tmp_path / "seq"), tmp_path / "out")
    assert report["frames"] == {"lidar_360": 3, "livox_avia": 3}
    assert report["returns"] == {"lidar_360": 3 * 39, "livox_avia": 0}
    for sensor in ("lidar_360", "livox_avia"):
        names = {path.name for path in (tmp_path / "out" / sensor).iterdir()}
        assert names == {f"{stamp}.pcd" for stamp in STAMPS}
    assert json.loads((tmp_path / "out/conversion.json").read_text())["kind"] == "mmaud"


def test_radar_comes_along_only_when_named(tmp_path):
    source = make_sequence(tmp_path / "seq")
    assert "radar_enhance_pcl" not in convert(source, tmp_path / "a")["frames"]
    chosen = ["radar_enhance_pcl", "lidar_360"]
    assert list(convert(source, tmp_path / "b", chosen)["frames"]) == chosen


def test_an_unknown_sensor_is_a_usage_error_that_lists_the_known(tmp_path, fails):
    source = make_sequence(tmp_path / "seq")
    line = fails(2, "convert", source, tmp_path / "out", "--sensors", "lidar_360,velodyne")
    assert "velodyne" in line
    assert "livox_avia" in line


def test_truth_comes_from_the_csv_where_there_is_no_folder_and_may_be_absent(tmp_path):
    source = make_sequence(tmp_path / "seq")
    convert(source, tmp_path / "a")
    table = (tmp_path / "a/ground_truth.csv").read_text()
    for path in (source / "ground_truth").iterdir():
        path.unlink()
    (source / "ground_truth").rmdir()
    assert convert(source, tmp_path / "b")["truth_rows"] is None
    assert not (tmp_path / "b/ground_truth.csv").exists()
    (source / "ground_truth.csv").write_text(table)
    convert(source, tmp_path / "c")
    assert (tmp_path / "c/ground_truth.csv").read_text() == table


def break_truncated(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-7])


def break_empty(path: Path) -> None:
    path.write_bytes(b"")


def break_pickle(path: Path) -> None:
    np.save(path, np.array([{"a": 1}], dtype=object))


def break_shape(path: Path) -> None:
    np.save(path, np.zeros((4, 2)))


def break_text(path: Path) -> None:
    np.save(path, np.array([["a", "b", "c"]]))


def break_name(path: Path) -> None:
    path.rename(path.with_name("first.npy"))


def break_twice(path: Path) -> None:
    np.save(path.with_name(f"{path.stem}0.npy"), np.ones((2, 3)))


BREAKS = (
    break_truncated,
    break_empty,
    break_pickle,
    break_shape,
    break_text,
    break_name,
    break_twice,
)


@pytest.mark.parametrize("spoil", BREAKS, ids=lambda f: f.__name__.removeprefix("break_"))
def test_a_broken_file_gives_one_line_that_names_it_and_leaves_nothing_behind(
    spoil, tmp_path, fails
):
    source = make_sequence(tmp_path / "seq")
    spoil(source / "lidar_360" / f"{STAMPS[1]}.npy")
    line = fails(4, "convert", source, tmp_path / "out")
    assert STAMPS[1] in line or "first.npy" in line
    assert [path.name for path in tmp_path.iterdir()] == ["seq"]


def test_a_truth_that_is_no_position_is_refused(tmp_path, fails):
    source = make_sequence(tmp_path / "seq")
    np.save(source / "ground_truth" / f"{STAMPS[0]}.npy", np.array([1.0, np.nan, 2.0]))
    assert f"{STAMPS[0]}.npy" in fails(4, "convert", source, tmp_path / "out")


def test_what_is_no_recording_is_refused_with_what_was_expected(tmp_path, fails):
    assert "does not exist" in fails(4, "convert", tmp_path / "nothing", tmp_path / "out")
    (tmp_path / "empty").mkdir()
    assert "MMAUD" in fails(4, "convert", tmp_path / "empty", tmp_path / "out")
    (tmp_path / "bare/lidar_360").mkdir(parents=True)
    assert "no .npy" in fails(4, "convert", tmp_path / "bare", tmp_path / "out")


def test_an_existing_folder_is_replaced_only_with_force(tmp_path, fails):
    source = make_sequence(tmp_path / "seq")
    convert(source, tmp_path / "out")
    before = contents(tmp_path / "out")
    (source / "lidar_360" / f"{STAMPS[0]}.npy").unlink()
    assert "--force" in fails(5, "convert", source, tmp_path / "out")
    assert contents(tmp_path / "out") == before
    assert main(["convert", str(source), str(tmp_path / "out"), "--force"]) == 0
    assert len(list((tmp_path / "out/lidar_360").iterdir())) == 2
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out", "seq"]


def test_force_never_replaces_a_foreign_folder_or_the_source(tmp_path, fails):
    source = make_sequence(tmp_path / "seq")
    (tmp_path / "home").mkdir()
    (tmp_path / "home/letter.txt").write_text("dear")
    fails(5, "convert", source, tmp_path / "home", "--force")
    fails(2, "convert", source, source, "--force")
    fails(2, "convert", source, tmp_path, "--force")
    assert (tmp_path / "home/letter.txt").read_text() == "dear"
    assert len(list((source / "lidar_360").iterdir())) == 3


def test_an_output_that_cannot_be_written_is_an_output_error(tmp_path, fails):
    source = make_sequence(tmp_path / "seq")
    (tmp_path / "file").write_text("")
    fails(5, "convert", source, tmp_path / "file")
    fails(5, "convert", source, tmp_path / "file/out")


def test_a_failed_forced_conversion_leaves_the_old_result(tmp_path, fails):
    source = make_sequence(tmp_path / "seq")
    convert(source, tmp_path / "out")
    before = contents(tmp_path / "out")
    break_truncated(source / "lidar_360" / f"{STAMPS[2]}.npy")
    fails(4, "convert", source, tmp_path / "out", "--force")
    assert contents(tmp_path / "out") == before


def test_an_interrupted_conversion_leaves_nothing_behind(tmp_path):
    source = make_sequence(tmp_path / "seq")
    call = [sys.executable, "-c", INTERRUPTED, "convert", source, tmp_path / "out"]
    done = subprocess.run(call, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (130, "unlidar: error: interrupted\n")
    assert [path.name for path in tmp_path.iterdir()] == ["seq"]


def test_nothing_but_the_result_line_is_printed_into_a_pipe(tmp_path):
    source = make_sequence(tmp_path / "seq")
    command = [sys.executable, "-m", "unlidar", "convert", source, tmp_path / "out"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.count("\n") == 1


def test_pcd_written_is_read_back_with_its_point_times(tmp_path):
    rng = np.random.default_rng(1)
    xyz = rng.normal(size=(20, 3)).astype("f4")
    time_ns = rng.integers(0, 10**8, 20)
    write_pcd(tmp_path / "1.pcd", xyz, {"t": time_ns.astype("u4")})
    fields = read_pcd(tmp_path / "1.pcd")
    np.testing.assert_array_equal(np.stack([fields[a] for a in "xyz"], axis=1), xyz)
    np.testing.assert_array_equal(fields["t"], time_ns)
    write_pcd(tmp_path / "2.pcd", np.zeros((0, 3)))
    assert len(read_pcd(tmp_path / "2.pcd")["x"]) == 0


def test_one_cloud_reads_the_same_from_all_three_encodings(shared):
    folder = shared / "data/formats/pcd/readable"
    clouds = [
        read_pcd(folder / f"pypcd4_{name}.pcd") for name in ("ascii", "binary", "binary_compressed")
    ]
    assert len(clouds[0]["x"]) == 213
    for axis in "xyz":
        np.testing.assert_array_equal(clouds[1][axis], clouds[2][axis])
        np.testing.assert_array_equal(clouds[0][axis].astype("f4"), clouds[1][axis])


def test_real_pcd_files_of_other_libraries_are_read(shared):
    for path in sorted((shared / "data/formats/pcd/readable").glob("*.pcd")):
        lengths = {len(column) for column in read_pcd(path).values()}
        assert len(lengths) == 1, path.name


def test_broken_pcd_files_are_refused_by_name(shared):
    folder = shared / "data/formats/pcd/malformed"
    for name in ("ascii_invalid_header", "corrupt_compressed", "missingheader", "zero_byte"):
        with pytest.raises(InputError, match=name):
            read_pcd(folder / f"{name}.pcd")


def test_stamps_are_exact_and_have_the_unit_of_their_magnitude():
    ns = 1_706_255_621_600_227_123
    for text in ("1706255621.600227123", str(ns), "1.706255621600227123e9"):
        assert parse_stamp_ns(text) == ns
    assert parse_stamp_ns("1706255621600227") == 1_706_255_621_600_227_000
    assert parse_stamp_ns("1706255621600") == 1_706_255_621_600_000_000
    assert parse_stamp_ns("1706255621") == 1_706_255_621_000_000_000
    assert parse_stamp_ns("0.0000000005") == 1
    for text in ("", "a", "1.2.3", "nan", "1_0", "1e", " 1"):
        with pytest.raises(ValueError, match="time stamp"):
            parse_stamp_ns(text)
    for stamp_ns in (ns, 0, 5_000, 1_700_000_000_000_000_000):
        assert parse_stamp_ns(format_stamp(stamp_ns)) == stamp_ns
