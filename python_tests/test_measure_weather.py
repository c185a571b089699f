"""Weather in recorded frames is the simulator's, and what it costs is measured and judged."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
from unlidar.frames_io import list_frames, read_pcd, read_returns, write_pcd
from unlidar.simulate import Scenario, simulate
from unlidar.simulate.scenario import Drone, Flight, Scene, Sensor
from unlidar.simulate.sensors import MODELS, in_field_of_view
from unlidar_bench.weather import Air, weather_of

TOOL = Path(__file__).parents[1] / "tools/measure_weather.py"
COUNT = 400


@pytest.fixture(scope="module")
def tool():
    spec = importlib.util.spec_from_file_location("measure_weather", TOOL)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look for it
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five seconds of a drone above one LiDAR, with a time for each return."""
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
    return path


def with_weather(tool, scene: Path, text: str, out: Path) -> tuple[list[np.ndarray], list]:
    flight = tool.flight_of(scene)
    sensors, _ = tool.put_weather(flight, weather_of(text), 1, out)
    frames = list_frames(sensors["mid360"])
    assert [f.path.name for f in frames] == [f.path.name for f in list_frames(scene / "mid360")]
    return [read_returns(frame.path) for frame in frames], frames


def test_as_many_returns_as_asked_for_come_within_the_field_of_view(tool, scene, tmp_path) -> None:
    clear, frames = with_weather(tool, scene, "clear", tmp_path / "clear")
    assert frames == list_frames(scene / "mid360")
    assert not (tmp_path / "clear").exists()
    snow, frames = with_weather(tool, scene, f"snow:{COUNT}", tmp_path / "snow")
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


def test_dense_fog_hides_what_is_far(tool, scene, tmp_path) -> None:
    clear, _ = with_weather(tool, scene, "clear", tmp_path / "clear")
    fog, _ = with_weather(tool, scene, "fog:1:20", tmp_path / "fog")
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
    monkeypatch.setattr(sys, "argv", ["measure_weather.py", str(scene), "--weather", text])
    with pytest.raises(SystemExit):
        tool.main()
    assert f"'{text}', expected clear or" in capsys.readouterr().err


def test_each_mode_is_measured_with_and_without_a_rule(tool, scene, monkeypatch, capsys) -> None:
    words = [scene, "--weather", "clear", f"rain:{COUNT}", "--without", "strays"]
    monkeypatch.setattr(sys, "argv", ["measure_weather.py", *map(str, words)])
    assert tool.main() == 0
    said = capsys.readouterr().out.splitlines()
    lines = [line for line in said if ": within 1 m" in line]
    assert len(lines) == 8
    assert [" without strays: " in line for line in lines] == 2 * [False, False, True, True]
    assert [", stream" in line for line in lines] == 4 * [False, True]
    rows = [line.split("|")[1:-1] for line in said if line.startswith("|")]
    assert len(rows) == 2 + 4 + 2
    assert len({len(row) for row in rows}) == 1
    cells = dict(zip((cell.strip() for cell in rows[0]), rows[2], strict=True))
    assert cells["scene"].strip().endswith("/visit")
    assert float(cells["within 1 m"].split("%")[0]) > 90.0  # the recording in clear air
    assert float(cells["told"].strip(" %")) > 95.0
    assert all(float(cell) > 0 for cell in cells["CPU, s"].split(","))
