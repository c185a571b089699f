"""Bad or incomplete parts of a recording are left out and counted, read anyway, or reported."""

import hashlib
import json
import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bags import (
    BEGIN_NS,
    Message,
    Types,
    leave_in_log,
    plain_cloud,
    random_points,
    write_bag,
)
from mcap.writer import Writer as McapWriter
from test_convert import STAMPS, make_sequence
from test_convert_broken import cut, raw_cloud
from unlidar.cli import main
from unlidar.conversion import Options, convert
from unlidar.frames_io import write_pcd
from unlidar.record import read_record

FRAMES = 20


def flight(topic: str = "/points") -> list[Message]:
    return [plain_cloud(topic, BEGIN_NS + i * 10**8, random_points(i)) for i in range(FRAMES)]


def with_repeats(times: int) -> list[Message]:
    """Twenty frames; some have the stamp of the one before."""
    messages = flight()
    for i in range(times):
        again = messages[7 + i]
        stamp_ns = BEGIN_NS + (6 + i) * 10**8 - (10**8 if i else 0)
        messages[7 + i] = plain_cloud("/points", stamp_ns, random_points(99), again.log_ns)
    return messages


def state_of(folder: Path) -> dict[str, tuple[str, int]]:
    return {
        path.name: (hashlib.md5(path.read_bytes()).hexdigest(), path.stat().st_mtime_ns)
        for path in folder.iterdir()
    }


def test_a_repeated_stamp_is_left_out_and_counted_when_that_is_asked_for(tmp_path, capsys, fails):
    bag = write_bag(tmp_path, "ros1", with_repeats(1))
    line = fails(4, "convert", bag, tmp_path / "out")
    assert "--skip-bad" in line
    assert "7 frames" in line
    assert main(["convert", str(bag), str(tmp_path / "all"), "--skip-bad"]) == 0
    said = capsys.readouterr()
    assert "19 frames" in said.out
    assert "points: left out 1, the first: " in said.err
    report = json.loads((tmp_path / "all/conversion.json").read_text())
    assert report["left_out"] == {"points": 1}
    assert report["complete"] is True
    assert len(list((tmp_path / "all/points").iterdir())) == 19


@pytest.mark.parametrize("form", ["ros1", "mcap-folder", "mcap-of-ros1"])
def test_messages_that_cannot_be_read_are_left_out_and_counted_too(form, tmp_path):
    messages = flight()
    for i in (3, 4, 11):
        messages[i] = replace(messages[i], cut=50)
    bag = write_bag(tmp_path, form, messages)
    report = convert(bag, tmp_path / "out", options=Options(skip_bad=True))
    assert report["frames"] == {"points": FRAMES - 3}
    assert report["left_out"] == {"/points": 3}
    first = next(note for note in report["notes"] if note.startswith("/points: left out 3"))
    assert "sensor_msgs/PointCloud2" in first
    assert convert(bag, tmp_path / "some")["broken"].endswith("(--skip-bad leaves such out)")


@pytest.mark.parametrize("changes", [{"width": 10**6}, {"offset": 100}, {"name": "w"}])
def test_clouds_whose_numbers_do_not_fit_are_left_out_too(changes, tmp_path):
    bag = raw_cloud(tmp_path, **changes)
    report = convert(bag, tmp_path / "out", options=Options(skip_bad=True))
    assert report["frames"] == {"points": 2}
    assert report["left_out"] == {"/points": 1}


def test_files_that_cannot_be_read_are_left_out_and_counted_too(tmp_path, capsys):
    source = make_sequence(tmp_path / "seq")
    (source / "lidar_360" / f"{STAMPS[1]}.npy").write_bytes(b"nothing")
    (source / "lidar_360" / f"{STAMPS[2]}.npy").rename(source / "lidar_360/third.npy")
    np.save(source / "ground_truth" / f"{STAMPS[0]}.npy", np.full(3, np.nan))
    assert main(["convert", str(source), str(tmp_path / "out"), "--skip-bad"]) == 0
    report = json.loads((tmp_path / "out/conversion.json").read_text())
    assert report["frames"] == {"lidar_360": 1, "livox_avia": 3}
    assert report["left_out"] == {"lidar_360": 2, "ground_truth": 1}
    assert report["truth_rows"] == 2
    assert "third.npy" in capsys.readouterr().err
    folder = tmp_path / "frames"
    folder.mkdir()
    write_pcd(folder / "1.5.pcd", np.ones((3, 3)))
    (folder / "2.5.pcd").write_text("nothing")
    (folder / "first.pcd").write_text("nothing")
    report = convert(folder, tmp_path / "pcd", options=Options(skip_bad=True))
    assert report["left_out"] == {"frames": 2}


