"""Scenes are tracked, judged and compared as asked; weather in their frames is the simulator's."""

from __future__ import annotations

import dataclasses
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from scripts import load_script
from unlidar.errors import InputError
from unlidar.evaluation import Options, compare, measure
from unlidar.frames_io import list_frames, read_pcd, read_returns, write_pcd
from unlidar.simulate import Scenario, simulate
from unlidar.simulate.scenario import Drone, Flight, Scene, Sensor
from unlidar.simulate.sensors import MODELS, in_field_of_view
from unlidar.truth import Tracks, Truth
from unlidar_bench.flights import flight_of, put_weather
from unlidar_bench.results import once_live, read_results, report, report_changes
from unlidar_bench.weather import Air, weather_of

TOOL = Path(__file__).parents[1] / "tools/measure_scenes.py"
COUNT = 400


@pytest.fixture(scope="module")
def tool():
    return load_script(TOOL)


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five seconds of a drone above one LiDAR, with a time for each return; beside it nobody."""
    path = tmp_path_factory.mktemp("scenes") / "visit"
    box = ((-8.0, -8.0, 5.0), (8.0, 8.0, 10.0))
    scenario = Scenario(
        sensors={"mid360": Sensor("mid360", stray_returns=0)},
        drones=(Drone(Flight(box_m=box, max_speed_mps=5.0)),),
        scene=Scene(random_buildings=1, trees=3),
        duration_s=5.0,
        point_times=True,
    )
    simulate(scenario, path, seed=1)
    simulate(dataclasses.replace(scenario, drones=()), path.with_name("nobody"), seed=1)
    return path


def with_weather(scene: Path, text: str, out: Path) -> tuple[list[np.ndarray], list]:
    flight = flight_of(scene)
    sensors, _ = put_weather(flight, weather_of(text), 1, out)
    frames = list_frames(sensors["mid360"])
    assert [f.path.name for f in frames] == [f.path.name for f in list_frames(scene / "mid360")]
    return [read_returns(frame.path) for frame in frames], frames


def test_as_many_returns_as_asked_for_come_within_the_field_of_view(scene, tmp_path) -> None:
    clear, frames = with_weather(scene, "clear", tmp_path / "clear")
    assert frames == list_frames(scene / "mid360")
    assert not (tmp_path / "clear").exists()
    snow, frames = with_weather(scene, f"snow:{COUNT}", tmp_path / "snow")
    strays = []
    for before, after in zip(clear, snow, strict=True):
        known = set(map(tuple, before))
        strays += [row for row in after if tuple(row) not in known]
    # Those that the ground or a wall stops are missing, as they are with the simulator.
    assert 0.7 * COUNT < len(strays) / len(frames) < 1.01 * COUNT
    assert in_field_of_view(MODELS["mid360"], np.array(strays)).mean() > 0.99
    ranges_m = np.linalg.norm(strays, axis=1)
    assert ranges_m.max() < 30.0 + 1e-4
    assert np.median(ranges_m) == pytest.approx(7.0, abs=1.5)  # of a gamma distribution 7.1
    for frame, cloud in zip(frames, snow, strict=True):
        times = read_pcd(frame.path)["t"]
        assert times.dtype == np.uint32
        assert len(times) == len(cloud)
        assert times.max() < 100_000_000
        assert len(np.unique(times)) > len(times) / 20


def test_gusts_are_those_of_all_lidars_and_have_the_mean_of_the_calm() -> None:
    gusty, calm = weather_of("gusty-rain:300"), weather_of("rain:300")
    assert str(gusty) == "gusty rain 300"
    stamps_ns = range(0, 600_000_000_000, 100_000_000)
    strengths = np.array([gusty.strength(stamp_ns, 1) for stamp_ns in stamps_ns])
    assert strengths.mean() == pytest.approx(1.0, abs=0.1)
    assert strengths.min() < 0.3
    assert strengths.max() > 3.0
    assert gusty.strength(0, 2) != strengths[0]
    assert calm.strength(0, 1) == 1.0


def test_dense_fog_hides_what_is_far(scene, tmp_path) -> None:
    clear, _ = with_weather(scene, "clear", tmp_path / "clear")
    fog, _ = with_weather(scene, "fog:1:20", tmp_path / "fog")
    far = [sum((np.linalg.norm(x, axis=1) > 25).sum() for x in each) for each in (clear, fog)]
    near = [sum((np.linalg.norm(x, axis=1) < 6).sum() for x in each) for each in (clear, fog)]
    assert far[1] < 0.1 * far[0]
    assert near[1] > 0.95 * near[0]


def test_strays_of_an_unknown_sensor_lie_where_it_looks(tmp_path) -> None:
    rng = np.random.default_rng(1)
    azimuth, sine = np.radians(rng.uniform(150, 210, 4000)), rng.uniform(-0.2, 0.3, 4000)
    across = np.sqrt(1 - sine**2)
    wall = 40 * np.stack([across * np.cos(azimuth), across * np.sin(azimuth), sine], axis=1)
    write_pcd(tmp_path / "1.0.pcd", wall)
    air = Air("front", [tmp_path / "1.0.pcd"], weather_of("sun:3000"), rng)
    _, strays, likes = air.into(wall, 0)
    assert len(strays) > 2500
    ranges_m = np.linalg.norm(strays, axis=1)
    assert ranges_m.max() < 40.0 + 1e-6  # not through the wall
    assert ranges_m.mean() == pytest.approx(20.0, abs=1.0)
    found = np.degrees(np.arctan2(strays[:, 1], strays[:, 0])) % 360
    assert 150 <= found.min() < 152
    assert 208 < found.max() <= 210
    assert (strays[:, 2] / ranges_m).min() >= -0.2
    assert (strays[:, 2] / ranges_m).max() <= 0.3
    away = np.einsum("ij,ij->i", strays / ranges_m[:, None], wall[likes] / 40)
    assert away.min() > np.cos(np.radians(3))


@pytest.mark.parametrize("text", ["hail:3", "rain", "rain:0", "rain:3:4", "clear:1", "fog:a"])
def test_a_weather_that_is_none_is_refused(tool, scene, text, monkeypatch, capsys) -> None:
    monkeypatch.setattr(sys, "argv", ["measure_scenes.py", str(scene), "--weather", text])
    with pytest.raises(SystemExit):
        tool.main()
    assert f"'{text}', expected clear or" in capsys.readouterr().err


def run(tool, monkeypatch, *words: object) -> int:
    monkeypatch.setattr(sys, "argv", ["measure_scenes.py", *map(str, words)])
    return tool.main()


def tables(said: str) -> list[list[dict[str, str]]]:
    """The tables of a text: their rows by the names of the columns."""
    found = []
    for block in said.split("\n\n"):
        rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in block.splitlines()
                if line.startswith("|")]  # fmt: skip
        if rows:
            found.append([dict(zip(rows[0], row, strict=True)) for row in rows[2:]])
    return found


def test_each_mode_is_measured_with_and_without_a_rule(tool, scene, monkeypatch, capsys) -> None:
    words = [scene, "--weather", "clear", f"rain:{COUNT}", "--without", "strays"]
    assert run(tool, monkeypatch, *words) == 0
    said = capsys.readouterr().out
    lines = [line for line in said.splitlines() if ": within 1 m" in line]
    assert len(lines) == 8
    assert [" without strays: " in line for line in lines] == 2 * [False, False, True, True]
    assert [", stream" in line for line in lines] == 4 * [False, True]
    (rows,) = tables(said)
    assert [row["without"] for row in rows] == ["", "strays", "", "strays"]
    assert rows[0]["scene"].endswith("/visit")
    assert float(rows[0]["within 1 m"].split("%")[0]) > 90.0  # the recording in clear air
    assert float(rows[0]["told"].strip(" %")) > 95.0
    assert all(float(text) > 0 for text in rows[0]["CPU, s"].split(","))


def test_a_run_is_the_same_with_more_jobs_and_compared_with_an_earlier_one(
    tool, scene, tmp_path, monkeypatch, capsys
) -> None:
    scenes, files = [scene, scene.with_name("nobody")], [tmp_path / f"{i}.jsonl" for i in range(3)]
    weather = ["--weather", "clear", f"rain:{COUNT}"]
    assert run(tool, monkeypatch, *scenes, *weather, "--json", files[0]) == 0
    words = ["--jobs", 4, "--against", files[0], "--json", files[1]]
    assert run(tool, monkeypatch, *scenes, *weather, *words) == 0
    assert "0 of 8 results differ, 8 are the same" in capsys.readouterr().out
    usage = ("cpu_s", "memory_mb")
    one, more = (
        [{k: v for k, v in result.items() if k not in usage} for result in read_results(path)]
        for path in files[:2]
    )
    assert one == more
    assert [result["scene"].rpartition("/")[2] for result in one] == 4 * ["visit"] + 4 * ["nobody"]
    # Of two others: one is no longer measured, one is new.
    files[2].write_text("".join(files[0].read_text().splitlines(keepends=True)[:3]))
    assert run(tool, monkeypatch, scenes[0], "--against", files[2]) == 0
    said = capsys.readouterr().out
    assert "0 of 2 results differ" in said
    assert f"Not among these: {scenes[0].parent.name}/visit, rain {COUNT}, recording.\n" in said


def result(scene: str, mode: str, **values: float) -> dict:
    identity = {"scene": scene, "weather": "clear", "mode": mode, "without": ""}
    known = {"tracks": 1, "rows": 90, "drones": 1, "within1m": 0.9, "false": 0.0, "rmse": 0.1}
    return identity | known | values


def nobody(scene: str, tracks: int, rows: int) -> dict:
    empty = result(scene, "stream", tracks=tracks, rows=rows, false=float(tracks > 0))
    return {key: value for key, value in empty.items() if key not in ("drones", "within1m", "rmse")}


def test_what_differs_is_listed_with_the_means_of_what_both_have() -> None:
    before = [
        result("a", "stream"), result("b", "stream"), result("only before", "stream"),
        nobody("n", 2, 31),
    ]  # fmt: skip
    after = [
        result("b", "stream", within1m=0.7, rmse=0.1), result("a", "stream", cpu_s=3.0),
        nobody("n", 0, 0), result("only after", "stream", within1m=0.0),
    ]  # fmt: skip
    said = report_changes(before, after, "FILE")
    assert "FILE: 2 of 3 results differ, 1 are the same" in said
    listed, means = tables(said)
    assert [row["scene"] for row in listed] == ["b", "n"]
    assert listed[0]["within 1 m"] == "90.0 % -> 70.0 %"
    assert listed[0]["RMSE, m"] == "0.100"
    assert listed[1]["tracks"] == "2 -> 0"
    (mean,) = means
    assert mean["flights"] == "2"
    assert mean["within 1 m"] == "90.0 % -> 80.0 %"
    assert (mean["nobody flies"], mean["with a track"]) == ("1", "1 -> 0")
    assert (mean["their tracks"], mean["rows"]) == ("2 -> 0", "31 -> 0")
    assert "Not among these: only before, clear, stream." in said
    assert "Not among FILE: only after, clear, stream." in said


def test_scenes_in_which_nobody_flies_are_counted_apart_from_the_means_of_flights() -> None:
    said = report([result("a", "stream"), nobody("m", 3, 40), nobody("n", 2, 2), nobody("o", 0, 0)])
    _, (mean,) = tables(said)
    assert (mean["flights"], mean["tracks"], mean["false rows"]) == ("1", "1", "0.0 %")
    assert [mean[name] for name in ("nobody flies", "with a track", "their tracks", "rows")] == [
        "3", "2", "5", "42",
    ]  # fmt: skip


def test_modes_are_a_mean_distance_apart_over_the_flights_that_both_have() -> None:
    said = report(
        [
            result("a", "recording", within1m=0.9, once_live=0.95),
            result("a", "stream", within1m=0.5, once_live=0.93),
            result("b", "recording", within1m=0.8, once_live=None),
            result("b", "stream", within1m=0.0, once_live=None),
        ]
    )
    assert "clear: 60.00 points all in all (mean of 2), 2.00 points from the first" in said


def test_both_modes_are_judged_from_the_first_right_row_of_the_stream_on() -> None:
    time_s = np.arange(0.0, 10.0, 0.1)
    way_m = np.stack([time_s, 0 * time_s, 0 * time_s], axis=1)
    in_view = time_s < 8.95
    apart = np.array([0.0, 50.0, 0.0])  # of another target, which only the recording finds
    truth = Truth(
        np.tile(time_s, 2), np.repeat([0.0, 1.0], 100), np.concatenate([way_m, way_m + apart]),
        np.tile(in_view, 2),
    )  # fmt: skip

    def found(first: int, last: int, right_from: int) -> Tracks:
        off = np.where(np.arange(100) < right_from, 1.5, 0.2)[:, None] * [0.0, 0.0, 1.0]
        chosen = slice(first, last)
        return Tracks(time_s[chosen], np.zeros(last - first), (way_m + off)[chosen])

    tracks = {"recording": found(0, 60, 0), "stream": found(20, 100, 40)}
    compared = {mode: compare(truth, one, Options()) for mode, one in tracks.items()}
    shares = once_live(compared)
    assert shares == {"recording": round(20 / 50, 4), "stream": 1.0}
    assert measure([compared["stream"]], Options())["within1m"] == pytest.approx(50 / 180, abs=1e-4)
    assert once_live(compared | {"stream": compare(truth, found(20, 40, 100), Options())}) == {}


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("{", "is no JSON, expected a result a line"),
        ("[1]", "is '[1]', expected a JSON object"),
        ('{"scene": 3}', "scene is 3, expected a text"),
        (json.dumps(result("b", "stream", rmse="much")), "rmse is 'much', expected a number"),
        (json.dumps(result("b", "stream", tracks=None)), "tracks is None, expected a number"),
        (json.dumps(result("a", "stream")), "a, clear, stream comes again, expected one result"),
    ],
)
def test_what_is_no_file_of_results_is_refused_by_its_line(tmp_path, line: str, why: str) -> None:
    path = tmp_path / "results.jsonl"
    path.write_text(f"{json.dumps(result('a', 'stream'))}\n{line}\n")
    with pytest.raises(InputError) as refused:
        read_results(path)
    assert str(refused.value) == f"{path}:2: {why}"


def test_arguments_that_do_not_go_together_are_refused(
    tool, scene, tmp_path, monkeypatch, capsys
) -> None:
    results = tmp_path / "results.jsonl"
    results.write_text("")
    assert run(tool, monkeypatch, scene, scene, "--json", results) == 2
    assert "/visit comes twice, expected scenes of other names" in capsys.readouterr().err
    assert run(tool, monkeypatch, scene, "--json", results, "--against", results) == 2
    assert f"{results}: is what is read" in capsys.readouterr().err
    assert run(tool, monkeypatch, scene, "--json", tmp_path / "no/results") == 5
    assert "no/results: cannot be written" in capsys.readouterr().err
    (tmp_path / "ground_truth.csv").write_text("timestamp,x,y,z\n")
    (tmp_path / "cmd.txt").write_text("--frames 'mid360=no end")
    assert run(tool, monkeypatch, tmp_path) == 4
    assert "cmd.txt: No closing quotation, expected options" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        run(tool, monkeypatch, scene, "--jobs", "0")
    assert "'0', expected a whole number from 1 on" in capsys.readouterr().err
