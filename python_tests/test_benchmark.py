"""The benchmark runs what it is asked to; its numbers are those of evaluate, failures included."""

import json
from pathlib import Path

import numpy as np
import pytest
from ruamel.yaml import YAML
from unlidar import benchmark
from unlidar.benchmark.job import Result
from unlidar.benchmark.report import JSON, MARKDOWN
from unlidar.benchmark.scenes import seeds
from unlidar.benchmark.summary import ALL, MEASURES
from unlidar.cli import main
from unlidar.errors import InputError, UsageError
from unlidar.evaluation import evaluate_files
from unlidar.program import VARIABLE, check_options
from unlidar.simulate import load_scenario, simulate

TINY = """duration_s: 2
sensors: {mid360: {model: mid360}}
scene: {trees: 3, random_buildings: 1}
drones: [{flight: {box_m: [[6, -8, 3], [12, 8, 7]], max_speed_mps: 4}}]
"""
EMPTY = "duration_s: 1\nsensors: {mid360: {model: mid360}}\n"
ROBUST = benchmark.methods("robust")[0]


def result(scene: str, seed: int, variant: str, within: float | None, **more) -> Result:
    measures = {"tracks": 1, "false": 0.0}
    if within is not None:
        measures |= {"within1m": within, "coverage": within, "rmse": 0.1 * within}
    return Result(scene, str(seed), variant, measures | more, None, 1.0, 10.0)


def row(rows: list, scene: str, variant: str = "robust"):
    return next(r for r in rows if (r.scene, r.variant) == (scene, variant))


@pytest.fixture
def tiny(tmp_path) -> Path:
    path = tmp_path / "tiny.yaml"
    path.write_text(TINY)
    return path


@pytest.fixture
def real_program(program, monkeypatch) -> None:
    monkeypatch.setenv(VARIABLE, str(program))


def test_seeds_are_numbers_and_ranges():
    assert seeds("1-3,7,2") == ["1", "2", "3", "7"]
    for wrong in ("", "a", "3-1", "1-", "-2", "1,,2"):
        with pytest.raises(UsageError):
            seeds(wrong)


def test_scenes_are_found_with_and_without_seeds_and_by_name(tmp_path, tiny):
    scenario = load_scenario(str(tiny))
    for where in ("10/near", "2/near", "2/far", "alone"):
        simulate(scenario, tmp_path / "scenes" / where, 1)
    (tmp_path / "scenes/2/notes").mkdir()
    found = benchmark.find_scenes(tmp_path / "scenes", [], None)
    assert [(s.scene, s.seed) for s in found] == [
        ("alone", ""),
        ("far", "2"),
        ("near", "2"),
        ("near", "10"),
    ]
    chosen = benchmark.find_scenes(tmp_path / "scenes", ["near"], ["10"])
    assert [(s.scene, s.seed) for s in chosen] == [("near", "10")]
    with pytest.raises(UsageError, match="no scene 'mid', it holds alone, far, near"):
        benchmark.find_scenes(tmp_path / "scenes", ["mid"], None)
    with pytest.raises(InputError, match="no scenes"):
        benchmark.find_scenes(tmp_path / "scenes/2/notes", [], None)


def test_a_variant_is_its_base_with_keys_changed_and_lists_keep_their_commas():
    changed = benchmark.variant("v=a.b=[1, 2],c.d=3", ROBUST)
    assert changed.assignments == ("a.b=[1, 2]", "c.d=3")
    assert changed.base == "robust"
    assert changed.options == ["--set", "a.b=[1, 2]", "--set", "c.d=3"]
    for wrong in ("v", "v=", "=a=1", "v=a"):
        with pytest.raises(UsageError):
            benchmark.variant(wrong, ROBUST)
    with pytest.raises(UsageError, match=r"expected a \.yaml file or one of robust, paper"):
        benchmark.methods("robust,unknown")
    with pytest.raises(UsageError, match="different"):
        benchmark.methods("robust,robust")


def test_the_program_takes_every_configuration_that_comes_along(real_program):
    for known in (*benchmark.methods("robust,paper,paper_best"), *benchmark.ablation(ROBUST)):
        check_options(known.options)


def test_means_are_over_seeds_and_over_all_scenes_alike_however_many_seeds_they_have():
    results = [result("a", seed, "robust", 1.0) for seed in range(9)]
    results += [result("b", seed, "robust", within) for seed, within in enumerate((0.2, 0.4))]
    rows = benchmark.summarise(results, [ROBUST])
    assert row(rows, "b").estimates["within1m"].mean == pytest.approx(0.3)
    assert row(rows, ALL).estimates["within1m"].mean == pytest.approx(0.65)
    assert row(rows, "b").share_of_duration == pytest.approx(0.1)


def test_bootstrap_intervals_cover_the_true_mean_as_often_as_they_say_and_are_repeatable():
    rng = np.random.default_rng(0)
    covered = 0
    for _ in range(150):
        values = rng.uniform(0, 1, 25)
        rows = benchmark.summarise(
            [result("a", seed, "robust", v) for seed, v in enumerate(values)], [ROBUST]
        )
        estimate = rows[0].estimates["within1m"]
        assert values.min() <= estimate.low <= estimate.mean <= estimate.high <= values.max()
        covered += estimate.low <= 0.5 <= estimate.high
    assert 0.87 <= covered / 150 <= 0.99
    again = [result("a", seed, "robust", v) for seed, v in enumerate(values)]
    assert benchmark.summarise(again, [ROBUST])[0].estimates["within1m"] == estimate


def test_a_drone_that_is_never_in_view_counts_neither_as_covered_nor_as_missed():
    results = [
        result("a", 1, "robust", 0.8),
        result("a", 2, "robust", None, coverage=0.0, within1m=None),
    ]
    found = benchmark.summarise(results, [ROBUST])[0].estimates
    assert found["within1m"].mean == found["coverage"].mean == pytest.approx(0.8)


