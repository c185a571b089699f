#!/usr/bin/env python3
"""Measures how old events `now` are where they are read, of a recording played in real time.

The age is the time from when the last return of a frame was handed to the program, as a whole
frame or in a packet, to when the event of the frame's stamp was read: from the program's pipe or
file, by a client of the page's server, and from a broker behind a relay, if mosquitto is installed.
"""

import argparse
import http.client
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import IO

import numpy as np
from unlidar import livox
from unlidar.capture import datagrams
from unlidar.frames_io import find_sensors
from unlidar.play import FolderSink, MessageSink, PlayedFrame, Sink, frames_in_order, play
from unlidar.play_packets import play_packets
from unlidar.program import find_program
from unlidar.stamps import parse_seconds_ns

_FRAME_NS = 100_000_000  # live.frame_s
_NOW = re.compile(rb'"event":"now","at":[0-9.]+,"track":[0-9]+,"timestamp":([0-9.]+)')
_LOOK_S = 0.002
_MQTT = ("-h", "127.0.0.1", "-t", "unlidar/#")


class Times:
    """When the last return of each frame was handed in."""

    def __init__(self) -> None:
        self.handed_s: dict[int, float] = {}  # by stamp

    def hand(self, stamp_ns: int) -> None:
        self.handed_s[stamp_ns] = time.monotonic()

    def of(self, stamp_ns: int) -> float | None:
        return self.handed_s.get(stamp_ns)


class PacketTimes(Times):
    """The same for packets: the last before the next frame of their sensor begins."""

    def of(self, stamp_ns: int) -> float | None:
        within = (s for t, s in self.handed_s.items() if 0 <= t - stamp_ns < _FRAME_NS)
        return max(within, default=None)


class Noting:
    """A sink that notes when a frame was taken."""

    def __init__(self, sink: Sink, times: Times) -> None:
        self._sink, self._times = sink, times

    def send(self, frame: PlayedFrame, pcd: bytes) -> None:
        self._sink.send(frame, pcd)
        self._times.hand(frame.stamp_ns)


class Receiver:
    """Lines with the time of their receipt, read by a thread of its own."""

    def __init__(self, name: str, lines: Iterator[bytes], passed: list[IO[bytes]] = ()) -> None:
        self.name, self._lines, self._passed = name, lines, passed
        self.told: list[tuple[int, float]] = []  # stamps of events `now`
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        with suppress(OSError, ValueError, AttributeError, http.client.HTTPException):
            for line in self._lines:
                now_s = time.monotonic()
                for out in self._passed:
                    out.write(line)
                    out.flush()
                self.told += [(parse_seconds_ns(t.decode()), now_s) for t in _NOW.findall(line)]

    def ages_ms(self, times: Times) -> np.ndarray:
        handed = [(times.of(stamp_ns), read_s) for stamp_ns, read_s in self.told]
        return np.array([1e3 * (read - sent) for sent, read in handed if sent is not None])


def tail(path: Path) -> Iterator[bytes]:
    """The lines of a file as it grows, for ever."""
    while not path.exists():
        time.sleep(_LOOK_S)
    with path.open("rb") as file:
        rest = b""
        while True:
            *lines, rest = (rest + file.read()).split(b"\n")
            yield from lines
            time.sleep(_LOOK_S)


def run(*command: object, **options: object) -> subprocess.Popen:
    return subprocess.Popen([str(part) for part in command], **options)


def page_lines(watch: subprocess.Popen) -> Iterator[bytes]:
    """Server-sent events, a batch a line."""
    port = int(re.search(rb":(\d+)/", watch.stdout.readline())[1])
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    connection.request("GET", "/live")
    return iter(connection.getresponse().readline, b"")


def broker_lines(folder: Path, port: int, stack: ExitStack) -> Iterator[bytes]:
    """What a subscriber of a new broker prints."""
    config = folder / "mosquitto.conf"
    config.write_text(f"listener {port} 127.0.0.1\nallow_anonymous true\n")
    program = shutil.which("mosquitto", path="/usr/sbin:/usr/bin:/usr/local/sbin")
    broker = run(program, "-c", config, stderr=subprocess.DEVNULL)
    stack.callback(broker.kill)
    time.sleep(1.0)
    reader = run("mosquitto_sub", *_MQTT, "-p", port, stdout=subprocess.PIPE)
    stack.callback(reader.kill)
    return iter(reader.stdout.readline, b"")


