"""Times of captured Livox packets: in order, and the capture's, whatever becomes of the clock."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import unlidar
from livox_sensor import RAYS, Packet, protocol2, sweep
from pcap_files import udp_frame, write_pcap
from synthetic import make_flight
from unlidar import livox
from unlidar.conversion.livox_clock import LivoxClock

FRAME_NS, SPACING_NS, SECOND_NS = 100_000_000, 4_000_000, 10**9
BEGIN_NS = 1_700_000_000 * SECOND_NS
LATEST_NS = 3_000_000  # a packet is captured by as much after it was sent


@dataclass(frozen=True)
class Part:
    """Some seconds of a sensor, after a pause."""

    clock: str  # "ptp", "counts" from power-on, or "lost" the PTP by which it was set
    pause_s: float = 0.0
    is_restarted: bool = False  # it counts from its begin
    stands: bool = False  # its clock did not count the pause
    seconds: float = 5.0


def recorded(*parts: Part, drift_ppm: float = 0.0) -> list[tuple[bool, int, int]]:
    """Whether each packet is synchronised, its stamp, and when it was captured."""
    rng = np.random.default_rng(5)
    now_ns, on_ns, found = BEGIN_NS, BEGIN_NS - 77 * SECOND_NS, []
    for part in parts:
        now_ns += round(part.pause_s * SECOND_NS)
        on_ns += round(part.pause_s * SECOND_NS) if part.stands else 0
        on_ns = now_ns - SPACING_NS if part.is_restarted else on_ns
        for _ in range(round(part.seconds * SECOND_NS / SPACING_NS)):
            stamp_ns = now_ns
            if part.clock == "counts":
                stamp_ns = round((now_ns - on_ns) * (1 + drift_ppm * 1e-6))
            captured_ns = now_ns + int(rng.integers(500_000, LATEST_NS))
            found.append((part.clock == "ptp", stamp_ns, captured_ns))
            now_ns += SPACING_NS
    return found


def times_of(packets: list[tuple[bool, int, int]]) -> list[int | None]:
    clock, rows = LivoxClock(FRAME_NS), np.zeros(1)
    return [
        clock.time_ns(livox.Packet(rows, 0, "", None, synchronised, stamp_ns, None), captured_ns)
        for synchronised, stamp_ns, captured_ns in packets
    ]


FATES = {
    "counts from power-on": (Part("counts"),),
    "loses and finds its master": (Part("ptp"), Part("counts"), Part("ptp")),
    "goes on by itself, and finds its master": (Part("ptp"), Part("lost"), Part("ptp")),
    "is late to find its master": (Part("counts"), Part("ptp")),
    "finds and loses its master": (Part("counts"), Part("ptp"), Part("lost"), Part("ptp")),
    "counts, is set and counts": (Part("counts"), Part("ptp", seconds=60), Part("counts")),
    "comes and goes": tuple(Part(c, seconds=0.1) for c in ("ptp", "lost", "ptp", "counts") * 8),
    "paused": (Part("counts"), Part("counts", pause_s=1.5)),
    "paused for an hour": (Part("counts"), Part("counts", pause_s=3600)),
    "whose clock stood in a pause": (Part("counts"), Part("counts", pause_s=30, stands=True)),
    "restarted": (Part("counts"), Part("counts", is_restarted=True)),
    "restarted after a pause": (Part("counts"), Part("counts", pause_s=20, is_restarted=True)),
    "synchronised, paused": (Part("ptp"), Part("ptp", pause_s=30), Part("lost")),
    "lost while it paused": (Part("ptp"), Part("lost", pause_s=30), Part("ptp")),
}


@pytest.mark.parametrize("fate", FATES)
@pytest.mark.parametrize("drift_ppm", [-150, 0, 150])
def test_times_are_in_order_and_those_of_the_capture(fate: str, drift_ppm: float) -> None:
    packets = recorded(*FATES[fate], drift_ppm=drift_ppm)
    times_ns = times_of(packets)
    for (synchronised, stamp_ns, captured_ns), time_ns in zip(packets, times_ns, strict=True):
        assert abs(time_ns - captured_ns) < FRAME_NS // 10
        assert not synchronised or time_ns == stamp_ns
    # One whose synchronisation is found is as much ahead as its packets were late.
    for (one, _, _), (other, _, _), before_ns, time_ns in zip(
        packets, packets[1:], times_ns, times_ns[1:], strict=False
    ):
        assert time_ns > before_ns - (LATEST_NS if other and not one else 0)


def test_a_time_that_is_not_the_captures_goes_on_where_the_master_is_lost() -> None:
    """A master may count TAI, 37 s ahead: frames go on from there, and none comes twice."""
    ahead_ns = 37 * SECOND_NS
    for clock in ("lost", "counts"):
        packets = [
            (
                synchronised,
                stamp_ns + (0 if clock == "counts" and not synchronised else ahead_ns),
                c,
            )
            for synchronised, stamp_ns, c in recorded(Part("ptp"), Part(clock))
        ]
        times_ns = times_of(packets)
        assert all(0 <= b - a < 2 * SPACING_NS for a, b in pairwise(times_ns))


AHEAD_NS = 10 * 365 * 86_400 * SECOND_NS  # ten years


@pytest.mark.parametrize("clock", ["counts", "ptp"])
@pytest.mark.parametrize("at", [0, 300])
def test_one_stamp_far_off_moves_no_other(clock: str, at: int) -> None:
    packets = recorded(Part(clock))
    expected = times_of(packets)
    _, stamp_ns, captured_ns = packets[at]
    for is_synchronised in (False, True):
        for off_ns in (-3 * SECOND_NS, AHEAD_NS, 10**15, 3 * 10**18):
            bad = (is_synchronised, max(stamp_ns + off_ns, 0), captured_ns)
            found = times_of([*packets[:at], bad, *packets[at + 1 :]])
            pairs = [
                (one, other)
                for k, (one, other) in enumerate(zip(found, expected, strict=True))
                # The first is believed, and those after it are astray until 21 agree.
                if k != at and not (at == 0 and is_synchronised and clock == "ptp" and k <= 20)
            ]
            assert None not in [one for one, _ in pairs]
            assert max(abs(one - other) for one, other in pairs) < LATEST_NS


def test_a_master_that_was_wrong_at_first_is_forgotten() -> None:
    """The right one is believed when 21 packets agree, and is what a loss goes on from."""
    packets = recorded(Part("ptp"), Part("counts"))
    wrong = [(True, stamp_ns + AHEAD_NS, captured) for _, stamp_ns, captured in packets[:40]]
    found = times_of(wrong + packets[40:])
    assert found[:40] == [stamp_ns for _, stamp_ns, _ in wrong]
    assert found[40:60] == [None] * 20
    for time_ns, (_, _, captured_ns) in zip(found[60:], packets[60:], strict=True):
        assert abs(time_ns - captured_ns) < FRAME_NS // 10


def test_the_capture_may_be_years_behind_and_set_meanwhile() -> None:
    packets = recorded(Part("ptp"), Part("counts"))
    late = [(s, stamp_ns, captured_ns - AHEAD_NS) for s, stamp_ns, captured_ns in packets]
    found = times_of(late)
    assert all(0 <= b - a < 2 * SPACING_NS for a, b in pairwise(found))
    packets = recorded(Part("ptp"), Part("ptp", pause_s=30))
    late = [(s, stamp_ns, captured - AHEAD_NS) for s, stamp_ns, captured in packets[:300]]
    assert times_of(late + packets[300:]) == [stamp_ns for _, stamp_ns, _ in packets]


def test_without_a_capture_stamps_are_the_time() -> None:
    """Of files of Livox Viewer."""
    packets = [(s, stamp_ns, None) for s, stamp_ns, _ in recorded(Part("counts", seconds=60))]
    assert times_of(packets) == [stamp_ns for _, stamp_ns, _ in packets]
    packets[300] = (False, packets[300][1] + AHEAD_NS, None)
    found = times_of(packets)
    assert found.pop(300) is None
    assert found == [stamp_ns for k, (_, stamp_ns, _) in enumerate(packets) if k != 300]


@pytest.mark.parametrize("at", [0, 300])
def test_a_packet_astray_costs_no_frame(at: int, tmp_path: Path, caplog) -> None:
    packets: list[Packet] = sweep(make_flight())[:600]
    frames = []
    for k, packet in enumerate(packets):
        stamp = {"time_type": 0, "stamp_ns": packet.stamp_ns - packets[0].stamp_ns + 9}
        if k == at:
            stamp = {"stamp_ns": packet.stamp_ns + AHEAD_NS}
        full = replace(packet, units=np.full((RAYS, 3), 1000))
        payload = protocol2(full, counter=k, **stamp)
        frames.append((packet.stamp_ns + 1_000_000, udp_frame(payload, "10.0.0.9")))
    found = list(unlidar.read(write_pcap(tmp_path / "a.pcap", frames)))
    right = [f for f in found if f.stamp_ns < BEGIN_NS + AHEAD_NS // 2]
    assert sum(len(frame.xyz) for frame in right) == (len(packets) - 1) * RAYS
    assert len(found) - len(right) == (at == 0)  # nothing tells that the first is wrong
    assert ("left out 1 packets more than a second from those before" in caplog.text) == (at > 0)


def test_all_frames_of_a_lidar_that_loses_its_master_and_finds_it_arrive(
    tmp_path: Path, caplog
) -> None:
    packets: list[Packet] = sweep(make_flight())
    lost = range(len(packets) // 3, 2 * len(packets) // 3)
    frames = []
    for k, packet in enumerate(packets):
        full = replace(packet, units=np.full((RAYS, 3), 1000))
        is_lost = {"time_type": 0, "stamp_ns": packet.stamp_ns - packets[0].stamp_ns + 9}
        payload = protocol2(full, counter=k % 2**16, **(is_lost if k in lost else {}))
        frames.append((packet.stamp_ns + 1_000_000, udp_frame(payload, "10.0.0.9")))
    found = list(unlidar.read(write_pcap(tmp_path / "a.pcap", frames)))
    stamps_ns = [frame.stamp_ns for frame in found]
    assert {b - a for a, b in pairwise(stamps_ns)} == {FRAME_NS}
    assert sum(len(frame.xyz) for frame in found) == len(packets) * RAYS
    assert "left out" not in caplog.text
