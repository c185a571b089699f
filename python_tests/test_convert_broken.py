"""Bags that cannot be read to their end: one line, exit code 4, and what came before is kept."""

import json
import random
import re
import sqlite3
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bags import BEGIN_NS, Message, Types, livox_cloud, plain_cloud, random_points, text, write_bag
from unlidar.cli import main
from unlidar.frames_io import read_pcd

FRAMES = 12
# A frame of 60 kB: twelve of them fill several chunks and pages.
CLOUDS = [random_points(seed, 5000) for seed in range(FRAMES)]


def flight() -> list[Message]:
    return [plain_cloud("/points", BEGIN_NS + i * 10**8, xyz) for i, xyz in enumerate(CLOUDS)]


def storage_of(bag: Path) -> Path:
    return bag if bag.is_file() else next(p for p in bag.iterdir() if p.suffix != ".yaml")


def cut(path: Path, share: float) -> None:
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * share)])


def kept_frames(out: Path) -> list[Path]:
    return sorted((out / "points").iterdir())


def is_beginning(out: Path) -> bool:
    """True if the frames are the first ones, each complete."""
    for path, xyz in zip(kept_frames(out), CLOUDS, strict=False):
        fields = read_pcd(path)
        finite = np.isfinite(xyz).all(axis=1) & (xyz != 0).any(axis=1)
        if not np.array_equal(np.stack([fields[a] for a in "xyz"], axis=1), xyz[finite]):
            return False
    return True


CUT_FORMATS = (
    "ros1",
    "ros1-bz2",
    "ros1-lz4",
    "db3-folder",
    "db3-file",
    "db3-without-definitions",
    "mcap-folder",
    "mcap-file",
    "mcap-chunk-zstd",
)


@pytest.mark.parametrize("form", CUT_FORMATS)
def test_what_lies_before_the_end_of_a_cut_bag_is_kept_and_said(form, tmp_path, fails):
    bag = write_bag(tmp_path, form, flight())
    storage = storage_of(bag)
    cut(storage, 0.7)
    line = fails(4, "convert", bag, tmp_path / "out")
    assert storage.name in line
    kept = kept_frames(tmp_path / "out")
    assert FRAMES // 2 <= len(kept) < FRAMES
    assert f"{len(kept)} frames" in line
    assert is_beginning(tmp_path / "out")
    report = json.loads((tmp_path / "out/conversion.json").read_text())
    assert report["complete"] is False
    assert report["frames"] == {"points": len(kept)}


@pytest.mark.parametrize("form", CUT_FORMATS)
def test_a_bag_cut_to_nothing_leaves_nothing(form, tmp_path, fails):
    bag = write_bag(tmp_path, form, flight())
    for share in (0.0, 0.002):
        cut(storage_of(bag), share)
        assert storage_of(bag).name in fails(4, "convert", bag, tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("form", ["ros1", "ros1-lz4", "db3-file", "mcap-file"])
def test_no_damage_gives_more_than_one_line_or_a_frame_that_was_not_written(form, tmp_path, capsys):
    bag = write_bag(tmp_path / "whole", form, flight()[:4])
    content = bag.read_bytes()
    dice = random.Random(1)
    for attempt in range(30):
        damaged = bytearray(content)
        for _ in range(4):
            begin = dice.randrange(len(damaged))
            damaged[begin : begin + 20] = dice.randbytes(20)
        spoilt = tmp_path / f"spoilt{bag.suffix}"
        spoilt.write_bytes(bytes(damaged))
        out = tmp_path / f"out{attempt}"
        code = main(["convert", str(spoilt), str(out)])
        lines = [s for s in capsys.readouterr().err.splitlines() if "unlidar: note:" not in s]
        assert (code, len(lines)) in ((0, 0), (4, 1)), lines


@pytest.mark.parametrize("name", ["flight.bag", "flight.bag.active"])
def test_a_bag_whose_recorder_never_closed_it_gives_all_its_frames(name, tmp_path, fails):
    bag = write_bag(tmp_path, "ros1", flight())
    content = bytearray(bag.read_bytes())
    found = re.search(rb"index_pos=", bytes(content))
    assert found is not None
    content[found.end() : found.end() + 8] = bytes(8)
    bag.unlink()
    (tmp_path / name).write_bytes(bytes(content))
    assert "not indexed" in fails(4, "convert", tmp_path / name, tmp_path / "out")
    assert len(kept_frames(tmp_path / "out")) == FRAMES


@pytest.mark.parametrize("form", ["ros1-bz2", "ros1-lz4"])
def test_a_damaged_chunk_in_the_middle_ends_it_there(form, tmp_path, fails):
    bag = write_bag(tmp_path, form, flight())
    content = bytearray(bag.read_bytes())
    middle = len(content) // 2
    content[middle : middle + 100] = bytes(100)
    bag.write_bytes(bytes(content))
    assert "damaged after" in fails(4, "convert", bag, tmp_path / "out")
    assert 0 < len(kept_frames(tmp_path / "out")) < FRAMES
    assert is_beginning(tmp_path / "out")


def test_a_blank_storage_id_is_said_and_the_files_are_read_all_the_same(tmp_path, fails):
    bag = write_bag(tmp_path, "mcap-folder", flight())
    meta = bag / "metadata.yaml"
    meta.write_text(re.sub("storage_identifier: .*", "storage_identifier: ''", meta.read_text()))
    line = fails(4, "convert", bag, tmp_path / "out")
    assert "metadata.yaml" in line
    assert "storage_identifier is blank" in line
    assert len(kept_frames(tmp_path / "out")) == FRAMES
    storage_of(bag).unlink()
    assert "metadata.yaml" in fails(4, "convert", bag, tmp_path / "none")


@pytest.mark.parametrize("spoil", ["nonsense: [", "a: 1\n", "", "rosbag2_bagfile_information: 3\n"])
def test_broken_metadata_is_named(spoil, tmp_path, fails):
    bag = write_bag(tmp_path, "db3-folder", flight())
    (bag / "metadata.yaml").write_text(spoil)
    assert "metadata.yaml" in fails(4, "convert", bag, tmp_path / "out")


def test_a_definition_that_nobody_can_read_is_named_with_its_topic(tmp_path, fails):
    bag = write_bag(tmp_path, "db3-file", flight())
    with sqlite3.connect(bag) as database:
        database.execute("UPDATE message_definitions SET encoded_message_definition='float99 ?'")
    line = fails(4, "convert", bag, tmp_path / "out")
    assert "/points" in line
    assert "definition" in line
    assert not (tmp_path / "out").exists()


def test_a_cloud_of_an_unknown_type_is_no_cloud(tmp_path, fails):
    bag = write_bag(tmp_path, "db3-without-definitions", flight())
    with sqlite3.connect(storage_of(bag)) as database:
        database.execute("UPDATE topics SET type='acme_msgs/msg/Cloud'")
    line = fails(4, "convert", storage_of(bag), tmp_path / "out")
    assert "/points (acme_msgs/Cloud)" in line


def test_livox_messages_defined_otherwise_are_refused_rather_than_misread(tmp_path, fails):
    columns = dict.fromkeys(("x", "y", "z"), np.ones(3)) | dict.fromkeys(
        ("offset_time", "tag"), np.ones(3, dtype=int)
    )
    name = "livox_ros_driver2"
    bag = write_bag(tmp_path, "ros1", [livox_cloud("/l", BEGIN_NS, name, columns)])
    content = bag.read_bytes()
    assert b"uint8 line" in content
    bag.write_bytes(content.replace(b"uint8 line", b"uint8 ring"))
    assert "otherwise" in fails(4, "convert", bag, tmp_path / "out")


def raw_cloud(tmp_path: Path, **changes: object) -> Path:
    """Two good clouds, then one whose numbers do not fit."""

    def spoilt(t: Types) -> Any:
        message = flight()[2].fill(t)
        for name, value in changes.items():
            setattr(
                message.fields[2] if name in ("offset", "datatype", "name") else message,
                name,
                value,
            )
        return message

    third = flight()[2]
    return write_bag(tmp_path, "ros1", [*flight()[:2], replace(third, fill=spoilt)])


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"width": 10**6}, "announced"),
        ({"height": 3}, "announced"),
        ({"point_step": 10}, "at byte 8 of 10"),
        ({"offset": 100}, "at byte 100"),
        ({"datatype": 9}, "type 9"),
        ({"name": "w"}, "expected x, y and z"),
    ],
)
def test_a_cloud_whose_numbers_do_not_fit_ends_the_conversion_there(changes, said, tmp_path, fails):
    line = fails(4, "convert", raw_cloud(tmp_path, **changes), tmp_path / "out")
    assert said in line
    assert "2 frames" in line
    assert len(kept_frames(tmp_path / "out")) == 2
    assert is_beginning(tmp_path / "out")