def test_when_all_is_bad_nothing_is_left_and_the_first_reason_is_said(tmp_path, fails):
    bag = write_bag(tmp_path, "ros1", [replace(m, cut=50) for m in flight()])
    line = fails(4, "convert", bag, tmp_path / "out", "--skip-bad")
    assert "no frame could be read" in line
    assert "/points" in line
    assert not (tmp_path / "out").exists()


def cut_bag(folder: Path, name: str = "flight") -> Path:
    clouds = [random_points(0, 5000)] * 12  # what stands is quick to judge
    messages = [plain_cloud("/points", BEGIN_NS + i * 10**8, xyz) for i, xyz in enumerate(clouds)]
    bag = write_bag(folder, "ros1", messages, name)
    cut(bag, 0.7)
    return bag


def test_run_goes_on_with_what_could_be_read_and_says_so(tmp_path, program, monkeypatch, capsys):
    monkeypatch.setenv("UNLIDAR_TRACK", str(program))
    bag = cut_bag(tmp_path)
    for _ in range(2):
        assert main(["run", str(bag), "--out", str(tmp_path / "out")]) == 0
        said = capsys.readouterr().err
        assert "damaged or not closed by its recorder" in said
        assert "went on with what could be read: 8 frames" in said
        assert (tmp_path / "out/report.html").is_file()
        record = read_record(tmp_path / "out")
        assert record.broken and "went on with what could be read" in record.notes[-1]
    repeats = write_bag(tmp_path, "ros1", with_repeats(2), "repeats")
    arguments = ["run", str(repeats), "--out", str(tmp_path / "whole"), "--skip-bad"]
    assert main(arguments) == 0
    assert "left out 2" in capsys.readouterr().err
    assert json.loads((tmp_path / "whole/summary.json").read_text())["counts"]["frames"] == 18


def test_many_recordings_go_on_with_what_could_be_read_of_each(
    tmp_path, program, monkeypatch, capsys
):
    monkeypatch.setenv("UNLIDAR_TRACK", str(program))
    cut_bag(tmp_path / "bags", "a")
    write_bag(tmp_path / "bags", "ros1", with_repeats(1), "b")
    out = tmp_path / "out"
    assert main(["run", str(tmp_path / "bags"), "--out", str(out), "--skip-bad"]) == 0
    rows = {
        row["sequence"]: row for row in json.loads((out / "table.json").read_text())["sequences"]
    }
    assert "broken" in rows["a.bag"]["remark"]
    assert "broken" not in rows["b.bag"]["remark"]
    for name, is_broken in (("a.bag", True), ("b.bag", False)):
        assert read_record(out / name).broken == is_broken
    record = json.loads((out / "b.bag/frames/conversion.json").read_text())
    assert record["left_out"] == {"points": 1}


@pytest.mark.parametrize("form", ["db3-folder", "db3-file", "db3-without-definitions"])
def test_rows_in_a_write_ahead_log_are_read_and_nothing_beside_it_changes(form, tmp_path, capsys):
    bag = write_bag(tmp_path, form, flight())
    database = bag if bag.is_file() else next(bag.glob("*.db3"))
    leave_in_log(database, kept=5)
    before = state_of(database.parent)
    assert main(["convert", str(bag), str(tmp_path / "out")]) == 0
    said = capsys.readouterr()
    assert f"{FRAMES} frames" in said.out
    assert "flight.db3-wal: " in said.err
    assert state_of(database.parent) == before
    # What the rows cost a reader that does not look into the log.
    database.with_name("flight.db3-wal").unlink()
    assert convert(database, tmp_path / "less")["frames"] == {"points": 5}