def free_port(kind: int = socket.SOCK_STREAM) -> int:
    with socket.socket(type=kind) as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


def by_frames(arguments: argparse.Namespace, folder: Path) -> tuple[list, Times, Callable]:
    """Options of the program, times of its frames, and what plays them once it runs."""
    times, sensors = Times(), find_sensors(arguments.recording)
    frames = frames_in_order(sensors)
    if arguments.by == "stdin":
        return ["--stdin"], times, lambda p: play(frames, Noting(MessageSink(p.stdin), times), 1.0)
    follow = [part for name in sensors for part in ("--frames", f"{name}={folder / name}")]
    sink = Noting(FolderSink(folder), times)
    return ["--follow", *follow], times, lambda _: play(frames, sink, 1.0)


def by_packets(arguments: argparse.Namespace) -> tuple[list, Times, Callable]:
    """The same for a capture, whose packets are timed as it plays by their time in it."""
    times, port = PacketTimes(), free_port(socket.SOCK_DGRAM)
    known = [
        (datagram.time_ns * 1e-9, livox.parse(datagram.payload).stamp_ns)
        for datagram in datagrams(arguments.recording)
        if livox.holds_points(datagram.payload)
    ]

    def start(_: subprocess.Popen) -> None:
        begin = time.monotonic()
        played = play_packets(arguments.recording, "127.0.0.1", port, 1.0)
        print(f"packets were {1e3 * played.most_behind_s:.0f} ms behind at most")
        times.handed_s |= {stamp: begin + at - known[0][0] for at, stamp in known}

    return ["--livox", f"127.0.0.1:{port}"], times, start


def measure(arguments: argparse.Namespace, folder: Path, stack: ExitStack) -> None:
    is_packets = arguments.by == "livox"
    source, times, start = by_packets(arguments) if is_packets else by_frames(arguments, folder)
    events = folder / "events.jsonl"
    is_pipe = arguments.through == "pipe"
    read = "-" if is_pipe else events
    harness = sys.executable, "-m", "unlidar"
    pipes = {"stdin": subprocess.PIPE if is_pipe else subprocess.DEVNULL}
    watch = run(*harness, "watch", read, "--port", 0, stdout=subprocess.PIPE, **pipes)
    stack.callback(watch.kill)
    receivers = [Receiver("page's server", page_lines(watch))]
    fed = [watch.stdin]
    if shutil.which("mosquitto_sub"):
        port = free_port()
        receivers.append(Receiver("broker", broker_lines(folder, port, stack)))
        relay = run(*harness, "relay", read, "--to", f"mqtt://127.0.0.1:{port}", **pipes)
        stack.callback(relay.kill)
        fed.append(relay.stdin)
    time.sleep(5.0)  # until all have begun
    command = [find_program(), "--quiet", *source, "--out", folder / "traj.csv"]
    command += ["--events", "-" if is_pipe else events, *arguments.options]
    program = run(*command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    stack.callback(program.kill)
    if is_pipe:
        receivers.insert(0, Receiver("pipe", iter(program.stdout.readline, b""), fed))
    else:
        receivers.insert(0, Receiver("file", tail(events)))
    time.sleep(1.0)
    start(program)
    time.sleep(1.0)
    for receiver in receivers:
        ages_ms = receiver.ages_ms(times)
        if len(ages_ms) == 0:
            print(f"{receiver.name:14} no event `now`")
            continue
        p50, p99 = np.percentile(ages_ms, (50, 99))
        print(
            f"{arguments.by:7} {receiver.name:14} {len(ages_ms):5} events, age p50 {p50:6.1f} ms, "
            f"p99 {p99:6.1f} ms, max {ages_ms.max():6.1f} ms",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("recording", type=Path, help="folder with a folder of PCD files a sensor, "
                        "or a capture of packets with --by livox")  # fmt: skip
    parser.add_argument("--by", choices=("stdin", "follow", "livox"), default="stdin")
    parser.add_argument("--through", choices=("pipe", "file"), default="pipe")
    parser.add_argument("options", nargs="*", help="of unlidar_track, after --")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder, ExitStack() as stack:
        measure(arguments, Path(folder), stack)


if __name__ == "__main__":
    main()
