"""`unlidar sensor livox` against a LiDAR of the tests' own; none was there to try it on."""

from __future__ import annotations

import socket
import struct

import pytest
from livox_device import IDLE, SAMPLING, Device, crc16
from unlidar import livox_control
from unlidar.cli import main

HERE = "127.0.0.1"


@pytest.fixture(autouse=True)
def _patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """Answers come within a moment, but a loaded machine takes its time."""
    monkeypatch.setattr(livox_control, "_TRIES", 40)
    monkeypatch.setattr(livox_control, "_ANSWER_S", 0.5)


def sensor(device: Device, *options: str) -> list[str]:
    port = str(device.discovery_port)
    return ["sensor", "livox", "--host", HERE, "--discovery-port", port, *options]


@pytest.mark.parametrize(
    ("model", "name", "port"),
    [
        *((9, "Mid-360", 56300), (10, "HAP", 57000), (15, "HAP", 57000), (16, "PA", 56300)),
        *((35, "Mid-360S", 56300), (40, "Avia 2", 56300), (99, "of type 99", 56300)),
    ],
)
def test_it_is_found_told_where_to_send_to_and_started(
    model: int, name: str, port: int, capsys
) -> None:
    with Device(model=model) as device:
        assert main(sensor(device, "--lidar", device.address, "--port", "56999")) == 0
    assert capsys.readouterr().out == (
        f"127.0.0.2: {name}, serial number 47MDK9DF710030, measuring, clock synchronised by PTP, "
        "sends to 127.0.0.1:56999\n"
    )
    assert device.wrong == []
    assert device.requests[:3] == [0, 0x0100, 0x0100]
    assert set(device.requests[3:]) == {0x0101}
    assert device.settings == {
        0x0000: b"\1",  # 32-bit Cartesian
        0x0006: socket.inet_aton(HERE) + struct.pack("<HH", 56999, port),
        0x001A: bytes([SAMPLING]),
    }


def test_it_is_stopped(capsys) -> None:
    with Device(mode=SAMPLING) as device:
        assert main(sensor(device, "--lidar", device.address, "--stop")) == 0
    assert device.settings == {0x001A: bytes([IDLE])}
    assert ", idle, clock " in capsys.readouterr().out


def test_those_that_answer_are_listed_and_left_alone(monkeypatch, capsys) -> None:
    with Device() as device:
        monkeypatch.setattr(
            livox_control.discover, "__defaults__", (device.address, device.discovery_port)
        )
        assert main(sensor(device)) == 0
    assert capsys.readouterr().out == "127.0.0.2: Mid-360, serial number 47MDK9DF710030\n"
    assert set(device.requests) == {0}


def test_lost_and_broken_answers_are_asked_for_again(monkeypatch) -> None:
    def spoil(count: int, data: bytes) -> bytes | None:
        if count % 4 == 1:
            return None
        if count % 4 == 2:
            return data[:-1] + bytes([data[-1] ^ 1])
        return data[:20] if count % 4 == 3 else data

    monkeypatch.setattr(livox_control, "_ANSWER_S", 0.05)
    with Device(spoil=spoil) as device:
        assert main(sensor(device, "--lidar", device.address)) == 0
    assert device.mode == SAMPLING
    assert device.wrong == []


def test_what_refuses_is_reported(fails) -> None:
    with Device(refuse=0x20) as device:
        said = fails(4, *sensor(device, "--lidar", device.address))
    assert said.endswith("127.0.0.2: refuses the setting 0x0000: code 32, expected 0")


def test_what_does_not_answer_is_reported(fails, monkeypatch) -> None:
    monkeypatch.setattr(livox_control, "_TRIES", 2)
    monkeypatch.setattr(livox_control, "_ANSWER_S", 0.05)
    with Device(spoil=lambda *_: None) as device:
        said = fails(4, *sensor(device, "--lidar", device.address))
        assert "127.0.0.2: does not answer, expected a Livox LiDAR" in said
    silent = Device(spoil=lambda count, data: data if count == 1 else None)
    with silent as device:
        said = fails(4, *sensor(device, "--lidar", device.address))
    assert "gives no answer to command 0x0100" in said


def test_what_never_starts_is_reported(fails, monkeypatch) -> None:
    from unlidar.cli import sensor as command

    monkeypatch.setattr(command, "_STARTS_WITHIN_S", 0.5)
    with Device(never_starts=True) as device:
        said = fails(4, *sensor(device, "--lidar", device.address))
    assert "127.0.0.2: is not measuring but in state 6" in said


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (("--host", "203.0.113.7"), "expected an address of this computer"),
        (("--host", "here"), "expected an IPv4 address"),
        ((), "--host"),
        (("--host", HERE, "--port", "0"), "expected a port"),
        (("--host", HERE, "--lidar", "1.2.3"), "expected an IPv4 address"),
    ],
)
def test_what_is_no_address_is_a_usage_error(
    options: tuple[str, ...], expected: str, fails
) -> None:
    assert expected in fails(2, "sensor", "livox", *options)


def test_messages_are_what_the_document_says() -> None:
    message = livox_control.pack(0x0100, 7, b"abc")
    assert message[:12] == bytes([0xAA, 0, 27, 0, 7, 0, 0, 0, 0, 1, 0, 0])
    assert struct.unpack_from("<H", message, 18)[0] == crc16(message[:18])
    assert livox_control.pack(0, 1, b"")[20:] == bytes(4)
    assert crc16(b"123456789") == 0x29B1  # of the catalogue of checksums
