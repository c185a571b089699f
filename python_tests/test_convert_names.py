"""Names that recordings bring along: where they go, and how they are shown."""

import json
import re
import shutil
from pathlib import Path

import pytest
from bags import BEGIN_NS, Message, Types, plain_cloud, random_points, write_bag
from hypothesis import given, settings
from hypothesis import strategies as st
from test_convert_properties import folder
from unlidar.cli import main
from unlidar.conversion import convert
from unlidar.frames_io import find_sensors

NASTY = "a[red]b[/]\x1b[31m\n:x:"


def flight(topic: str, frames: tuple[str, ...] = ("lidar",), count: int = 6) -> list[Message]:
    """Messages of LiDARs that take turns."""
    return [
        plain_cloud(topic, BEGIN_NS + i * 10**8, random_points(i), frame_id=frames[i % len(frames)])
        for i in range(count)
    ]


def folders_of(out: Path) -> set[str]:
    return {path.name for path in out.iterdir() if path.is_dir()}


@pytest.mark.parametrize("form", ["ros1", "db3-folder", "mcap-file"])
def test_two_lidars_in_one_topic_are_two_sensors_and_that_is_said(form, tmp_path, capsys):
    bag = write_bag(tmp_path, form, [*flight("/points", ("/left", "right")), *flight("/other")])
    assert main(["convert", str(bag), "--list"]) == 0
    assert "frames of left, right" in capsys.readouterr().out
    report = convert(bag, tmp_path / "out")
    assert report["frames"] == {"other": 6, "left": 3, "right": 3}
    assert any("/points: has 2 frame_ids" in note for note in report["notes"])
    assert convert(bag, tmp_path / "one", ["right"])["frames"] == {"right": 3}
    assert folders_of(tmp_path / "one") == {"right"}


def test_a_lidar_that_turns_up_late_in_a_topic_is_a_sensor_too(tmp_path):
    late = [
        plain_cloud("/p", BEGIN_NS + i * 10**8, random_points(0, 20), frame_id="ab"[i > 60])
        for i in range(70)
    ]
    bag = write_bag(tmp_path, "ros1", [*late, *flight("/q")])
    report = convert(bag, tmp_path / "out")
    assert report["frames"] == {"p": 61, "q": 6, "b": 9}
    assert any("/p: has 2 frame_ids" in note for note in report["notes"])
    assert convert(bag, tmp_path / "others", ["q"])["frames"] == {"q": 6}


@settings(max_examples=15)
@given(
    st.lists(
        st.text(max_size=8) | st.sampled_from(["../../x", "/tmp/x", "..", "ground_truth", NASTY]),
        min_size=1,
        max_size=3,
        unique=True,
    )
)
def test_no_frame_id_and_no_topic_leaves_out(names):
    with folder() as at:
        frames = tuple(name.replace("\0", "") for name in names)
        topics = [f"/{name}".replace("\0", "") for name in names]
        messages = flight("/p", frames) + [m for t in dict.fromkeys(topics) for m in flight(t)]
        bag = write_bag(at / "in", "db3-file", messages)
        report = convert(bag, at / "deep/down/out")
        assert {p.name for p in at.iterdir()} == {"in", "deep"}
        assert [p.name for p in (at / "deep/down").iterdir()] == ["out"]
        assert folders_of(at / "deep/down/out") == set(report["frames"])
        assert sum(report["frames"].values()) == len(messages)
        assert all(re.fullmatch(r"[A-Za-z0-9_-]+", name) for name in report["frames"])


def test_a_topic_of_clouds_called_ground_truth_is_a_sensor_and_no_truth(tmp_path):
    bag = write_bag(tmp_path, "ros1", [*flight("/ground_truth"), *flight("/points")])
    report = convert(bag, tmp_path / "out")
    assert set(report["frames"]) == {"ground_truth_cloud", "points"}
    assert report["truth_rows"] is None
    assert not (tmp_path / "out/ground_truth").exists()
    again = convert(tmp_path / "out", tmp_path / "again")
    assert again["frames"] == report["frames"]
    assert again["truth_rows"] is None
    (tmp_path / "out/points").rename(tmp_path / "out/ground_truth")  # as an older version had it
    assert convert(tmp_path / "out", tmp_path / "old")["truth_rows"] is None
    assert set(find_sensors(tmp_path / "out")) == {"ground_truth_cloud", "ground_truth_cloud_2"}


def test_folders_with_odd_names_become_sensors_that_the_program_takes(tmp_path):
    bag = write_bag(tmp_path, "ros1", flight("/p"))
    convert(bag, tmp_path / "rec")
    shutil.copytree(tmp_path / "rec/p", tmp_path / "rec/my lidar (2)")
    assert set(find_sensors(tmp_path / "rec")) == {"my_lidar_2", "p"}
    assert set(convert(tmp_path / "rec", tmp_path / "out")["frames"]) == {"my_lidar_2", "p"}


def test_names_reach_the_terminal_as_they_are_on_one_line_each(tmp_path, capsys):
    bag = write_bag(
        tmp_path / NASTY, "db3-file", [*flight(f"/{NASTY}"), *flight("/p", (NASTY, "b"))]
    )
    shown = "a[red]b[/]\\x1b[31m\\n:x:"
    assert main(["convert", str(bag), "--list"]) == 0
    listed = capsys.readouterr().out
    assert listed.count("frames of") == 2
    assert any(
        f"/{shown}" in line and "sensor_msgs/PointCloud2" in line for line in listed.split("\n")
    )
    assert main(["convert", str(bag), str(tmp_path / "out")]) == 0
    assert main(["convert", str(bag), str(tmp_path / "out")]) == 5
    assert main(["convert", str(tmp_path / NASTY / "absent"), str(tmp_path / NASTY)]) == 4
    said = capsys.readouterr()
    for text in (listed, said.out, said.err):
        assert "\x1b" not in text
        assert all(line.isprintable() for line in text.split("\n"))
    assert shown in said.err


def test_a_list_in_a_pipe_shortens_nothing(tmp_path, capsys):
    topic = "/" + "/".join(f"part{i}" for i in range(80))
    bag = write_bag(tmp_path, "db3-file", flight(topic))
    assert main(["convert", str(bag), "--list"]) == 0
    assert topic in capsys.readouterr().out


def test_a_folder_of_several_bags_has_a_hint_to_run(tmp_path, fails):
    for name in "abcdefg":
        write_bag(tmp_path / "bags", "ros1", flight("/p"), name)
    line = fails(4, "convert", tmp_path / "bags", tmp_path / "out")
    assert "a.bag, b.bag, c.bag, d.bag, e.bag and 2 more" in line
    assert "name one, or unlidar run /" in line


def test_what_is_kept_of_a_conversion_says_which_frame_is_which_sensor(tmp_path):
    convert(write_bag(tmp_path, "ros1", flight("/p", ("a", "b"))), tmp_path / "out")
    kept = json.loads((tmp_path / "out/conversion.json").read_text())
    assert kept["topics"] == {"a": "/p", "b": "/p"}
    assert kept["frame_ids"] == {"a": "a", "b": "b"}


def test_frame_ids_are_those_of_the_message(tmp_path):
    def spoilt(t: Types) -> object:
        return plain_cloud("/p", 0, random_points(1), frame_id="x" * 70_000).fill(t)

    bag = write_bag(tmp_path, "mcap-file", [Message("/p", flight("/p")[0].msgtype, 5, spoilt)])
    (name,) = convert(bag, tmp_path / "out")["frames"]
    assert name == "p"
