"""`unlidar watch` with ten stations by a broker, two of which are broken, for as long as is asked.

UNLIDAR_SOAK_MINUTES=60 for an hour; without it half a minute.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import math
import os
import random
import re
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import paho.mqtt.client as paho
import pytest
import station_events
from live_program import wait_until
from station_events import end, row, sensor, square, state, track, write_site
from test_relay import Broker
from test_watch import Watch, events

SOAK_S = 60 * float(os.environ.get("UNLIDAR_SOAK_MINUTES", 0.6))
HONEST, RATE_HZ, FLIGHT_S = 8, 5, 10.0
JUNK_HZ = 100
SLOW_S = 20.0  # to answer, on a loaded machine; what hangs takes for ever
CENTURY_S = 3.9e9


class Station:
    """Publishes as a relay does, from a thread of its own, until it is stopped."""

    def __init__(self, name: str, port: int) -> None:
        self.name = name
        self._port = port
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> Station:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def connected(self) -> paho.Client:
        client = paho.Client(paho.CallbackAPIVersion.VERSION2)
        client.will_set(f"unlidar/{self.name}/relay", "offline", 1, True)
        client.connect("127.0.0.1", self._port)
        client.loop_start()
        client.publish(f"unlidar/{self.name}/relay", "online", 1, True)
        return client

    def say(self, client: paho.Client, line: str | bytes, kind: str) -> None:
        if isinstance(line, str):
            line = f'{line[:-1]},"station":"{self.name}"}}'
        client.publish(f"unlidar/{self.name}/{kind}", line, 1 if kind != "row" else 0)

    def passed_s(self) -> float:
        return (time.time_ns() - station_events.BEGIN_NS) * 1e-9

    def _run(self) -> None:
        client = self.connected()
        try:
            self.tell(client)
        finally:
            client.disconnect()
            client.loop_stop()

    def tell(self, client: paho.Client) -> None:
        """One drone after another, on a circle of its own."""
        place = 300.0 * (1 + int(self.name.removeprefix("honest")))
        self.say(client, sensor("mid360", "ok", self.passed_s()), "sensor/mid360")
        self.say(client, state("running", self.passed_s()), "state")
        for number in itertools.count():
            begin_s = self.passed_s()
            self.say(client, track(number, begin_s), "track")
            while self.passed_s() - begin_s < FLIGHT_S:
                t = self.passed_s()
                xyz = place + 10 * math.cos(t / 3), 10 * math.sin(t / 3), 20.0
                self.say(client, row(number, t, xyz, drone=0.9), "row")
                if self._stop.wait(1 / RATE_HZ):
                    return
            self.say(client, end(number, self.passed_s()), "end")


class Broken(Station):
    """Floods, junk, lies and stamps of another century; leaves without a word and comes back."""

    def tell(self, client: paho.Client) -> None:
        rng = random.Random(self.name)
        for i in itertools.count():
            now_s = self.passed_s()
            line, kind = rng.choice(
                [
                    lambda i=i, t=now_s: (row(i, t, (float(i % 7), 0.0, 20.0)), "row"),
                    lambda i=i, t=now_s: (track(i, t), "track"),
                    lambda i=i, t=now_s: (row(1, t, (1e5 * (i % 2), 0.0, 20.0)), "row"),
                    lambda i=i, t=now_s: (sensor(f"s{i}", "ok", t), f"sensor/s{i % 9}"),
                    lambda t=now_s: (_ahead(row(2, t)), "row"),
                    lambda t=now_s: (_ahead(state("running", t)), "state"),
                    lambda t=now_s: (state("warming_up", t), "state"),
                    lambda t=now_s: (row(3, t)[:-1] + f',"more":"{"x" * 9000}"}}', "row"),
                    lambda: (rng.randbytes(200), "row"),
                    lambda: (b"[" * 500, "site"),
                    lambda: (b'{"event":"row","track":"\\ud800","x":1e999}', "row"),
                ]
            )()
            self.say(client, line, kind)
            if i % 400 == 399:  # as a machine that loses its network
                client.socket().shutdown(socket.SHUT_RDWR)
            if self._stop.wait(1 / JUNK_HZ):
                return


def _ahead(line: str) -> str:
    values = json.loads(line)
    return json.dumps({k: CENTURY_S if k in ("at", "timestamp") else v for k, v in values.items()})


def memory_mb(watch: Watch) -> float:
    text = Path(f"/proc/{watch.process.pid}/status").read_text()
    return int(re.search(r"VmRSS:\s+(\d+)", text)[1]) / 1024


@contextlib.contextmanager
def deaf_page(watch: Watch) -> Iterator[None]:
    with socket.create_connection(("127.0.0.1", watch.port)) as deaf:
        deaf.sendall(b"GET /live HTTP/1.1\r\nHost: localhost\r\n\r\n")
        yield


@pytest.fixture(autouse=True)
def now() -> Iterator[None]:
    """Stamps of today."""
    before, station_events.BEGIN_NS = station_events.BEGIN_NS, time.time_ns()
    yield
    station_events.BEGIN_NS = before


def test_two_broken_stations_of_ten_cost_no_memory_and_hide_nothing(tmp_path) -> None:
    site = write_site(tmp_path, [square(40, "apron")], station="town")
    with contextlib.ExitStack() as stack:
        broker = stack.enter_context(Broker(tmp_path))
        options = ("--site", site, "--store", tmp_path / "sky.db", "--megabytes", 2)
        watch = stack.enter_context(Watch(f"mqtt://127.0.0.1:{broker.port}", *options))
        got = stack.enter_context(watch.live())
        for i in range(HONEST):
            stack.enter_context(Station(f"honest{i}", broker.port))
        for name in ("flood", "liar"):
            stack.enter_context(Broken(name, broker.port))
        honest = {f"honest{i}" for i in range(HONEST)}
        wait_until(lambda: honest <= _heard(got), "all are heard")
        begin_s, settled_mb = time.monotonic(), 0.0
        while time.monotonic() - begin_s < SOAK_S:
            with deaf_page(watch):
                for path in ("/", "/spans"):
                    asked_s = time.monotonic()
                    assert watch.ask(path)[0] == 200
                    assert time.monotonic() - asked_s < SLOW_S, path
                time.sleep(min(1.0, SOAK_S / 20))
            if not settled_mb and time.monotonic() - begin_s > SOAK_S / 2:
                settled_mb = memory_mb(watch)
            del got[:-2000]
        assert memory_mb(watch) < 1.1 * settled_mb, settled_mb
        # What the honest ones see is shown, now, each where it is.
        del got[:]
        wait_until(
            lambda: _places(events(got)) >= set(range(1, HONEST + 1)), "all drones are shown"
        )
        now_s = [batch["now"] for name, batch in got if name != "begin"][-1]
        assert abs(now_s - time.time()) < SLOW_S
        assert watch.end()[0] == 0


def _heard(got: list[tuple[str, dict]]) -> set[str]:
    """The stations; a page that comes while they say their first words gets those in a snapshot."""
    return {station for name, batch in got if name != "begin" for station in batch["heard"]}


def _places(told: list[dict]) -> set[int]:
    """Which honest station's circle each drone is on."""
    rows = [e for e in told if e["event"] == "row"]
    return {round(e["x"] / 300) for e in rows if abs(e["x"] - 300 * round(e["x"] / 300)) < 12}
