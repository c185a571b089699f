"""`--livox`: the packets of a LiDAR by UDP, from a sensor of the tests' own."""

from __future__ import annotations

import json
import random
import re
import signal
import socket
import struct
import time
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from live_program import ENDLESS, events_of, feed, messages, rows_of, wait_until
from livox_sensor import (
    BEGIN_NS,
    CARTESIAN_CM,
    CARTESIAN_MM,
    FRAME_NS,
    SPHERICAL,
    Listening,
    Packet,
    accelerations2,
    protocol1,
    protocol2,
    sweep,
    write_as_frames,
)
from synthetic import make_flight, run_program
from test_live_status import metrics_of, schema, state_of


@pytest.fixture(scope="module")
def packets() -> list[Packet]:
    return sweep(make_flight())


@pytest.fixture(scope="module")
def by_stdin(packets: list[Packet], tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Rows of the same points, given as frames."""
    return rows_by_stdin(packets, tmp_path_factory.mktemp("by_stdin"))


def rows_by_stdin(packets: Iterable[Packet], folder: Path, *options: str) -> bytes:
    frames = write_as_frames(folder / "frames", packets)
    code, _, said = feed(b"".join(messages(lidar=frames)), folder / "traj.csv", *options)
    assert code == 0, said
    rows = (folder / "traj.csv").read_bytes()
    assert rows.count(b"\n") > 20
    return rows


def rows_by_packets(
    sent: Iterable[bytes], folder: Path, *options: str | Path
) -> tuple[bytes, dict, str]:
    """Rows, the summary and what was said."""
    summary = folder / "summary.json"
    with Listening("--out", folder / "traj.csv", "--summary", summary, *options) as live:
        live.receive(sent)
        code, _, said = live.end(signal.SIGTERM)
    assert code == 0, said
    return (folder / "traj.csv").read_bytes(), json.loads(summary.read_text()), said


def packets_of(summary: dict) -> dict:
    assert len(summary["inputs"]) == 1
    return summary["inputs"][0]["packets"]


# --- the same points, the same rows -------------------------------------------------------------


@pytest.mark.parametrize("options", [(), ENDLESS], ids=["live", "endless"])
@pytest.mark.parametrize("protocol", [protocol2, protocol1])
def test_packets_give_the_rows_of_the_same_points(
    protocol, options: tuple[str, ...], packets: list[Packet], tmp_path: Path
) -> None:
    expected = rows_by_stdin(packets, tmp_path, *options)
    (tmp_path / "traj.csv").unlink()
    rows, summary, _ = rows_by_packets(map(protocol, packets), tmp_path, *options)
    assert rows == expected
    assert summary["inputs"][0]["name"] == "127-0-0-1"
    counts = packets_of(summary)
    assert counts.pop("used") == len(packets)
    assert set(counts.values()) == {0}
    assert summary["counts"]["no_return_rows"] == sum(
        int((p.units == 0).all(axis=1).sum()) for p in packets
    )


def test_centimetres_do_as_well(tmp_path: Path) -> None:
    packets = sweep(make_flight(), 0.01)
    expected = rows_by_stdin(packets, tmp_path)
    (tmp_path / "traj.csv").unlink()
    sent = [protocol2(p, CARTESIAN_CM) for p in packets]
    assert rows_by_packets(sent, tmp_path)[0] == expected


def test_so_do_angles_within_their_steps(
    packets: list[Packet], by_stdin: bytes, tmp_path: Path
) -> None:
    sent = [protocol2(p, SPHERICAL) for p in packets]
    rows, _, _ = rows_by_packets(sent, tmp_path)
    expected = np.genfromtxt(by_stdin.decode().splitlines(), delimiter=",", names=True)
    got = np.genfromtxt(rows.decode().splitlines(), delimiter=",", names=True)
    assert len(got) >= 0.9 * len(expected)
    at = np.searchsorted(expected["timestamp"], got["timestamp"]).clip(max=len(expected) - 1)
    for axis in "xyz":  # a hundredth of a degree at 10 m
        assert np.median(np.abs(got[axis] - expected[axis][at])) < 0.01


def test_frames_are_as_long_as_the_config_says(packets: list[Packet], tmp_path: Path) -> None:
    rows, summary, _ = rows_by_packets(
        map(protocol2, packets), tmp_path, "--set", "live.frame_s=0.05"
    )
    assert rows.count(b"\n") > 40
    assert summary["counts"]["frames"] == 120


def test_several_sensors_are_distinguished_by_address_and_slot(
    packets: list[Packet], tmp_path: Path
) -> None:
    """Of a direct LiDAR, and two at a hub; each saw a third of the packets."""
    summary = tmp_path / "summary.json"
    pose = ("--set", "sensors.roof.translation_m=[0, 0, 5]", "--rate", "10")
    with Listening("--out", tmp_path / "traj.csv", "--summary", summary, *pose) as live:
        for k in range(0, len(packets), 30):
            part = packets[k : k + 30]
            live.receive([protocol1(p, slot=3, lidar=2) for p in part[2::3]], "127.0.0.3")
            live.receive([protocol1(p, slot=2) for p in part[1::3]], "127.0.0.3")
            live.receive(map(protocol2, part[::3]), "127.0.0.2")
        code, _, said = live.end(signal.SIGTERM)
    assert code == 0, said
    inputs = json.loads(summary.read_text())["inputs"]
    # By address, whoever was first.
    assert [one["name"] for one in inputs] == ["127-0-0-2", "127-0-0-3-2-1", "127-0-0-3-3-2"]
    assert sum(one["packets"]["used"] for one in inputs) == len(packets)
    assert "the config has no sensors.127-0-0-3-2-1" in said


# --- synchronisation ----------------------------------------------------------------------------


def seconds_of(packets: list[Packet], seconds: int) -> list[Packet]:
    """The packets again and again, with numbers and stamps that go on."""
    of_flight = len(packets)
    spacing_ns = packets[1].stamp_ns - packets[0].stamp_ns
    return [
        replace(packets[k % of_flight], number=k, stamp_ns=BEGIN_NS + k * spacing_ns)
        for k in range(seconds * 10**9 // spacing_ns)
    ]


def test_a_lidar_that_loses_its_synchronisation_is_told_of_once(
    packets: list[Packet], tmp_path: Path
) -> None:
    """It comes and goes for a while, and is there again at the end."""

    def time_type(second: float) -> int:
        if second < 4 or second >= 16:
            return 1
        return int(second % 3 < 1)

    sent = [
        protocol2(p, time_type=time_type((p.stamp_ns - BEGIN_NS) * 1e-9))
        for p in seconds_of(packets, 30)
    ]
    events, metrics, state = tmp_path / "events", tmp_path / "x.prom", tmp_path / "state.json"
    rows, summary, said = rows_by_packets(
        sent, tmp_path, "--events", events, "--metrics", metrics, "--state", state
    )
    told = [e for e in events_of(events) if e["event"] == "sensor"]
    assert [(e["state"], e["clock"]) for e in told] == [
        ("ok", "synchronised"),
        ("ok", "lost"),
        ("ok", "synchronised"),
    ]
    begun_s = BEGIN_NS * 1e-9
    assert 4 < told[1]["at"] - begun_s < 7 and 24 < told[2]["at"] - begun_s < 28
    for event in told:
        jsonschema.validate(event, schema("events"))
    assert said.count("127-0-0-1: has lost its time synchronisation (PTP, GPS)") == 1
    assert said.count("127-0-0-1: lost its time synchronisation 1 time") == 1
    assert packets_of(summary)["used"] == len(sent)
    one = summary["inputs"][0]
    assert (one["clock"], one["clock_losses"]) == ("synchronised", 1)
    assert state_of(state)["sensors"][0]["clock"] == "synchronised"
    found = metrics_of(metrics)
    assert found['unlidar_sensor_clock{sensor="127-0-0-1",clock="synchronised"}'] == 1
    assert found['unlidar_sensor_clock{sensor="127-0-0-1",clock="lost"}'] == 0
    assert found['unlidar_sensor_clock_losses_total{sensor="127-0-0-1"}'] == 1
    assert rows.count(b"\n") > 20


def test_a_lidar_that_never_was_synchronised_has_lost_nothing(
    packets: list[Packet], tmp_path: Path
) -> None:
    sent = (protocol1(p, time_type=0) for p in packets)
    events = tmp_path / "events"
    _, summary, said = rows_by_packets(sent, tmp_path, "--events", events)
    told = [e for e in events_of(events) if e["event"] == "sensor"]
    assert [e["clock"] for e in told] == ["unsynchronised"]
    assert summary["inputs"][0]["clock_losses"] == 0 and "synchronisation" not in said


def test_the_states_of_sensors_are_those_of_their_names(
    packets: list[Packet], tmp_path: Path
) -> None:
    """The one with the higher address is heard first, and falls silent."""
    state = tmp_path / "state.json"
    with Listening("--out", tmp_path / "traj.csv", "--state", state) as live:
        for k in range(0, len(packets), 20):
            part = packets[k : k + 20]
            if k < len(packets) // 4:
                live.receive((protocol2(p) for p in part[1::2]), "127.0.0.9")
            live.receive((protocol2(p) for p in part[::2]), "127.0.0.2")
        code, _, said = live.end(signal.SIGTERM)
    assert code == 0, said
    told = {one["name"]: one["state"] for one in state_of(state)["sensors"]}
    assert told == {"127-0-0-2": "ok", "127-0-0-9": "silent"}


# --- anybody may send to a port -----------------------------------------------------------------


def test_where_the_config_names_addresses_nobody_else_is_heard(
    packets: list[Packet], by_stdin: bytes, tmp_path: Path
) -> None:
    summary, out = tmp_path / "summary.json", tmp_path / "traj.csv"
    named = ("--set", "sensors.127-0-0-1.time_offset_s=0")
    with Listening("--out", out, "--summary", summary, *named) as live:
        for host in range(2, 72):
            live.receive([protocol2(packets[0])], f"127.0.0.{host}")
        live.receive([protocol1(packets[0], slot=2)])
        live.receive(map(protocol2, packets))
        code, _, said = live.end(signal.SIGTERM)
    assert code == 0, said
    assert out.read_bytes() == by_stdin
    told = json.loads(summary.read_text())
    assert [one["name"] for one in told["inputs"]] == ["127-0-0-1"]
    assert told["counts"]["refused_packets"] == 71
    assert "from 127.0.0.2 is of 127-0-0-2, expected one that sensors names" in said


def test_packets_of_ever_new_senders_cost_no_lidar_its_place(
    packets: list[Packet], by_stdin: bytes, tmp_path: Path
) -> None:
    summary, out = tmp_path / "summary.json", tmp_path / "traj.csv"
    with Listening("--out", out, "--summary", summary) as live:
        for host in range(2, 102):
            live.receive([protocol2(packets[0])], f"127.0.0.{host}")
        live.receive(map(protocol2, packets))
        code, _, said = live.end(signal.SIGTERM)
    assert code == 0, said
    told = json.loads(summary.read_text())
    assert packets_by_name(told)["127-0-0-1"]["used"] == len(packets)
    assert out.read_bytes() == by_stdin


def packets_by_name(summary: dict) -> dict[str, dict]:
    return {one["name"]: one["packets"] for one in summary["inputs"]}


@pytest.mark.parametrize("count", [3, 15])
@pytest.mark.parametrize("ahead_s", [-86_400, 59, 2_260_000_000])
def test_a_stranger_of_another_time_costs_no_row(
    ahead_s: int, count: int, packets: list[Packet], by_stdin: bytes, tmp_path: Path
) -> None:
    summary, out = tmp_path / "summary.json", tmp_path / "traj.csv"
    half = len(packets) // 2
    strange = [
        protocol2(packets[half], counter=k, stamp_ns=packets[half].stamp_ns + when_ns)
        for k in range(count)
        if (when_ns := ahead_s * 10**9 + k * FRAME_NS)
    ]
    with Listening("--out", out, "--summary", summary) as live:
        live.receive(map(protocol2, packets[:half]))
        live.receive(strange, "127.0.0.9")
        live.receive(map(protocol2, packets[half:]))
        code, _, said = live.end(signal.SIGTERM)
    assert code == 0, said
    assert out.read_bytes() == by_stdin
    counts = json.loads(summary.read_text())["counts"]
    assert counts["late_frames"] == 0
    assert counts["astray_frames"] == count
    assert f"{count} frames astray and left out" in said


@pytest.mark.parametrize("ahead_s", [-0.2, 0.03, 0.5, 0.95])
def test_packets_in_a_lidars_own_name_end_none_of_its_frames(
    ahead_s: float, packets: list[Packet], by_stdin: bytes, tmp_path: Path
) -> None:
    """Some in a row, every 0.4 s, of a time that may well be its own."""
    sent = []
    for k, packet in enumerate(packets):
        sent.append(protocol2(packet))
        if k % 83 == 40 and k < len(packets) - 250:  # a frame behind the end would be one more
            empty = np.zeros_like(packet.units)
            for i in range(1 + k % 8):
                when_ns = packet.stamp_ns + round(ahead_s * 1e9) + i
                forged = Packet(40_000 + i, when_ns, empty, packet.unit_m)
                sent.append(protocol2(forged))
    rows, summary, said = rows_by_packets(sent, tmp_path)
    assert rows == by_stdin, said
    forged = len(sent) - len(packets)
    assert packets_of(summary)["late"] <= forged
    assert packets_of(summary)["used"] >= len(packets)


def test_a_few_packets_without_a_lidar_are_no_time(packets: list[Packet], tmp_path: Path) -> None:
    events = tmp_path / "events.jsonl"
    strange = [protocol2(packets[0], counter=k, stamp_ns=39 * 10**17 + k * 10**8) for k in range(4)]
    with Listening("--out", tmp_path / "traj.csv", "--events", events) as live:
        live.receive(strange)
        code, _, said = live.end(signal.SIGTERM)
    assert code == 0, said
    assert all(event["at"] == 0 for event in events_of(events))


# --- a network ----------------------------------------------------------------------------------


def test_what_comes_twice_out_of_order_or_broken_changes_nothing(
    packets: list[Packet], by_stdin: bytes, tmp_path: Path
) -> None:
    chance = random.Random(1)
    good = [protocol2(p) for p in packets]
    order = sorted(range(len(good)), key=lambda k: k + chance.choice([0, 0, 0, 1.5]))
    sent, twice, broken = [], 0, 0
    for k in order:
        sent.append(good[k])
        if chance.random() < 0.1:
            sent.append(good[k])
            twice += 1
        if chance.random() < 0.1:
            bad = bytearray(good[k])
            bad[chance.randrange(24, len(bad))] ^= 1 << chance.randrange(8)
            sent.append(bytes(bad))
            broken += 1
        sent.append(accelerations2(k))
    for junk in (b"", b"\0", b"\xaa" + bytes(40), bytes(2000), b"x" * 9000, good[0][:-1]):
        sent.insert(chance.randrange(len(sent)), junk)
        broken += 1
    rows, summary, said = rows_by_packets(sent, tmp_path)
    assert rows == by_stdin
    counts = packets_of(summary)
    assert counts["used"] == len(good)
    assert counts["repeated"] == twice > 10
    assert counts["reordered"] > 10
    assert counts["lost"] == counts["late"] == counts["astray"] == 0
    assert summary["counts"]["refused_packets"] == broken > 10
    assert f"{broken} packets refused" in said
    assert "1 packet refused, the last: one from 127.0.0.1 " in said


@pytest.mark.parametrize("protocol", [protocol2, protocol1])
def test_what_is_lost_is_counted_and_said(protocol, packets: list[Packet], tmp_path: Path) -> None:
    lost = {5, *range(300, 320), 777}
    kept = [p for p in packets if p.number not in lost]
    rows, summary, said = rows_by_packets(map(protocol, kept), tmp_path)
    expected = tmp_path / "expected"
    expected.mkdir()
    assert rows == rows_by_stdin(kept, expected)
    assert packets_of(summary)["lost"] == len(lost)
    assert packets_of(summary)["used"] == len(kept)
    assert f"127-0-0-1: {len(kept)} packets used, {len(lost)} lost" in said
    assert "127-0-0-1: 1 packet lost, " in said


def test_a_packet_of_another_time_changes_nothing(
    packets: list[Packet], by_stdin: bytes, tmp_path: Path
) -> None:
    sent = []
    for k, packet in enumerate(packets):
        sent.append(protocol1(packet))
        if k % 100 == 50:
            far_ns = packet.stamp_ns + (k - 600) * 10**10
            sent.append(protocol1(Packet(0, far_ns, packet.units, packet.unit_m)))
    rows, summary, _ = rows_by_packets(sent, tmp_path)
    assert rows == by_stdin
    assert packets_of(summary)["astray"] == len(sent) - len(packets)


def test_noise_by_its_tag_is_left_out(packets: list[Packet], tmp_path: Path) -> None:
    """Points high above, which would be returns."""
    sent = []
    for packet in packets:
        units, tags = packet.units.copy(), [0] * len(packet.units)
        free = np.flatnonzero((units == 0).all(axis=1))[:3]
        units[free] = [3000, 3000, 9000]
        for ray, tag in zip(free, (0x02, 0x08, 0x0A), strict=True):
            tags[ray] = tag
        noisy = Packet(packet.number, packet.stamp_ns, units, packet.unit_m)
        sent.append(protocol2(noisy, CARTESIAN_MM, tags=tags))
    _, summary, _ = rows_by_packets(sent, tmp_path)
    assert packets_of(summary)["noise_points"] == 3 * len(packets)
    returns = sum(int((p.units != 0).any(axis=1).sum()) for p in packets)
    assert summary["counts"]["returns"] == returns


def test_a_sensor_without_synchronisation_has_the_time_of_this_computer(
    packets: list[Packet], tmp_path: Path, by_stdin: bytes
) -> None:
    sent = [protocol2(p, time_type=0, stamp_ns=p.stamp_ns - BEGIN_NS + 10**9) for p in packets]
    before = time.time()
    rows, summary, _ = rows_by_packets(sent, tmp_path)
    stamps = [float(row.split(",")[0]) for row in rows.decode().splitlines()[1:]]
    assert len(stamps) > 20
    assert before - 1 < stamps[0] < time.time() + len(packets)
    assert packets_of(summary)["used"] == len(packets)


# --- a program that runs on -----------------------------------------------------------------------


def test_rows_and_events_come_while_packets_come(tmp_path: Path) -> None:
    packets = sweep(make_flight(frames=100))
    out, events = tmp_path / "traj.csv", tmp_path / "events.jsonl"
    with Listening("--out", out, "--events", events) as live:
        live.receive(map(protocol2, packets[:1800]))
        wait_until(lambda: len(rows_of(out)) > 10, "rows are there")
        before = rows_of(out)
        out.rename(tmp_path / "old.csv")
        live.signal(signal.SIGHUP)
        wait_until(out.exists, "a new file is there")
        live.receive(map(protocol2, packets[1800:]))
        code, _, said = live.end(signal.SIGINT)
    assert code == 0, said
    assert rows_of(tmp_path / "old.csv")[: len(before)] == before
    told = events_of(events)
    assert [e["state"] for e in told if e["event"] == "sensor"] == ["ok"]
    rows = [e for e in told if e["event"] == "row"]
    assert len(rows) == len(rows_of(tmp_path / "old.csv")) + len(rows_of(out))


def test_a_sensor_that_falls_silent_is_reported(packets: list[Packet], tmp_path: Path) -> None:
    events = tmp_path / "events.jsonl"
    silent = ("--set", "live.silent_s=0.5")
    with Listening("--out", tmp_path / "traj.csv", "--events", events, *silent) as live:
        live.receive(map(protocol2, packets[:300]))
        wait_until(lambda: '"silent"' in events.read_text(), "it is silent")
        live.receive(map(protocol2, packets[300:600]))
        code, _, said = live.end(signal.SIGTERM)
    assert code == 0, said
    states = [e["state"] for e in events_of(events) if e["event"] == "sensor"]
    assert states[:3] == ["ok", "silent", "ok"]


def test_nothing_at_all_is_no_error(tmp_path: Path) -> None:
    with Listening("--out", tmp_path / "traj.csv") as live:
        code, _, said = live.end(signal.SIGTERM)
    assert code == 0, said
    assert rows_of(tmp_path / "traj.csv") == []


def test_packets_are_taken_some_at_a_time(tmp_path: Path, packets: list[Packet]) -> None:
    """To be woken for each of thousands a second costs more than to read them."""

    def times_woken(process: int) -> int:
        threads = Path(f"/proc/{process}/task").glob("*/status")
        found = (
            re.search(r"^voluntary_ctxt_switches:\s+(\d+)", t.read_text(), re.M) for t in threads
        )
        return sum(int(one[1]) for one in found)

    count = 2_000
    with (
        Listening("--out", tmp_path / "t.csv") as live,
        socket.socket(type=socket.SOCK_DGRAM) as to,
    ):
        before = times_woken(live.process.pid)
        for _ in range(count):  # as many a second as three LiDARs send
            until = time.perf_counter() + 0.00015
            to.sendto(b"no packet", ("127.0.0.1", live.port))
            while time.perf_counter() < until:
                pass
        woken = times_woken(live.process.pid) - before
        code, _, said = live.end(signal.SIGTERM)
    assert code == 0, said
    assert woken < count / 2


def test_a_flood_of_garbage_is_survived(tmp_path: Path, packets: list[Packet]) -> None:
    chance = random.Random(2)
    good = [protocol2(p) for p in packets[:60]]
    sent = []
    for _ in range(3000):
        data = bytearray(chance.choice(good))
        for _ in range(chance.randrange(1, 4)):
            data[chance.randrange(24)] = chance.randrange(256)
        sent.append(bytes(data[: chance.choice([len(data), chance.randrange(len(data))])]))
    rows, summary, said = rows_by_packets(sent, tmp_path)
    assert summary["counts"]["refused_packets"] > 1000
    assert len(said.splitlines()) < 60
    assert all(len(line) < 300 for line in said.splitlines())
    assert rows.startswith(b"timestamp,")


# --- what is wrong ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "where", ["56301", "localhost:56301", "1.2.3.4:", "1.2.3.4:99999", "::1:5"]
)
def test_no_address_is_a_usage_error(where: str, tmp_path: Path) -> None:
    done = run_program("--livox", where, "--out", tmp_path / "traj.csv")
    assert done.returncode == 2
    assert f"--livox {where}: expected an IPv4 address of this computer and a port" in done.stderr


def test_it_stands_alone(tmp_path: Path) -> None:
    here = ("--livox", "127.0.0.1:0", "--out", tmp_path / "traj.csv")
    for more in (["--stdin"], ["--follow", "--frames", tmp_path], ["--frames", tmp_path]):
        assert run_program(*here, *more).returncode == 2


def test_a_port_that_is_taken_and_a_foreign_address_are_input_errors(tmp_path: Path) -> None:
    out = tmp_path / "traj.csv"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        port = other.getsockname()[1]
        done = run_program("--livox", f"127.0.0.1:{port}", "--out", out)
        assert done.returncode == 4
        assert f"127.0.0.1:{port}: cannot be listened on: Address already in use" in done.stderr
    done = run_program("--livox", "203.0.113.1:0", "--out", out)
    assert done.returncode == 4
    assert "203.0.113.1:0: cannot be listened on: Cannot assign requested address" in done.stderr


def test_the_fake_is_what_the_document_says() -> None:
    """Offsets of the vendor's tables: an error in the fake must not hide one in the program."""
    packet = Packet(7, BEGIN_NS, np.array([[1, -2, 3]] * 96), 1e-3)
    data = protocol2(packet)
    assert len(data) == 1380 == struct.unpack_from("<H", data, 1)[0]
    assert struct.unpack_from("<HHH", data, 3) == (47500, 96, 7)
    assert (data[0], data[9], data[10], data[11]) == (0, 0, 1, 1)
    assert struct.unpack_from("<Q", data, 28)[0] == BEGIN_NS
    assert struct.unpack_from("<iii", data, 36) == (1, -2, 3)
    first = protocol1(packet)
    assert len(first) == 1362
    assert (first[0], first[8], first[9]) == (5, 1, 2)
    assert struct.unpack_from("<Q", first, 10)[0] == BEGIN_NS
    assert FRAME_NS * 60 // (96 * 50_000) == 1250
