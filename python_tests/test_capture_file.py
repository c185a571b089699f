"""Captures are read by the formats' descriptions, and cut anywhere keep what lies before."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import replace
from itertools import accumulate
from pathlib import Path

import pytest
from livox_sensor import BEGIN_NS, Packet, protocol2, sweep
from pcap_files import (
    pcapng_block,
    pcapng_interface,
    pcapng_packet,
    pcapng_section,
    udp_frame,
    write_pcap,
    write_pcapng,
)
from synthetic import make_flight
from unlidar.capture_file import CutOffError, captured_packets
from unlidar.errors import InputError
from unlidar.frames_io import list_frames

ETHERNET, RAW_IP = 1, 101
STATISTICS = 5  # a type of block that is passed over
FRAMES = [(BEGIN_NS + k * 40_000_000, bytes([k]) * (5 + k)) for k in range(1, 4)]


def option(code: int, value: bytes, order: str = "<") -> bytes:
    return struct.pack(order + "HH", code, len(value)) + value + bytes(-len(value) % 4)


def pcap_borders(frames: list[tuple[int, bytes]]) -> list[int]:
    return list(accumulate((16 + len(data) for _, data in frames), initial=24))


def pcapng_borders(path: Path, order: str) -> list[int]:
    """Where blocks end."""
    data, at, borders = path.read_bytes(), 0, []
    while at < len(data):
        at += struct.unpack_from(order + "I", data, at + 4)[0]
        borders.append(at)
    return borders


@pytest.fixture(params=["pcap <", "pcap >", "pcapng <", "pcapng >"])
def form(request: pytest.FixtureRequest) -> tuple[Callable, str]:
    kind, order = request.param.split()
    return write_pcap if kind == "pcap" else write_pcapng, order


def borders_of(path: Path, form: tuple[Callable, str], frames: list[tuple[int, bytes]]) -> set[int]:
    if form[0] is write_pcap:
        return set(pcap_borders(frames))
    return set(pcapng_borders(path, form[1]))


def read_up_to_error(path: Path) -> tuple[list, InputError | None]:
    found = []
    try:
        for packet in captured_packets(path):
            found.append(packet)
    except InputError as error:
        return found, error
    return found, None


def test_packets_and_their_times_arrive(form: tuple[Callable, str], tmp_path: Path) -> None:
    write, order = form
    found = list(captured_packets(write(tmp_path / "a.pcap", FRAMES, order=order)))
    assert found == [(time_ns, ETHERNET, data) for time_ns, data in FRAMES]


def test_a_capture_cut_at_any_byte_keeps_the_packets_before(
    form: tuple[Callable, str], tmp_path: Path
) -> None:
    whole = form[0](tmp_path / "a.pcap", FRAMES, order=form[1])
    content, packets = whole.read_bytes(), list(captured_packets(whole))
    borders = borders_of(whole, form, FRAMES)
    ends = sorted(borders)[-len(FRAMES) :]
    cut = tmp_path / "cut.pcap"
    for size in range(len(content)):
        cut.write_bytes(content[:size])
        found, error = read_up_to_error(cut)
        before = sum(end <= size for end in ends)
        assert found == packets[:before]
        if size in borders:  # as if the recorder had been stopped there
            assert error is None
        else:
            assert isinstance(error, CutOffError)
            assert str(error) == f"{cut}: is cut off at byte {size:,}, after packet {before}"


def test_the_frames_of_a_capture_cut_at_any_byte_are_kept(
    form: tuple[Callable, str], tmp_path: Path, fails
) -> None:
    packets: list[Packet] = sweep(make_flight())[:90:30]
    frames = [
        (p.stamp_ns, udp_frame(protocol2(replace(p, units=p.units[:2])), "10.0.0.9"))
        for p in packets
    ]
    whole = form[0](tmp_path / "a.pcap", frames, order=form[1])
    content = whole.read_bytes()
    borders = borders_of(whole, form, frames)
    ends = sorted(borders)[-len(frames) :]
    cut, out = tmp_path / "cut.pcap", tmp_path / "out"
    for size in sorted(set(range(0, len(content), 3)) | {end + 16 for end in ends[:-1]}):
        if size in borders:
            continue
        cut.write_bytes(content[:size])
        before = sum(end <= size for end in ends)
        said = fails(4, "convert", cut, out, "--force")
        assert f"{cut}: is cut off at byte {size:,}, after packet {before}" in said
        assert out.exists() == (before > 0)
        assert not before or len(list_frames(out / "10-0-0-9")) == before


def test_units_of_time_are_those_of_each_interface(tmp_path: Path) -> None:
    """Of each section anew: both count their interfaces from 0."""
    file = tmp_path / "a.pcapng"
    file.write_bytes(
        pcapng_section()
        + pcapng_block(STATISTICS, bytes(12))
        + pcapng_interface()
        + pcapng_interface(option(9, b"\x09") + option(0, b""), link=RAW_IP)
        + pcapng_packet(7, b"a")
        + pcapng_packet(7, b"b", 1)
        + pcapng_block(STATISTICS, bytes(12))
        + pcapng_section(">")
        + pcapng_interface(
            option(2, b"eth0", ">") + option(9, b"\x8a", ">") + option(14, b"\0" * 7 + b"\2", ">"),
            ">",
        )
        + pcapng_packet(512, b"c", 0, ">")
    )
    assert list(captured_packets(file)) == [
        (7_000, ETHERNET, b"a"),
        (7, RAW_IP, b"b"),
        (2_500_000_000, ETHERNET, b"c"),
    ]


def test_nanoseconds_and_further_fields_of_a_pcap(tmp_path: Path) -> None:
    file = tmp_path / "a.pcap"
    rest = struct.pack(">HHiIII", 2, 4, 0, 0, 65535, 0x14000001)  # checksums of four bytes
    file.write_bytes(
        b"\xa1\xb2\x3c\x4d" + rest + struct.pack(">IIII", 5, 999_999_999, 1, 60) + b"a"
    )
    assert list(captured_packets(file)) == [(5_999_999_999, ETHERNET, b"a")]
    rest = struct.pack("<HHiIII", 2, 4, 0, 0, 65535, 1)
    head = struct.pack("<IIIIIHBB", 5, 7, 1, 60, 0, 0, 0, 0)
    file.write_bytes(b"\x34\xcd\xb2\xa1" + rest + head + b"a")
    assert list(captured_packets(file)) == [(5_000_007_000, ETHERNET, b"a")]


@pytest.mark.parametrize(
    ("damage", "named"),
    [
        (pcapng_packet(1, b"b", 7), "a packet of interface 7, there are 1"),
        (pcapng_packet(1, b""), "a packet of 0 bytes"),
        (bytes(64), "a block of 0 bytes"),
        (pcapng_block(STATISTICS, b"")[:-1] + b"\1", "a block whose end has another length"),
        (pcapng_block(6, struct.pack("<IIIII", 0, 0, 0, 99, 99)), "a packet of 99 bytes in a"),
        (b"\x0a\x0d\x0d\x0a" + bytes(24), "a section of unknown byte order"),
        (pcapng_block(6, bytes(16)), "a packet in a block of 28 bytes, expected at least 32"),
        (pcapng_block(2, b""), "a packet in a block of 12 bytes, expected at least 32"),
        (pcapng_block(1, bytes(4)), "an interface in a block of 16 bytes, expected at least 20"),
    ],
)
def test_damage_is_told_by_packet_and_byte(damage: bytes, named: str, tmp_path: Path) -> None:
    file = tmp_path / "a.pcapng"
    file.write_bytes(pcapng_section() + pcapng_interface() + pcapng_packet(1, b"a") + damage)
    found, error = read_up_to_error(file)
    assert [packet.data for packet in found] == [b"a"]
    assert f"{file}: damaged before byte" in str(error)
    assert f"after packet 1: {named}" in str(error)


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (option(14, struct.pack("<q", 1 << 61)), "a packet of 2.306e+18 s, expected Unix time"),
        (option(14, struct.pack("<q", -(1 << 61))), "a packet of -2.306e+18 s, expected Unix time"),
        (option(9, b"\x80"), "a packet of 1e+12 s, expected Unix time"),
    ],
)
def test_a_time_that_is_none_is_damage(options: bytes, named: str, tmp_path: Path, fails) -> None:
    file = tmp_path / "a.pcapng"
    before = pcapng_interface() + pcapng_packet(1, b"a")
    bad = pcapng_interface(options) + pcapng_packet(10**12, b"b", 1)
    file.write_bytes(pcapng_section() + before + bad)
    found, error = read_up_to_error(file)
    assert [packet.data for packet in found] == [b"a"]
    assert f"after packet 1: {named}" in str(error)
    assert "a.pcapng: damaged before byte" in fails(4, "convert", file, tmp_path / "out")


def test_an_option_whose_value_is_missing_is_passed_over(tmp_path: Path) -> None:
    file = tmp_path / "a.pcapng"
    interface = pcapng_interface(struct.pack("<HH", 9, 1))
    file.write_bytes(pcapng_section() + interface + pcapng_packet(7, b"a"))
    assert list(captured_packets(file)) == [(7_000, ETHERNET, b"a")]


def test_a_pcap_of_nothing_but_zeros_behind_its_first_packet_is_damaged(tmp_path: Path) -> None:
    file = write_pcap(tmp_path / "a.pcap", FRAMES[:1])
    for behind, named in (
        (bytes(4096), "a packet of 0 bytes"),
        (b"\xff" * 64, "a packet of 4,294,967,295 bytes, expected at most 262,144"),
    ):
        file.write_bytes(write_pcap(tmp_path / "b.pcap", FRAMES[:1]).read_bytes() + behind)
        found, error = read_up_to_error(file)
        assert len(found) == 1
        assert f"after packet 1: {named}" in str(error)
