"""The bench: every row is made, medians and ratios are right. No assertion on seconds."""

from __future__ import annotations

import itertools
import json
import math
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from synthetic import PROJECT
from unlidar.errors import InputError, ProgramError
from unlidar_bench import page, paired, processes, tables
from unlidar_bench.__main__ import PARTS, main
from unlidar_bench.setting import QUICK

NEEDS = {
    "clustering": ("clustering_bench",),
    "pcd": ("pcd_bench",),
    "spline": ("trajectory_bench",),
    "whole": ("pcl_pipeline",),
}
TIME = Path("/usr/bin/time")
positive = st.floats(1e-6, 1e6)


@given(st.lists(st.tuples(positive, positive), min_size=1, max_size=30))
def test_a_ratio_is_the_median_of_those_of_the_rounds(rounds: list[tuple[float, float]]) -> None:
    ours, theirs = zip(*rounds, strict=True)
    single = sorted(a / b for a, b in rounds)
    found = paired.ratio(ours, theirs)
    assert single[(len(single) - 1) // 2] <= found * (1 + 1e-12)
    assert found <= single[len(single) // 2] * (1 + 1e-12)
    assert paired.ratio(ours, ours) == 1.0
    # A machine that is slow for a whole round changes nothing.
    slow = [1.0 + i for i in range(len(rounds))]
    slowed = [[a * s for a, s in zip(one, slow, strict=True)] for one in (ours, theirs)]
    assert paired.ratio(*slowed) == pytest.approx(found)


def test_all_take_their_turn_in_each_round_and_each_is_first_as_often() -> None:
    order: list[str] = []
    counter = itertools.count()

    def act(name: str) -> int:
        order.append(name)
        return next(counter)

    found = paired.by_turns(6, {name: lambda name=name: act(name) for name in "abc"})
    rounds = [order[i : i + 3] for i in range(0, 18, 3)]
    assert all(sorted(one) == ["a", "b", "c"] for one in rounds)
    assert sorted(one[0] for one in rounds) == list("aabbcc")
    assert all(list(values) == sorted(values) and len(values) == 6 for values in found.values())
    del order[:]
    paired.by_turns(1, {name: lambda name=name: act(name) for name in "abc"}, first=2)
    assert order == ["c", "a", "b"]


@pytest.mark.skipif(not TIME.is_file(), reason="GNU time is not installed")
def test_cpu_and_memory_are_those_of_the_process_alone() -> None:
    block = bytearray(300_000_000)  # of this process, not of the other one
    spin = "import time\nwhile time.process_time() < 0.2: pass"
    used = processes.run([sys.executable, "-c", spin])
    assert 0.2 <= used.cpu_s <= used.wall_s + 0.1
    assert 1 < used.memory_mb < 100
    del block
    large = processes.run([sys.executable, "-c", "bytearray(200_000_000)"])
    assert large.memory_mb > 190
    with pytest.raises(ProgramError, match="out of paint"):
        processes.run([sys.executable, "-c", "raise SystemExit('out of paint')"])


def test_a_table_goes_between_its_markers_and_the_text_stays() -> None:
    before = "# Speed\nprose\n<!-- table a -->\nold\n<!-- end a -->\nmore\n<!-- table b -->\n"
    before += "kept\n<!-- end b -->\nlast\n"
    after = page.put(before, "a", "new\n")
    assert after == before.replace("old\n", "new\n")
    assert page.put(after, "a", "new\n") == after
    with pytest.raises(InputError, match="table c"):
        page.put(before, "c", "new\n")


def test_a_missing_value_is_a_dash() -> None:
    columns = (tables.Column("who", "who"), tables.Column("m", "m", tables.metres))
    rows = [{"who": "a", "m": 1.234}, {"who": "b"}, {"who": "c", "m": math.nan}]
    lines = tables.markdown(columns, rows).splitlines()
    assert lines == ["| who | m |", "| --- | ---: |", "| a | 1.23 |", "| b | - |", "| c | - |"]


@pytest.mark.parametrize("part", PARTS)
def test_the_page_has_a_place_for_every_part(part: str) -> None:
    text = (PROJECT / "docs/performance.md").read_text()
    assert page.put(text, part, "x\n").count("x\n") >= 1
    table = re.search(rf"<!-- table {part} -->\n(.*?)<!-- end {part} -->", text, re.DOTALL)
    assert table is not None and table[1].count("\n|") >= 4, "no numbers: run tools/bench.sh"


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("bench")


def rows_of(part: str, work: Path, build: Path) -> list[dict]:
    if not TIME.is_file():
        pytest.skip("GNU time is not installed: tools/bench.sh installs it")
    for name in NEEDS.get(part, ()):
        if not (build / "src/bench" / name).is_file():
            pytest.skip(f"{build}/src/bench/{name} is not built")
    assert main(["--quick", "--build", str(build), "--work", str(work), part]) == 0
    return json.loads((work / "quick" / f"{part}.json").read_text())["rows"]


def check_times(rows: list[dict], cost: str) -> None:
    """Numbers above 0; the reference costs once itself."""
    assert all(row[cost] > 0 for row in rows)
    assert all(row["times"] == 1 for row in rows if row["by"] in ("ours", "unlidar_track"))
    assert all(row["times"] > 0 for row in rows)


@pytest.fixture
def build(program: Path) -> Path:
    return program.resolve().parent


def test_clustering_by_others_gives_the_same_clusters(work: Path, build: Path) -> None:
    rows = rows_of("clustering", work, build)
    check_times(rows, "ms")
    by = {(r["returns"], r["method"], r["by"]): r["clusters"] for r in rows}
    assert len(by) == len(rows) == 10
    for returns, method, _ in by:
        ours = by[returns, method, "ours"]
        assert ours > 1
        assert by[returns, method, "scikit-learn"] == pytest.approx(ours, rel=0.01)
        assert method == "DBSCAN" or by[returns, method, "PCL"] == ours


def test_every_encoding_is_read_by_all(work: Path, build: Path) -> None:
    rows = rows_of("pcd", work, build)
    assert [(r["encoding"], r["by"]) for r in rows] == list(
        itertools.product(("ascii", "binary", "compressed"), ("ours", "PCL", "`cat`"))
    )
    assert all(row["mb_per_s"] > 0 for row in rows)
    assert all(row["times"] == 1 for row in rows if row["by"] == "PCL")


def test_splines_of_the_same_flights_have_times_and_errors(work: Path, build: Path) -> None:
    rows = rows_of("spline", work, build)
    check_times(rows, "ms")
    assert len(rows) == 2 * 4 * len(QUICK["measurements"])
    errors = [row["rmse"] for row in rows if row["by"] != "ours, agility given"]
    assert all(0 < rmse < 1000 for rmse in errors)
    ours = [row["rmse"] for row in rows if row["by"] == "ours"]
    assert max(ours) < 0.5  # m; measurements of 0.1 m


def test_whole_programs_are_timed_and_judged(work: Path, build: Path) -> None:
    rows = rows_of("whole", work, build)
    check_times(rows, "cpu_s")
    assert len(rows) == 4 * len(QUICK["scenes"])
    assert all(row["memory_mb"] > 1 for row in rows)
    assert all(0 <= row["within1m"] <= 1 and 0 <= row["false"] <= 1 for row in rows)


def test_duration_and_live_frames_are_measured(work: Path, build: Path) -> None:
    rows = rows_of("duration", work, build)
    assert [(r["minutes"], r["as"]) for r in rows] == list(
        itertools.product(QUICK["minutes"], ("recording", "live"))
    )
    for row in rows:
        assert row["cpu_s"] == pytest.approx(row["share"] * 60 * row["minutes"])
        assert row["memory_mb"] > 1
    rows = rows_of("live", work, build)
    assert len(rows) == 4
    for row in rows:
        assert 0 < row["p50"] <= row["p99"] <= row["max"]
        assert row["share"] > 0 and row["returns_per_s"] > 1000


def test_flights_are_timed_and_judged_beside_a_detector_of_what_moves(
    work: Path, build: Path
) -> None:
    rows = rows_of("moving", work, build)
    check_times(rows, "us_per_return")
    by = {row["by"] for row in rows}
    assert len(rows) == 4 * len(by) and {"unlidar_track", "unlidar_track, live"} <= by
    for row in rows:
        if not row["by"].endswith("live"):
            assert row["of_drone"] > 0 and 0 <= row["found"] <= 1 and row["false"] >= 0
        assert ("within1m" in row) == row["by"].startswith("unlidar_track")


def test_swarms_are_measured_as_recordings_and_live(work: Path, build: Path) -> None:
    rows = rows_of("swarm", work, build)
    assert [(r["drones"], r["as"]) for r in rows] == 2 * list(
        itertools.product(QUICK["swarms"], ("recording", "live"))
    )
    for row in rows:
        assert row["cpu_s"] > 0 and row["track_frames"] >= 0
        assert row["track_frames_per_s"] == pytest.approx(row["track_frames"] / row["cpu_s"])


def test_a_program_that_is_not_built_is_named(tmp_path: Path) -> None:
    run = subprocess.run(
        [sys.executable, "-m", "unlidar_bench", "--quick", "--build", tmp_path / "none",
         "--work", tmp_path, "pcd"],
        capture_output=True, text=True, env=os.environ,
    )  # fmt: skip
    assert run.returncode == 1
    assert f"{tmp_path}/none/src/bench/pcd_bench: is not built" in run.stderr