def test_differences_are_taken_seed_by_seed():
    changed = benchmark.variant("less=a.b=1", ROBUST)
    results = []
    for seed, within in enumerate((0.2, 0.5, 0.9)):
        results.append(result("a", seed, "robust", within))
        results.append(result("a", seed, "less", within - 0.1))
    rows = benchmark.summarise(results, [ROBUST, changed])
    difference = row(rows, "a", "less").differences["within1m"]
    for value in (difference.mean, difference.low, difference.high):
        assert value == pytest.approx(-0.1)
    assert row(rows, "a").differences == {}


def test_tracks_in_an_empty_sky_are_counted_and_do_not_dilute_the_false_rows():
    results = [result("a", 1, "robust", 1.0, false=0.04)]
    results += [
        result("none", seed, "robust", None, tracks=tracks, false=float(tracks > 0))
        for seed, tracks in enumerate((0, 2, 0))
    ]
    everything = row(benchmark.summarise(results, [ROBUST]), ALL)
    assert everything.tracks_in_empty_sky == (1, 3)
    assert everything.estimates["false"].mean == pytest.approx(0.04)


def test_the_command_runs_scenes_seeds_and_methods_and_a_failed_run_stops_nothing(
    tiny, tmp_path, real_program, capsys
):
    out = tmp_path / "out"
    (tmp_path / "none.yaml").write_text(EMPTY)
    call = ["benchmark", str(tiny), str(tmp_path / "none.yaml"), "--seeds", "1-2", "--jobs", "2"]
    call += ["--methods", "robust,paper", "--variant", "bad=robust.nothing=1", "--out", str(out)]
    assert main(call) == 0
    assert (out / MARKDOWN).read_text() in capsys.readouterr().out
    document = json.loads((out / JSON).read_text())
    assert [(r["scene"], r["seed"], r["variant"]) for r in document["results"]] == [
        (scene, seed, method)
        for scene in ("tiny", "none")
        for seed in ("1", "2")
        for method in ("robust", "paper", "bad")
    ]
    for one in document["results"]:
        if one["variant"] == "bad":
            assert "robust.nothing" in one["failure"]
            assert one["measures"]["tracks"] == 0
            assert one["measures"].get("within1m", 0.0) == 0.0
        else:
            assert one["failure"] is None
            assert one["cpu_s"] > 0
            assert one["duration_s"] == pytest.approx(1.9 if one["scene"] == "tiny" else 0.9)
    simulate(load_scenario(str(tiny)), tmp_path / "again", 2)
    measures = evaluate_files(
        tmp_path / "again/ground_truth.csv", out / "runs/tiny/2/robust/traj.csv"
    )
    mine = next(r for r in document["results"] if (r["seed"], r["variant"]) == ("2", "robust"))
    for name in MEASURES:
        assert mine["measures"].get(name) == measures.get(name)
    text = (out / MARKDOWN).read_text()
    assert "tiny (2 of 2 runs failed)" in text
    assert "## Differences to robust" in text
    assert "arXiv 2412.12716" in text


def test_a_folder_of_scenes_gives_what_the_simulation_gives_whatever_the_number_of_jobs(
    tiny, tmp_path, real_program
):
    for seed in (1, 2):
        simulate(load_scenario(str(tiny)), tmp_path / f"scenes/{seed}/tiny", seed)
    common = ["--methods", "robust", "--seeds", "1-2"]
    folder = ["--scenes-dir", str(tmp_path / "scenes"), "tiny", "--jobs", "1"]
    assert main(["benchmark", *folder, *common, "--out", str(tmp_path / "a")]) == 0
    assert main(["benchmark", str(tiny), *common, "--out", str(tmp_path / "b")]) == 0
    a, b = (json.loads((tmp_path / x / JSON).read_text())["results"] for x in "ab")
    assert [r["measures"] for r in a] == [r["measures"] for r in b]


def test_a_program_that_does_not_end_has_failed_after_its_share_of_cpu_time(
    tiny, tmp_path, monkeypatch
):
    endless = tmp_path / "unlidar_track"
    endless.write_text("#!/bin/sh\nwhile :; do :; done\n")
    endless.chmod(0o755)
    monkeypatch.setenv(VARIABLE, str(endless))
    call = ["benchmark", str(tiny), "--seeds", "1", "--methods", "robust", "--time-limit", "1"]
    assert main([*call, "--out", str(tmp_path / "out")]) == 0
    only = json.loads((tmp_path / "out" / JSON).read_text())["results"][0]
    assert only["failure"] == "took more than 1 s of CPU time"
    assert only["measures"]["within1m"] == 0


def test_wrong_options_are_refused_before_anything_runs(tiny, tmp_path, fails, real_program):
    fails(2, "benchmark", tiny, "--jobs", "0")
    fails(2, "benchmark", tiny, "--time-limit", "0")
    fails(2, "benchmark", tiny, "--seeds", "x")
    fails(2, "benchmark", "nowhere")
    fails(2, "benchmark", tiny, "--variant", "robust=a.b=1")
    fails(4, "benchmark", "--scenes-dir", tmp_path / "absent")


def test_every_published_figure_says_what_it_was_measured_on_and_where_it_stands():
    path = Path(benchmark.__file__).parent / "published.yaml"
    for group in YAML(typ="safe", pure=True).load(path.read_text()):
        assert group["title"]
        assert group["measured_on"]
        assert group["measure"]
        assert isinstance(group["verified"], list)
        for figure in group["rows"]:
            assert all(isinstance(figure[key], str) for key in ("name", "value", "source"))