def test_a_log_cut_off_by_a_crash_gives_what_was_committed(tmp_path):
    bag = write_bag(tmp_path, "db3-file", flight())
    leave_in_log(bag, kept=2)
    log = bag.with_name("flight.db3-wal")
    cut(log, 0.6)
    frames = convert(bag, tmp_path / "out")["frames"]["points"]
    assert 2 < frames < FRAMES


def test_a_log_beside_an_empty_database_is_neither_read_nor_lost(tmp_path, fails):
    bag = write_bag(tmp_path, "db3-file", flight())
    leave_in_log(bag)
    os.truncate(bag, 0)
    before = state_of(bag.parent)
    assert "flight.db3" in fails(4, "convert", bag, tmp_path / "out")
    assert state_of(bag.parent) == before


@pytest.mark.parametrize("name", ["a#b", "50%", "what?", "a b", "100%41"])
def test_databases_with_signs_of_uris_in_their_names_are_found(name, tmp_path):
    bag = write_bag(tmp_path, "db3-folder", flight())
    bag = bag.rename(tmp_path / name)
    report = convert(bag, tmp_path / "out")
    assert report["frames"] == {"points": FRAMES}
    assert report["complete"] is True


def write_mcap(path: Path, schema: str, schema_encoding: str, encoding: str) -> Path:
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start(profile="")
        schema_id = writer.register_schema(schema, schema_encoding, b"whatever")
        channel = writer.register_channel("/lidar[0]", encoding, schema_id)
        for i in range(3):
            writer.add_message(channel, BEGIN_NS + i, b"\0\1\2\3" * 9, BEGIN_NS + i)
        writer.finish()
    return path


@pytest.mark.parametrize(
    ("schema", "schema_encoding", "encoding"),
    [
        ("foxglove.PointCloud", "protobuf", "protobuf"),
        ("sensor_msgs/msg/PointCloud2", "jsonschema", "json"),
        ("PointCloud", "flatbuffer", "flatbuffer"),
    ],
)
def test_mcap_files_of_others_than_ros_are_called_what_they_are(
    schema, schema_encoding, encoding, tmp_path, fails, capsys
):
    path = write_mcap(tmp_path / "a.mcap", schema, schema_encoding, encoding)
    line = fails(4, "convert", path, tmp_path / "out")
    assert "damaged" not in line
    assert f"{schema.replace('/msg/', '/')} in {encoding}, not of ROS" in line
    assert main(["convert", str(path), "--list"]) == 0
    assert encoding in capsys.readouterr().out


@pytest.mark.parametrize("form", ["mcap-of-ros1", "mcap-without-profile", "mcap-of-ros1-lz4"])
def test_mcap_files_that_rosbags_does_not_read_are_salvaged_as_others(form, tmp_path, fails):
    messages = [
        plain_cloud("/points", BEGIN_NS + i * 10**8, random_points(i, 5000)) for i in range(12)
    ]
    bag = write_bag(tmp_path, form, messages)
    content = bag.read_bytes()
    bag.write_bytes(content[: int(len(content) * 0.7)])
    line = fails(4, "convert", bag, tmp_path / "out")
    assert "damaged or not closed" in line
    assert 5 < len(list((tmp_path / "out/points").iterdir())) < 12
    spoilt = bytearray(content)
    spoilt[len(spoilt) // 2] ^= 255
    bag.write_bytes(bytes(spoilt))
    assert "damaged" in fails(4, "convert", bag, tmp_path / "spoilt")


def test_a_header_that_ends_early_is_a_message_that_cannot_be_read(tmp_path):
    messages = flight()[:3]

    def tiny(t: Types) -> Any:
        return messages[1].fill(t)

    for cut_bytes in range(1, 60, 7):
        size = 12 * 40 + 120
        broken = replace(messages[1], fill=tiny, cut=size - cut_bytes)
        bag = write_bag(tmp_path / str(cut_bytes), "ros1", [messages[0], broken, messages[2]])
        out = tmp_path / f"out{cut_bytes}"
        report = convert(bag, out, options=Options(skip_bad=True))
        assert report["frames"] == {"points": 2}
        shutil.rmtree(out)
