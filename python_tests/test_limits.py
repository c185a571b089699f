"""Files that are larger than they should be, or unpack to more: refused in bounded memory."""

from __future__ import annotations

import bz2
import resource
import struct
import subprocess
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
from bags import BEGIN_NS, plain_cloud, random_points, write_bag
from hypothesis import given
from hypothesis import strategies as st
from many import command
from unlidar.cli import main
from unlidar.conversion.unpacking import unpack_file, unpacked, zstd
from unlidar.errors import ConfigError, InputError, listed, shortened
from unlidar.events.site import load_site
from unlidar.limits import MOST_LINE, TooLargeError, load_yaml
from unlidar.station import places_sensors, read_station

MEMORY = 1 << 30  # of addresses; a third of it is libraries
SPARSE = 20 << 30
PACKERS = {"bz2": bz2.compress, "lz4": lz4.frame.compress, "zstd": zstd.compress}


def refused(*arguments: object) -> str:
    """The one line of a command that ends with code 4 in bounded memory and time."""
    done = subprocess.run(
        command(*arguments),
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY)),
        capture_output=True,
        text=True,
        timeout=120,
    )
    lines = done.stderr.splitlines()
    assert (done.returncode, len(lines)) == (4, 1), done.stderr
    return lines[0]


def sparse(path: Path, begin: bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:
        file.write(begin)
        file.truncate(SPARSE)
    return path


PCAP = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1)
NPY = b"\x93NUMPY\x01\x00\x76\x00" + b"{'descr': '<f4', 'fortran_order': False, 'shape': (9, 3)}"


@pytest.mark.parametrize(
    ("name", "begin"),
    [
        ("a.bag", b""),
        ("b.bag", b"#ROSBAG V2.0\n"),
        ("c.bag", b"#ROSBAG V2.0\n" + struct.pack("<I", 0xFFFFFFF0)),
        ("a.mcap", b"\x89MCAP0\r\n"),
        ("b.mcap", b"\x89MCAP0\r\n" + struct.pack("<BQ", 6, SPARSE - 100)),
        ("a.pcap", PCAP),
        ("b.pcap", PCAP + struct.pack("<4I", 0, 0, 0xFFFFFFF0, 0xFFFFFFF0)),
        ("frames/1700000000.5.pcd", b"VERSION 0.7\n"),
        ("frames/1700000000.5.ply", b"ply\n"),
        ("frames/1700000000.5.npy", NPY),
        ("frames/1700000000.5.bin", b""),
    ],
)
def test_a_sparse_recording_of_20_gb_is_refused(name: str, begin: bytes, tmp_path: Path) -> None:
    path = sparse(tmp_path / name, begin)
    recording = path.parent if path.parent != tmp_path else path
    assert path.name in refused("convert", recording, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_table_without_a_line_break_is_refused_before_it_is_read(tmp_path: Path, fails) -> None:
    path = sparse(tmp_path / "truth.csv", b"timestamp,x,y,z")
    assert f"{MOST_LINE:,}" in fails(4, "evaluate", path, path)


def mcap_bomb(path: Path, megabytes: int, declared: int) -> Path:
    packed = zstd.compress(bytes(megabytes << 20))
    body = struct.pack("<QQQI", 0, 1, declared, 0) + struct.pack("<I", 4) + b"zstd"
    body += struct.pack("<Q", len(packed)) + packed
    path.write_bytes(b"\x89MCAP0\r\n" + struct.pack("<BQ", 6, len(body)) + body)
    return path


@pytest.mark.parametrize("declared", [1 << 40, 3 << 30, 1000])
def test_a_chunk_that_swells_is_refused_whatever_it_declares(declared: int, tmp_path: Path) -> None:
    bomb = mcap_bomb(tmp_path / "a.mcap", 1500, declared)
    assert "a.mcap" in refused("convert", bomb, tmp_path / "out")


@pytest.mark.parametrize("packing", ["message", "file"])
def test_messages_and_files_that_swell_are_refused(packing: str, tmp_path: Path, fails) -> None:
    messages = [plain_cloud("/p", BEGIN_NS + i * 10**8, random_points(i, 50)) for i in range(3)]
    bag = write_bag(tmp_path, f"mcap-{packing}-zstd", messages)
    assert main(["convert", str(bag), str(tmp_path / "whole")]) == 0
    if packing == "message":
        with pytest.raises(TooLargeError):
            unpacked("zstd", zstd.compress(bytes(300 << 20)))
        return
    (file,) = bag.glob("*.zstd")
    file.write_bytes(zstd.compress(bytes(1200 << 20)))
    assert file.name in fails(4, "convert", bag, tmp_path / "out")


def test_a_file_is_unpacked_no_further_than_its_bound(tmp_path: Path) -> None:
    packed = tmp_path / "a.zstd"
    packed.write_bytes(zstd.compress(bytes(1100 << 20)))
    with pytest.raises(TooLargeError):
        unpack_file(packed, tmp_path / "a")


@given(
    st.binary(max_size=300),
    st.integers(0, 400),
    st.sampled_from(sorted(PACKERS)),
    st.integers(1, 3),
)
def test_nothing_unpacks_to_more_than_is_asked_for(data, most, packer, times) -> None:
    packed = PACKERS[packer](data) * times
    if len(data) * times > most:
        with pytest.raises(TooLargeError):
            unpacked(packer, packed, most)
    else:
        assert unpacked(packer, packed, most) == data * times
        assert data.startswith(unpacked(packer, PACKERS[packer](data)[:-1], 1000))


def test_a_database_whose_table_is_made_up_as_it_is_read_is_refused(tmp_path: Path, fails) -> None:
    import sqlite3

    messages = [plain_cloud("/p", BEGIN_NS, random_points(1, 50))]
    bag = write_bag(tmp_path, "db3-file", messages)
    with sqlite3.connect(bag) as database:
        database.execute("DROP TABLE message_definitions")
        database.execute(
            "CREATE VIEW message_definitions AS WITH RECURSIVE n(id) AS (SELECT 1 UNION ALL "
            "SELECT id + 1 FROM n) SELECT id, 'a' topic_type, 'ros2msg' encoding, "
            "'b' encoded_message_definition, '' type_description_hash FROM n"
        )
    assert "is a view" in fails(4, "convert", bag, tmp_path / "out")


def test_aliases_that_repeat_without_end_are_refused(tmp_path: Path, fails) -> None:
    levels = [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 30)]
    path = tmp_path / "scene.yaml"
    path.write_text("\n".join(["a0: &a0 [1, 2]", *levels]))
    assert "aliases" in fails(3, "simulate", path, tmp_path / "out")
    path.write_text("&own [*own]")
    with pytest.raises(ValueError, match="aliases"):
        load_yaml(path)


