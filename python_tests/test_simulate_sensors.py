"""The scans of the sensor models are those of their data sheets."""

import math

import numpy as np
import pytest
from unlidar.simulate.sensors import MODELS, in_field_of_view, scan

LIVOX = ("mid360", "avia")
RAYS_PER_FRAME = {"mid360": 20_000, "avia": 24_000, "spinning32": 32_768,
                  "spinning64": 65_536, "spinning128": 131_072}  # fmt: skip
PHASE = (0.1, 0.7)


def directions(name: str, frames: int) -> np.ndarray:
    return np.concatenate([scan(MODELS[name], index, PHASE)[0] for index in range(frames)])


def spread_deg(name: str, axis: np.ndarray) -> tuple[float, float]:
    """Lowest and highest angle of any ray towards an axis, seen from the plane across it."""
    angle = np.degrees(np.arcsin(directions(name, 30) @ axis))
    return float(angle.min()), float(angle.max())


@pytest.mark.parametrize("name", MODELS)
def test_a_frame_has_the_rays_of_the_data_sheet_all_of_unit_length_and_in_the_field_of_view(name):
    rays, time_ns = scan(MODELS[name], 3, PHASE)
    assert len(rays) == RAYS_PER_FRAME[name]
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1.0, atol=1e-12)
    assert in_field_of_view(MODELS[name], rays * (1 - 1e-9)).mean() > 0.97
    assert np.all(np.diff(time_ns) >= 0)
    assert time_ns.min() == 0
    assert 0.099e9 < time_ns.max() < 0.1e9


@pytest.mark.parametrize("name", MODELS)
def test_the_scan_is_a_function_of_time_and_goes_on_from_frame_to_frame(name):
    model = MODELS[name]
    np.testing.assert_array_equal(scan(model, 7, PHASE)[0], scan(model, 7, PHASE)[0])
    beams = model.pattern.beams
    last, first = scan(model, 0, PHASE)[0][-beams:], scan(model, 1, PHASE)[0][:beams]
    before = scan(model, 0, PHASE)[0][-2 * beams : -beams]
    step, previous = np.linalg.norm(first - last, axis=1), np.linalg.norm(last - before, axis=1)
    np.testing.assert_allclose(step, previous, rtol=0.1)


def test_the_mid360_sees_all_around_from_7_degrees_below_to_52_above():
    low, high = spread_deg("mid360", np.array([0.0, 0.0, 1.0]))
    assert (low, high) == pytest.approx((-7, 52), abs=0.1)
    rays = directions("mid360", 1)
    turns = np.histogram(np.arctan2(rays[:, 1], rays[:, 0]), 36, (-np.pi, np.pi))[0]
    assert turns.min() > 0.8 * turns.mean()


def test_the_rays_per_steradian_of_the_mid360_are_the_same_everywhere_in_its_field_of_view():
    rays = directions("mid360", 20)
    field_sr = 2 * math.pi * (math.sin(math.radians(52)) - math.sin(math.radians(-7)))
    radius = math.radians(3)
    expected = len(rays) / field_sr * 2 * math.pi * (1 - math.cos(radius))
    rng = np.random.default_rng(5)
    for _ in range(200):
        elevation, azimuth = np.radians(rng.uniform(-4, 49)), rng.uniform(-np.pi, np.pi)
        flat = math.cos(elevation)
        centre = [flat * math.cos(azimuth), flat * math.sin(azimuth), math.sin(elevation)]
        count = (rays @ np.array(centre) > math.cos(radius)).sum()
        assert count == pytest.approx(expected, rel=0.15)


def test_a_frame_of_the_mid360_is_as_dense_as_forty_lines():
    rays = directions("mid360", 1)
    column = rays[np.abs(np.arctan2(rays[:, 1], rays[:, 0])) < math.radians(0.5)]
    elevation = np.sort(np.degrees(np.arcsin(column[:, 2])))
    lines = 1 + (np.diff(elevation) > 0.15).sum()
    assert 30 <= lines <= 42  # two lines can lie on each other


def test_the_avia_on_its_back_sees_70_by_77_degrees_about_the_zenith():
    wide = spread_deg("avia", np.array([0.0, 1.0, 0.0]))
    high = spread_deg("avia", np.array([1.0, 0.0, 0.0]))
    assert wide == pytest.approx((-35.2, 35.2), abs=0.3)
    assert high == pytest.approx((-38.6, 38.6), abs=0.3)
    assert in_field_of_view(MODELS["avia"], np.array([[0.0, 0.0, 5.0]])).all()
    assert not in_field_of_view(MODELS["avia"], np.array([[5.0, 0.0, 5.0], [0, 0, -5]])).any()


def test_the_avia_is_densest_in_the_middle_and_covers_its_whole_field_with_time():
    rays = directions("avia", 100)
    off_axis = np.degrees(np.arccos(rays[:, 2]))
    middle = (off_axis < 5).mean() / (1 - math.cos(math.radians(5)))
    ring = ((off_axis > 20) & (off_axis < 25)).mean() / (
        math.cos(math.radians(20)) - math.cos(math.radians(25))
    )
    assert middle > 1.5 * ring
    rng = np.random.default_rng(3)
    for _ in range(100):
        angle, turn = math.radians(rng.uniform(0, 33)), rng.uniform(-np.pi, np.pi)
        side = math.sin(angle)
        towards = np.array([side * math.cos(turn), side * math.sin(turn), math.cos(angle)])
        assert (rays @ towards > math.cos(math.radians(1.5))).sum() > 20


@pytest.mark.parametrize("name", LIVOX)
def test_no_frame_of_a_livox_repeats_the_rays_of_another(name):
    first, _ = scan(MODELS[name], 0, PHASE)
    for index in (1, 2, 10, 50, 300):
        other, _ = scan(MODELS[name], index, PHASE)
        assert np.median(np.linalg.norm(first - other, axis=1)) > 0.01


def test_the_spinning_sensor_draws_the_same_32_rings_in_every_frame():
    rays, time_ns = scan(MODELS["spinning32"], 0, PHASE)
    np.testing.assert_allclose(scan(MODELS["spinning32"], 9, PHASE)[0], rays, atol=1e-9)
    elevation = np.degrees(np.arcsin(rays[:, 2]))
    rings = np.unique(elevation.round(6))
    np.testing.assert_allclose(rings, np.linspace(-22.5, 22.5, 32), atol=1e-6)
    assert len(np.unique(time_ns)) == 1024
