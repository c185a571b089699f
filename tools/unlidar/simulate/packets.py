"""The frames of a simulated recording as the packets that Livox LiDARs would have sent.

Their layouts: docs/livox.md. A LiDAR sends all of its rays, those without a return as zeros.
"""

import heapq
import ipaddress
import zlib
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from types import ModuleType

import numpy as np

from unlidar.errors import UsageError
from unlidar.extras import load_extra
from unlidar.output import write_file
from unlidar.progress import with_progress
from unlidar.simulate.recording import SimulatedFrame, Simulation
from unlidar.simulate.scenario import Scenario
from unlidar.simulate.sensors import MODELS, SensorModel

_PROTOCOLS = {"mid360": 2, "avia": 1}
_RAYS = 96  # of a packet
_RAY = np.dtype([("xyz", "<i4", 3), ("reflectivity", "u1"), ("tag", "u1")])
_REFLECTIVITY = 60
_FIRST_ADDRESS = ipaddress.IPv4Address("192.168.1.112")
_HOST = ipaddress.IPv4Address("192.168.1.5")
_FROM_PORT, _TO_PORT = 56300, 56301


def addresses(scenario: Scenario) -> dict[str, str]:
    """The address of each Livox LiDAR by its name. UsageError for a scenario without any."""
    livox = sorted(n for n, sensor in scenario.sensors.items() if sensor.model in _PROTOCOLS)
    if not livox:
        raise UsageError(
            f"packets: no LiDAR of the scenario is one of {', '.join(_PROTOCOLS)}, expected one"
        )
    return {name: str(_FIRST_ADDRESS + number) for number, name in enumerate(livox)}


def write_packets(simulation: Simulation, path: Path) -> None:
    """Writes the packets of all Livox LiDARs to a capture, each from its own address."""
    dpkt = load_extra("dpkt", "packets", f"{path}: captures need the Python package dpkt")
    sensors = addresses(simulation.scenario)
    streams = [_packets(simulation, name, sensors[name]) for name in sensors]
    packets = heapq.merge(*streams, key=lambda packet: packet[0])
    total = sum(
        simulation.frame_count(name) * _rays_per_frame(simulation, name) // _RAYS
        for name in sensors
    )

    def write(work: Path) -> None:
        with work.open("wb") as file:
            writer = dpkt.pcap.Writer(file)
            for sent_ns, address, payload in with_progress(packets, total, "Packing"):
                writer.writepkt(_ethernet(dpkt, address, payload), sent_ns * 1e-9)

    write_file(path, write)


def _rays_per_frame(simulation: Simulation, sensor: str) -> int:
    return MODELS[simulation.scenario.sensors[sensor].model].rays_per_frame


def _packets(simulation: Simulation, sensor: str, address: str) -> Iterator[tuple[int, str, bytes]]:
    """(time, address, payload) of each packet."""
    model = MODELS[simulation.scenario.sensors[sensor].model]
    packet_ns = Fraction(_RAYS * model.frame_ns, model.rays_per_frame)
    protocol = _PROTOCOLS[simulation.scenario.sensors[sensor].model]
    waiting = np.zeros((0, 3))
    begin_ns, number = None, 0
    for frame in simulation.frames(sensor):
        begin_ns = frame.stamp_ns if begin_ns is None else begin_ns
        waiting = np.concatenate([waiting, _all_rays(frame, model)])
        whole = len(waiting) // _RAYS
        for rays_m in waiting[: whole * _RAYS].reshape(whole, _RAYS, 3):
            rows = np.zeros(_RAYS, _RAY)
            rows["xyz"] = np.rint(rays_m * 1e3)
            rows["reflectivity"] = _REFLECTIVITY * rays_m.any(axis=1)
            stamp_ns = begin_ns + int(number * packet_ns)
            body = stamp_ns.to_bytes(8, "little") + rows.tobytes()
            head = _head_of_second(body, number, packet_ns) if protocol == 2 else _HEAD_OF_FIRST
            yield stamp_ns + int(packet_ns), address, head + body
            number += 1
        waiting = waiting[whole * _RAYS :]


def _all_rays(frame: SimulatedFrame, model: SensorModel) -> np.ndarray:
    """(rays, 3) in metres: returns of one shot, which have one time, in the order of its beams."""
    rays_m = np.zeros((model.rays_per_frame, 3))
    order = np.arange(len(frame.time_ns))
    first_of_shot = np.searchsorted(frame.time_ns, frame.time_ns)
    shot = -(-frame.time_ns * model.rays_per_frame // model.frame_ns)  # its first ray
    rays_m[shot + order - first_of_shot] = frame.xyz_m
    return rays_m


# Version 5, slot 1, LiDAR 1, no fault, PTP, Cartesian with tags.
_HEAD_OF_FIRST = bytes([5, 1, 1, 0, 0, 0, 0, 0, 1, 2])


def _head_of_second(body: bytes, number: int, packet_ns: Fraction) -> bytes:
    cartesian_mm, ptp = 1, 1
    span_ns = packet_ns * (_RAYS - 1) / _RAYS  # from the first ray to the last
    lengths = np.array([28 + len(body), int(span_ns / 100), _RAYS, number % 2**16], "<u2")
    head = b"\0" + lengths.tobytes() + bytes([0, cartesian_mm, ptp]) + bytes(12)
    return head + zlib.crc32(body).to_bytes(4, "little")


def _ethernet(dpkt: ModuleType, address: str, payload: bytes) -> bytes:
    udp = dpkt.udp.UDP(sport=_FROM_PORT, dport=_TO_PORT, ulen=8 + len(payload), data=payload)
    ip = dpkt.ip.IP(
        src=ipaddress.IPv4Address(address).packed,
        dst=_HOST.packed,
        p=dpkt.ip.IP_PROTO_UDP,
        ttl=64,
        data=udp,
    )
    ip.len = len(ip)
    return bytes(dpkt.ethernet.Ethernet(data=ip, type=dpkt.ethernet.ETH_TYPE_IP))
