"""Each folder of the C++ sources is a layer, and no include runs back up; nor does an import."""

from __future__ import annotations

import re

from synthetic import PROJECT

# From the lowest up: a file includes headers of its own folder and of those above it in this list.
LAYERS = (
    "unlidar",  # the public API: what goes in, what comes out, what can be set
    "base",  # data and helpers that all stages share
    "io",  # frames: files, folders, messages, stamps
    "trajectory",  # the spline through a target's measurements, and its rows
    "paper",  # the paper's score
    "scene",  # what stands where, what holds it up, and the plots that it does not explain
    "tracking",  # the paths of plots that a flying target explains
    "collection",  # all returns of a target, once its path is known
    "recording",  # frames that are all there: targets by either method, tracks
    "live",  # frames that come one by one
    "config",  # defaults, YAML, constraints
    "api",  # what the public headers declare, by the layers above
    "pcl",  # an engine of PCL's, which the library does without
    "app",  # the command line and its files
    "python",  # the API for Python
)
# Of tools/unlidar/events: a module imports those above it in this list.
EVENTS = (
    "clock",  # which stamps are believed
    "event",  # what may come in, and how it leaves
    "fair",  # a queue of several senders
    "lines",  # lines wherever they come from
    "bygone",  # what a file held before the start
    "site",  # where a station stands, its zones
    "tls",
    "mqtt",
    "broker",
    "source",  # a file, stdin, a server, a broker
    "neighbours",
    "estimates",
    "fusion",  # tracks that are one drone
    "alarms",
    "station",  # one station
    "many",  # several, as one sky
)
IMPORT = re.compile(r"^ *from unlidar\.events\.(\w+) import", re.MULTILINE)
INCLUDE = re.compile(r'^#include "([^"]+)"', re.MULTILINE)
ROOTS = (PROJECT / "include", PROJECT / "src")


def test_no_include_runs_back_up() -> None:
    wrong = []
    count = 0
    for root in ROOTS:
        for path in sorted(root.rglob("*.[ch]pp")):
            layer = path.parent.relative_to(root).as_posix()
            if layer.split("/")[0] in ("tests", "bench", "fuzz"):
                continue
            for include in INCLUDE.findall(path.read_text()):
                count += 1
                below = include.rpartition("/")[0]
                if LAYERS.index(below) > LAYERS.index(layer):
                    wrong.append(f"{layer}/{path.name} includes {include}")
    assert wrong == []
    assert count > 200


def test_streams_and_recordings_share_the_layers_below_and_nothing_of_each_other() -> None:
    siblings = {"live": ("recording", "paper"), "recording": ("live",)}
    for layer, others in siblings.items():
        for path in (PROJECT / "src" / layer).glob("*.[ch]pp"):
            below = {include.rpartition("/")[0] for include in INCLUDE.findall(path.read_text())}
            assert below.isdisjoint(others), path.name


def test_public_headers_show_the_standard_library_and_eigen_only() -> None:
    for path in (PROJECT / "include").rglob("*.hpp"):
        for include in re.findall(r"^#include <([^>]+)>", path.read_text(), re.MULTILINE):
            assert include == "Eigen/Core" or re.fullmatch(r"[a-z_]+", include), path.name


def test_no_import_of_a_stations_events_runs_back_up() -> None:
    folder = PROJECT / "tools/unlidar/events"
    names = {path.stem for path in folder.glob("*.py")} - {"__init__"}
    assert names == set(EVENTS)
    wrong = [
        f"{name} imports {other}"
        for name in EVENTS
        for other in IMPORT.findall((folder / f"{name}.py").read_text())
        if EVENTS.index(other) >= EVENTS.index(name)
    ]
    assert wrong == []


def test_ceres_is_called_from_one_file_of_the_trajectory_and_from_nowhere_else() -> None:
    callers = {
        path.relative_to(root).as_posix()
        for root in ROOTS
        for path in root.rglob("*.[ch]pp")
        if "#include <ceres/" in path.read_text()
    }
    assert callers == {"trajectory/ceres_minimum.cpp"}
