"""Each folder of the C++ sources is a layer, and no include runs back up."""

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
    "robust/scene",  # what is where, and what holds what up
    "robust/plots",  # what a frame shows that the scene does not explain
    "robust/tracking",  # the paths of plots that a flying target explains
    "robust/collection",  # all returns of a target, once its path is known
    "robust",  # the robust method of these
    "recording",  # frames that are all there: targets by either method, tracks
    "live",  # frames that come one by one
    "api",  # what the public headers declare, by the layers above
    "app",  # the command line and its files
)
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


def test_public_headers_show_the_standard_library_and_eigen_only() -> None:
    for path in (PROJECT / "include").rglob("*.hpp"):
        for include in re.findall(r"^#include <([^>]+)>", path.read_text(), re.MULTILINE):
            assert include == "Eigen/Core" or re.fullmatch(r"[a-z_]+", include), path.name
