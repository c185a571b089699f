"""The figure is drawn for every kind of result, in the colours it promises."""

from dataclasses import replace

import matplotlib.image
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from unlidar.evaluation import evaluate
from unlidar.figure import FigureData, write_figure
from unlidar.truth import Tracks, Truth

COLOURS = {"truth": "#d62728", "estimate": "#1f4fd6", "target": "#1f9d3a"}


def make_data(truth_rows: int, track_rows: int) -> FigureData:
    rng = np.random.default_rng(1)
    time_s = np.linspace(0, 10, 100)
    path = np.stack([8 * np.cos(time_s), 8 * np.sin(time_s), 8 + time_s / 3], axis=1)
    n, m = truth_rows, track_rows
    truth = Truth(time_s[:n], np.zeros(n), path[:n], np.ones(n, dtype=bool))
    tracks = Tracks(time_s[:m], np.zeros(m), path[:m] + 0.5)
    returns = rng.uniform(-20, 20, (2000, 3)) * [1, 1, 0.1]
    targets = path[:m] + 0.5 + rng.normal(0, 0.4, (m, 3))
    return FigureData("scene", returns, targets, truth, tracks, evaluate(truth, tracks))


def has_colour(image: np.ndarray, colour: str) -> bool:
    return bool((np.abs(image[..., :3] - to_rgb(colour)).max(axis=2) < 0.02).any())


@pytest.mark.parametrize("truth_rows", [0, 1, 100])
@pytest.mark.parametrize("track_rows", [0, 1, 100])
def test_lines_appear_where_there_is_something_to_draw(truth_rows, track_rows, tmp_path):
    path = tmp_path / "figure.png"
    write_figure(make_data(truth_rows, track_rows), path)
    image = matplotlib.image.imread(path)
    assert image.shape[0] > 700
    assert image.shape[1] > 1400
    assert has_colour(image, COLOURS["truth"]) == (truth_rows > 0)
    assert has_colour(image, COLOURS["estimate"]) == (track_rows > 0)
    assert has_colour(image, COLOURS["target"])  # the legend at least


def test_a_recording_without_anything_can_be_drawn(tmp_path):
    nothing = make_data(0, 0)
    empty = FigureData(
        "nothing", np.zeros((0, 3)), np.zeros((0, 3)), nothing.truth, nothing.tracks, None
    )
    write_figure(empty, tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 10_000


@pytest.mark.parametrize("name", ["a$x^$", r"$\frac$", "\udcff", "a\x1bb", r"a\$b$c"])
def test_any_name_of_a_recording_can_be_drawn(name, tmp_path):
    write_figure(replace(make_data(10, 10), title=name), tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 10_000


def test_the_same_data_gives_the_same_bytes(tmp_path):
    for name in ("a.png", "b.png"):
        write_figure(make_data(100, 60), tmp_path / name)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
