"""`--record-packets`: what came by UDP, in captures that are read as those of tcpdump are."""

from __future__ import annotations

import json
import random
import resource
import shutil
import signal
import socket
import struct
import subprocess
import time
from pathlib import Path

import pytest
from live_program import ENDLESS, wait_until
from livox_sensor import Listening, Packet, accelerations2, protocol1, protocol2, sweep
from synthetic import PROGRAM, make_flight
from test_live_status import metrics_of, state_of
from unlidar.capture import Datagram, datagrams, missing_captures
from unlidar.cli import main

MEGABYTE = 1_000_000


@pytest.fixture(scope="module")
def packets() -> list[Packet]:
    return sweep(make_flight())


@pytest.fixture(scope="module")
def station(packets: list[Packet]) -> list[tuple[str, bytes]]:
    """The sender and the payload of packets of two LiDARs, and of others."""
    sent = []
    for k, packet in enumerate(packets):
        if k % 2:
            sent.append(("127.0.0.3", protocol1(packet)))
        else:
            sent.append(("127.0.0.2", protocol2(packet, counter=k // 2)))
        if k % 100 == 0:
            sent.append(("127.0.0.2", accelerations2(k)))
            sent.append(("127.0.0.4", b"rubbish"))
            sent.append(("127.0.0.4", b""))
            sent.append(("127.0.0.4", bytes(3000)))  # more than a packet of points has
    return sent


def receive(live: Listening, sent: list[tuple[str, bytes]]) -> None:
    for source in sorted({source for source, _ in sent}):
        assert source.startswith("127."), source
    batch: list[bytes] = []
    for k, (source, payload) in enumerate(sent):
        batch.append(payload)
        if k + 1 == len(sent) or sent[k + 1][0] != source:
            live.receive(batch, source)
            batch = []


def captures_in(folder: Path) -> list[Path]:
    return sorted(folder.glob("packets_*.pcap"))


def size_of(folder: Path) -> int:
    """Of its captures; the oldest one may go meanwhile."""
    total = 0
    for path in captures_in(folder):
        try:
            total += path.stat().st_size
        except FileNotFoundError:
            continue
    return total


def whole_packets(path: Path) -> list[bytes]:
    """The IP packets of a capture, each whole, by the format's description."""
    data = path.read_bytes()
    magic, major, minor, _, _, _, link = struct.unpack_from("<IHHiIII", data)
    assert (magic, major, minor, link) == (0xA1B23C4D, 2, 4, 101)
    at, found = 24, []
    while at < len(data):
        _, ns, kept, length = struct.unpack_from("<IIII", data, at)
        assert ns < 10**9 and kept <= length
        found.append(data[at + 16 : at + 16 + kept])
        assert len(found[-1]) == kept, f"{path} ends within a packet"
        at += 16 + kept
    return found


def key(one: Datagram) -> tuple[str, bytes]:
    return one.source, one.payload


# --- the same packets, the same result ------------------------------------------------------------


@pytest.fixture(scope="module")
def recorded(station: list[tuple[str, bytes]], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a live run: traj.csv, summary.json, state.json, x.prom and packets/."""
    folder = tmp_path_factory.mktemp("live")
    files = ("--summary", folder / "summary.json", "--state", folder / "state.json")
    metrics = ("--metrics", folder / "x.prom")
    limits = ("--record-packets-bytes", "100MB", "--record-packets-file-bytes", "1MB")
    record = ("--record-packets", folder / "packets", *limits)
    with Listening("--out", folder / "traj.csv", *files, *metrics, *record, *ENDLESS) as live:
        began_s = time.time()
        receive(live, station)
        code, _, said = live.end(signal.SIGTERM)
    assert code == 0, said
    assert "not recorded" not in said
    for one in datagrams(folder / "packets"):
        assert began_s - 1 < one.time_ns * 1e-9 < time.time() + 1
    return folder


def test_captures_hold_all_packets_in_order(
    recorded: Path, station: list[tuple[str, bytes]]
) -> None:
    folder = recorded / "packets"
    assert len(captures_in(folder)) > 1
    found = [packet for path in captures_in(folder) for packet in whole_packets(path)]
    assert len(found) == len(station)
    assert [(socket.inet_ntoa(p[12:16]), p[28:]) for p in found] == [
        (source, payload[:2048]) for source, payload in station
    ]
    assert {struct.unpack_from(">H", p, 2)[0] for p in found if len(p) == 2076} == {3028}
    # One that was cut off is passed over, as those of tcpdump are.
    assert [key(d) for d in datagrams(folder)] == [one for one in station if len(one[1]) < 2048]
    summary = json.loads((recorded / "summary.json").read_text())
    assert summary["packet_recording"] == {
        "packets": len(station),
        "lost_packets": 0,
        "bytes": size_of(folder),
    }
    assert state_of(recorded / "state.json")["packet_recording"] == summary["packet_recording"]
    metrics = metrics_of(recorded / "x.prom")
    assert metrics['unlidar_packets_recorded_total{fate="written"}'] == len(station)
    assert metrics["unlidar_recording_bytes"] == size_of(folder)


def test_played_back_they_give_the_same_rows(recorded: Path, tmp_path: Path, capsys) -> None:
    out, summary = tmp_path / "traj.csv", tmp_path / "summary.json"
    with Listening("--out", out, "--summary", summary, *ENDLESS) as live:
        to = f"127.0.0.1:{live.port}"
        assert main(["play", str(recorded / "packets"), "--to", to, "--rate", "inf"]) == 0
        code, _, said = live.end(signal.SIGTERM)
    assert code == 0, said
    assert out.read_bytes() == (recorded / "traj.csv").read_bytes()
    assert out.read_bytes().count(b"\n") > 20
    before, after = (json.loads(p.read_text()) for p in (recorded / "summary.json", summary))
    assert after["inputs"] == before["inputs"]


def test_converted_they_give_the_same_rows(recorded: Path, tmp_path: Path, capsys) -> None:
    """Protocol 1 does not say how long its packets take; the converter estimates it otherwise."""
    frames = tmp_path / "frames"
    assert main(["convert", str(recorded / "packets"), str(frames)]) == 0
    sensors = ("127-0-0-2", "127-0-0-3")
    given = [word for name in sensors for word in ("--frames", f"{name}={frames / name}")]
    subprocess.run([PROGRAM, *given, "--out", tmp_path / "traj.csv"], check=True)
    by_frames, live = (
        [line.split(",") for line in (folder / "traj.csv").read_text().splitlines()[1:]]
        for folder in (tmp_path, recorded)
    )
    assert [row[:2] for row in by_frames] == [row[:2] for row in live] and len(live) > 20
    for a, b in zip(by_frames, live, strict=True):
        assert [float(x) for x in a[2:5]] == pytest.approx([float(x) for x in b[2:5]], abs=0.005)


def test_several_other_captures_are_no_series(recorded: Path, tmp_path: Path, fails) -> None:
    first, second, *_ = captures_in(recorded / "packets")
    shutil.copy(first, tmp_path / "a.pcap")
    shutil.copy(second, tmp_path / "b.pcap")
    assert "holds recordings" in fails(4, "convert", tmp_path, tmp_path / "out")
    # Wireshark's ring buffer is one, in the order of its numbers.
    (tmp_path / "b.pcap").rename(tmp_path / "eth0_00010_20260101000000.pcap")
    (tmp_path / "a.pcap").rename(tmp_path / "eth0_9_20260101000009.pcap")
    assert [key(d) for d in datagrams(tmp_path)] == [
        key(d) for path in (first, second) for d in datagrams(path)
    ]
    assert missing_captures(tmp_path) == []
    far = tmp_path / "eth0_99000000000013_20260101000012.pcap"
    (tmp_path / "eth0_00010_20260101000000.pcap").rename(far)
    assert main(["convert", str(tmp_path), str(tmp_path / "out")]) == 0
    (note,) = json.loads((tmp_path / "out" / "conversion.json").read_text())["notes"]
    assert note == "99000000000003 of its captures are missing, the first is number 10"


# --- whatever happens -----------------------------------------------------------------------------


def test_a_killed_run_leaves_whole_packets_but_those_of_its_last_second(
    packets: list[Packet], tmp_path: Path
) -> None:
    payloads = [protocol2(p) for p in packets]
    rng = random.Random(4)
    for run in range(4):
        folder = tmp_path / f"{run}"
        arguments = ("--out", tmp_path / f"{run}.csv", "--record-packets", folder)
        with Listening(*arguments) as live:
            sent = payloads[: rng.randrange(100, len(payloads))]
            live.receive(sent)
            if run % 2:  # after that second
                expected = 24 + sum(16 + 28 + len(payload) for payload in sent)
                wait_until(lambda f=folder, e=expected: size_of(f) == e, "all are written")
            live.process.kill()
            live.process.wait()
        found = [p[28:] for path in captures_in(folder) for p in whole_packets(path)]
        assert found == sent[: len(found)]
        assert len(found) == len(sent) or run % 2 == 0


def test_they_are_never_more_than_asked_for(packets: list[Packet], tmp_path: Path) -> None:
    folder = tmp_path / "packets"
    folder.mkdir()
    (folder / "mine.txt").write_text("mine")
    payloads = 3 * [protocol2(p) for p in packets]
    limits = ("--record-packets-bytes", "2MB", "--record-packets-file-bytes", "1MB")
    with Listening("--out", tmp_path / "t.csv", "--record-packets", folder, *limits) as live:
        for k in range(0, len(payloads), 50):
            live.receive(payloads[k : k + 50])
            # The oldest one may go while the sizes are added.
            assert min(size_of(folder) for _ in range(3)) <= 2 * MEGABYTE
        code, _, said = live.end(signal.SIGTERM)
    assert code == 0, said
    found = [p[28:] for path in captures_in(folder) for p in whole_packets(path)]
    assert MEGABYTE < size_of(folder) <= 2 * MEGABYTE < sum(map(len, payloads))
    assert found == payloads[-len(found) :]
    assert (folder / "mine.txt").read_text() == "mine"


def test_a_disk_that_takes_no_more_stops_nothing(packets: list[Packet], tmp_path: Path) -> None:
    payloads = [protocol2(p) for p in packets]
    rows = []
    for name, limit in (("without", None), ("with", 200_000)):
        folder = tmp_path / name
        folder.mkdir()
        summary = folder / "summary.json"
        with Listening(
            *("--out", folder / "traj.csv", "--summary", summary),
            *("--record-packets", folder / "packets"),
        ) as live:
            if limit:
                resource.prlimit(live.process.pid, resource.RLIMIT_FSIZE, (limit, limit))
            live.receive(payloads)
            code, _, said = live.end(signal.SIGTERM)
        assert code == 0, said
        rows.append((folder / "traj.csv").read_bytes())
        counts = json.loads(summary.read_text())["packet_recording"]
        assert counts["packets"] + counts["lost_packets"] == len(payloads)
        assert (counts["lost_packets"] > 0) == (limit is not None)
        assert said.count("packets are not recorded: ") == (limit is not None), said
        assert said.count("packets not recorded (--record-packets)") == (limit is not None), said
        assert (
            sum(len(whole_packets(p)) for p in captures_in(folder / "packets"))
            == (counts["packets"])
        )
    assert rows[0] == rows[1] and rows[0].count(b"\n") > 20


def test_a_folder_that_is_removed_stops_nothing(packets: list[Packet], tmp_path: Path) -> None:
    payloads = [protocol2(p) for p in packets]
    folder = tmp_path / "packets"
    with Listening("--out", tmp_path / "t.csv", "--record-packets", folder) as live:
        live.receive(payloads[:300])
        wait_until(lambda: size_of(folder) > 300_000, "it records")
        shutil.rmtree(folder)
        live.receive(payloads[300:600])
        time.sleep(1.5)
        folder.mkdir()
        live.receive(payloads[600:])
        wait_until(lambda: size_of(folder) > 100_000, "it records again")
        code, _, said = live.end(signal.SIGTERM)
    assert code == 0, said
    assert said.count("packets are not recorded: ") == 1
    found = [p[28:] for path in captures_in(folder) for p in whole_packets(path)]
    assert found == payloads[-len(found) :]


def test_a_folder_that_cannot_be_written_is_said_before_the_work(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with Listening("--out", tmp_path / "a.csv", "--record-packets", tmp_path / "taken"):
        for name in ("file", "none/below", "taken"):
            record = ("--record-packets", tmp_path / name)
            done = subprocess.run(
                [PROGRAM, "--livox", "127.0.0.1:0", "--out", tmp_path / "b.csv", *record],
                capture_output=True,
                text=True,
                timeout=60,
            )
            assert done.returncode == 5 and done.stderr.count("\n") == 1, done.stderr
            assert str(tmp_path / name) in done.stderr and not (tmp_path / "b.csv").exists()