def test_merged_keys_are_refused_before_they_are_merged(tmp_path: Path) -> None:
    levels = [f"a{i}: &a{i} {{<<: [{', '.join([f'*a{i - 1}'] * 10)}]}}" for i in range(1, 30)]
    path = tmp_path / "station.yaml"
    path.write_text("\n".join(["a0: &a0 {k: 1}", *levels]))
    with pytest.raises(InputError, match="'<<' merges keys"):
        read_station(tmp_path)
    with pytest.raises(ConfigError, match="'<<' merges keys"):
        load_site(path)
    assert not places_sensors(["--config", str(path)])


def test_announced_points_take_no_memory(tmp_path: Path, fails) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    head = b"\x93NUMPY\x01\x00\x76\x00"
    text = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000, 3), }"
    (folder / "1700000000.5.npy").write_bytes(head + text.ljust(117) + b"\n" + bytes(24))
    assert "1700000000.5.npy" in fails(4, "convert", folder, tmp_path / "out")
    (folder / "1700000000.5.npy").unlink()
    np.save(folder / "1700000000.5.npy", np.ones((2, 3)))
    assert main(["convert", str(folder), str(tmp_path / "out")]) == 0


@given(st.text(max_size=2000))
def test_a_message_is_one_printable_line_of_bounded_length(text: str) -> None:
    line = shortened(text)
    assert len(line) <= 240
    assert line.isprintable()


def test_a_long_message_keeps_its_file_and_how_it_ends() -> None:
    path = f"/data/{'deep/' * 60}flight.bag"
    line = shortened(f"{path}: {'why ' * 100}expected something else")
    assert "flight.bag: " in line
    assert line.endswith("expected something else")


@given(st.lists(st.text("abc/", min_size=1, max_size=400), min_size=1, max_size=300))
def test_a_list_of_names_says_how_many_it_leaves_out(names: list[str]) -> None:
    said = listed(names)
    assert len(said) <= 240
    left_out = int(said.split()[-2]) if said.endswith(" more") else 0
    assert len(said.removesuffix(f" and {left_out} more").split(", ")) + left_out == len(names)
