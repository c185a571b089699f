"""What the page knows, for Prometheus: its text format, version 0.0.4.

The number of series is bounded by the bounds of the sky: 64 stations of 16 LiDARs each.
"""

import os
import resource
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from unlidar import __version__
from unlidar.watch.connections import Connections
from unlidar.watch.pages import Pages
from unlidar.watch.sky import Sky

CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"
_ENGINE_STATES = "warming_up", "running", "overloaded"
_SENSOR_STATES = "ok", "silent", "blinded"
_CLOCKS = "synchronised", "lost", "unsynchronised"
_FRESH_S = 1.0  # scrapes within it share an answer

Labels = tuple[tuple[str, str], ...]
Sample = tuple[Labels, float]


@dataclass
class Taken:
    """Counts of events that came; written by one thread."""

    events: int = 0
    refused: int = 0


class Metrics:
    """Used by the serving thread only."""

    def __init__(self, sky: Sky, pages: Pages, connections: Connections, taken: Taken) -> None:
        self._sky, self._pages, self._connections, self._taken = sky, pages, connections, taken
        self._text, self._made_s = "", -_FRESH_S

    def text(self) -> str:
        """All metrics; at most a second old."""
        now_s = time.monotonic()
        if now_s - self._made_s >= _FRESH_S:
            self._text, self._made_s = "".join((*self._stations(), *self._server())), now_s
        return self._text

    def _stations(self) -> Iterable[str]:
        census = self._sky.census()
        names = sorted(census.heard_s)

        def by_station(values: dict[str, float]) -> list[Sample]:
            return [((("station", name),), value) for name, value in sorted(values.items())]

        yield _family(
            "unlidar_watch_last_event_age_seconds",
            "Time since anything was heard of a station.",
            by_station(census.heard_s),
        )
        for name, text, values in (
            ("tracks", "Tracks that are shown.", census.tracks),
            ("alarms", "Alarms that go on.", census.alarms),
        ):
            counts = {station: float(values.get(station, 0)) for station in {*names, *values}}
            yield _family(f"unlidar_watch_{name}", text, by_station(counts))
        yield _family(
            "unlidar_watch_engine_state",
            "1 for the state that the engine of a station told last.",
            _one_of(_ENGINE_STATES, "state", (
                ((("station", name),), engine.state) for name, engine in census.engines.items()
            )),
        )  # fmt: skip
        for key, text in (("frames", "Frames of an engine."), ("dropped", "Frames left out.")):
            values = {n: float(getattr(engine, key)) for n, engine in census.engines.items()}
            name = "frames" if key == "frames" else "frames_dropped"
            yield _family(f"unlidar_watch_{name}_total", text, by_station(values), "counter")
        sensors = [
            ((("station", station), ("sensor", sensor.name)), sensor)
            for station, sensor in census.sensors
        ]
        yield _family(
            "unlidar_watch_sensor_state",
            "1 for the state that a LiDAR is in.",
            _one_of(_SENSOR_STATES, "state", ((labels, s.state) for labels, s in sensors)),
        )
        yield _family(
            "unlidar_watch_sensor_clock",
            "1 for what the clock of a LiDAR is, of those that tell.",
            _one_of(_CLOCKS, "clock", ((labels, s.clock) for labels, s in sensors if s.clock)),
        )
        yield _family(
            "unlidar_watch_newest_stamp_seconds", "The newest stamp.", [((), census.newest_s)]
        )
        yield _family(
            "unlidar_watch_crowded",
            "1 if something was left out of the page within a minute.",
            [((), float(census.is_crowded))],
        )

    def _server(self) -> Iterable[str]:
        fates = (("taken", self._taken.events), ("refused", self._taken.refused))
        yield _family(
            "unlidar_watch_events_total",
            "Events that came, by fate.",
            [((("fate", fate),), float(count)) for fate, count in fates],
            "counter",
        )
        yield _family("unlidar_watch_pages", "Open pages.", [((), float(self._pages.count))])
        yield _family(
            "unlidar_watch_connections", "Open connections.", [((), float(self._connections.count))]
        )
        used = resource.getrusage(resource.RUSAGE_SELF)
        yield _family(
            "process_cpu_seconds_total",
            "Processor time.",
            [((), used.ru_utime + used.ru_stime)],
            "counter",
        )
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        yield _family(
            "process_resident_memory_bytes",
            "Resident memory.",
            [((), float(pages * os.sysconf("SC_PAGESIZE")))],
        )
        yield _family(
            "unlidar_build_info", "1, with the version.", [((("version", __version__),), 1.0)]
        )


def _one_of(known: Sequence[str], label: str, states: Iterable[tuple[Labels, str]]) -> list[Sample]:
    """A sample for each state that can be; of one that is unknown all are 0."""
    return [
        ((*labels, (label, one)), float(one == state)) for labels, state in states for one in known
    ]


def _family(name: str, text: str, samples: Iterable[Sample], kind: str = "gauge") -> str:
    lines = [f"# HELP {name} {text}", f"# TYPE {name} {kind}"]
    for labels, value in samples:
        inner = ",".join(f'{key}="{_escaped(word)}"' for key, word in labels)
        lines.append(f"{name}{f'{{{inner}}}' if inner else ''} {_number(value)}")
    return "\n".join(lines) + "\n"


def _escaped(word: str) -> str:
    return word.replace("\\", r"\\").replace('"', r"\"").replace("\n", r"\n")


def _number(value: float) -> str:
    return str(int(value)) if value.is_integer() else repr(value)