@pytest.mark.parametrize("form", ["ros1", "mcap-folder"])
def test_a_message_of_the_wrong_length_ends_the_conversion_there(form, tmp_path, fails):
    messages = flight()[:3]
    messages[2] = replace(messages[2], cut=40)
    assert "2 frames" in fails(4, "convert", write_bag(tmp_path, form, messages), tmp_path / "out")
    columns = dict.fromkeys(("x", "y", "z", "offset_time", "tag"), np.ones(3))
    livox = livox_cloud("/points", BEGIN_NS, "livox_ros_driver", columns)
    for cut_bytes in (1, 40, 100):
        bag = write_bag(tmp_path / str(cut_bytes), form, [replace(livox, cut=cut_bytes)])
        assert "no frame" in fails(4, "convert", bag, tmp_path / "none")


def test_two_frames_of_one_stamp_are_reported_with_the_way_out(tmp_path, fails):
    messages = flight()[:3]
    again = plain_cloud("/points", BEGIN_NS, CLOUDS[0], BEGIN_NS + 10**9)
    bag = write_bag(tmp_path, "ros1", [*messages, again])
    assert "--stamp log" in fails(4, "convert", bag, tmp_path / "out")
    assert len(kept_frames(tmp_path / "out")) == 3
    assert main(["convert", str(bag), str(tmp_path / "log"), "--stamp", "log"]) == 0


def test_truth_and_merged_frames_before_the_damage_are_kept_too(tmp_path, fails):
    bag = write_bag(tmp_path, "ros1", [*flight(), text("/words", BEGIN_NS)])
    cut(bag, 0.7)
    fails(4, "convert", bag, tmp_path / "one")
    fails(4, "convert", bag, tmp_path / "out", "--merge", "5")
    single, several = kept_frames(tmp_path / "one"), kept_frames(tmp_path / "out")
    assert len(several) == -(-len(single) // 5)
    merged_rows = sum(len(read_pcd(path)["x"]) for path in several)
    assert merged_rows == sum(len(read_pcd(path)["x"]) for path in single)


def test_files_that_are_no_bags_are_refused(tmp_path, fails):
    for name in ("a.bag", "a.mcap", "a.db3"):
        (tmp_path / name).write_text("no bag at all, just words in a file\n" * 20)
        assert name in fails(4, "convert", tmp_path / name, tmp_path / "out")
    (tmp_path / "notes.txt").write_text("x")
    assert "ROS" in fails(4, "convert", tmp_path / "notes.txt", tmp_path / "out")
