"""Texts and drawings of the report page, compared with the run that it was made from."""

import base64
import json
import re
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from flights import join_truths, track_at, truth_at
from report_run import CLUSTERS, DRONE_RETURNS_PER_FRAME, OFFSET_M, SIGMA_M, make_run
from synthetic import BEGIN_NS, PERIOD_NS, drone_position_m
from unlidar.cli import main
from unlidar.colours import track_colours
from unlidar.evaluation import evaluate
from unlidar.figure import legend as figure_legend
from unlidar.record import RunRecord
from unlidar.report import ReportData, load_run
from unlidar.report import sample as sampling
from unlidar.report.charts import errors_of, lengths_of
from unlidar.report.lines import at_times, drawn_rows, range_sigma, speed, tube
from unlidar.report.page import begin_of, page_of
from unlidar.report.static import figure_data
from unlidar.report.view_data import pack_trajectories, pack_view, target_steps
from unlidar.truth import Tracks, Truth

MOST_BYTES = 10_000_000


@pytest.fixture(scope="module")
def run_dir(tmp_path_factory):
    return make_run(tmp_path_factory.mktemp("report") / "run")


@pytest.fixture(scope="module")
def data(run_dir):
    return load_run(run_dir)


def text_of(page: str) -> str:
    """The visible text, without the scripts."""
    return " ".join(re.sub(r"<[^>]+>", " ", re.sub(r"(?s)<script.*?</script>", "", page)).split())


def embedded(page: str) -> dict:
    return json.loads(re.search(r'(?s)id="data">(.*?)</script>', page)[1])


def test_every_target_return_is_found_in_its_frame(data):
    stamps_s = (BEGIN_NS + PERIOD_NS * np.arange(30)) * 1e-9
    assert np.allclose(data.sample.target_s, np.repeat(stamps_s, DRONE_RETURNS_PER_FRAME))
    assert np.array_equal(
        target_steps(data.sample), np.repeat(np.arange(30), DRONE_RETURNS_PER_FRAME)
    )


def test_returns_of_a_sensor_that_stands_elsewhere_are_drawn_in_the_common_frame(data, tmp_path):
    moved = load_run(make_run(tmp_path / "run", pose=(5.0, -3.0, 1.0)))
    assert np.allclose(moved.sample.steps_m[7], data.sample.steps_m[7], atol=1e-5)
    assert np.isfinite(moved.sample.target_s).all()


def test_a_page_keeps_to_its_share_of_the_returns_and_says_so(run_dir, monkeypatch):
    monkeypatch.setattr(sampling, "MOST_OVERALL", 900)
    monkeypatch.setattr(sampling, "MOST_IN_STEPS", 1500)
    monkeypatch.setattr(sampling, "MOST_STEPS", 7)
    thinned = load_run(run_dir)
    sample = thinned.sample
    assert len(sample.overall_m) == 900
    assert sample.frames_per_step == 5
    assert [len(step) for step in sample.steps_m] == [1500 // 6] * 6
    shown = text_of(page_of(thinned))
    assert f"900 of {sample.returns:,} returns" in shown
    assert "6 moments of 5 frames" in shown
    assert f"1,500 of {sample.returns:,} returns" in shown


def test_all_frames_have_the_same_chance_to_be_drawn(run_dir, monkeypatch):
    monkeypatch.setattr(sampling, "MOST_OVERALL", 6000)
    overall = load_run(run_dir).sample.overall_m
    ground = overall[:, 2] < -1.9
    # 700 of about 1026 returns of each frame are ground.
    assert abs(ground.mean() - 700 / 1026) < 0.03


def test_points_survive_the_packing_to_half_a_centimetre(data):
    packed = pack_view(data, begin_of(data))
    values = np.frombuffer(base64.b64decode(packed["steps"]), "<i2").reshape(-1, 3)
    points = values * packed["unit"]
    assert np.abs(points - np.concatenate(data.sample.steps_m)).max() <= 0.00501
    assert packed["steps_end"][-1] == len(points)
    assert packed["targets_end"] == list(DRONE_RETURNS_PER_FRAME * np.arange(1, 31))
    assert np.allclose(packed["truth"][4][0], drone_position_m(0.4), atol=0.01)
    assert np.allclose(packed["estimate"][4][0], drone_position_m(0.4) + OFFSET_M, atol=0.01)


def test_the_page_shows_the_measures_settings_counts_and_versions(data):
    shown = text_of(page_of(data))
    rmse = np.linalg.norm(OFFSET_M)
    for words in (
        f"RMSE {rmse:.3f} m", "coverage 100.0 %", "method robust", "bad frames 3", "read 0.25",
        "unlidar_track 9.8.7", "input.min: 0.5", "--threads 2", "± 2 sigma",
        f"25 of {CLUSTERS} rows",
    ):  # fmt: skip
        assert words in shown, words


def test_the_page_asks_for_nothing_from_outside(data):
    page = re.sub(r"(?s)<script>/\*\*.*?</script>", "", page_of(data), count=1)
    assert len(page) < 2_000_000  # plotly.js was cut out
    assert not re.search(r"""(src|href)\s*=|@import|url\(|https?://""", page)
    assert "default-src 'none'" in page


def test_the_same_run_gives_the_same_page(run_dir, data):
    assert page_of(load_run(run_dir)) == page_of(data)


def test_names_of_files_cannot_become_markup(tmp_path):
    evil = load_run(make_run(tmp_path / "run", title="</script><b>x"))
    page = page_of(evil)
    assert "<b>x" not in page
    assert "&lt;b&gt;x" in page


@pytest.mark.parametrize(("truth", "said"), [(True, "coverage 0.0 %"), (False, "no ground truth")])
def test_a_run_without_a_drone_says_so_plainly(truth, said, tmp_path):
    empty = load_run(make_run(tmp_path / "run", tracked=False, truth=truth))
    shown = text_of(page_of(empty))
    assert "No drone was found" in shown
    assert said in shown
    assert "RMSE" not in shown
    assert ("over_time" in embedded(page_of(empty))["figures"]) == truth


def test_an_hour_of_data_stays_below_ten_megabytes_and_says_what_is_left_out():
    rng = np.random.default_rng(1)
    time_s = np.arange(36_000) * 0.1
    path = np.cumsum(rng.normal(0, 0.1, (36_000, 3)), axis=0)
    ones = np.ones((36_000, 3))
    tracks = Tracks(time_s, np.zeros(36_000), path, 0.1 * ones, ones, np.ones(36_000))
    truth_s = np.arange(72_000) * 0.05
    truth_m = np.stack([np.interp(truth_s, time_s, path[:, i]) for i in range(3)], axis=1)
    truth = Truth(truth_s, np.zeros(72_000), truth_m, np.ones(72_000, dtype=bool))
    steps = sampling.MOST_STEPS
    cloud = rng.uniform(-300, 300, (sampling.MOST_IN_STEPS, 3))
    sample = sampling.Sample(
        overall_m=cloud[: sampling.MOST_OVERALL],
        steps_s=np.linspace(0, 3600, steps),
        edges_s=np.linspace(0, 3600, steps)[1:],
        steps_m=np.array_split(cloud, steps),
        frames_per_step=90,
        target_m=cloud[: sampling.MOST_TARGETS],
        target_s=np.sort(rng.uniform(0, 3600, sampling.MOST_TARGETS)),
        targets=90_000, frames=36_000, returns=150_000_000, far=0,
    )  # fmt: skip
    columns = ["id", "rank", *[f"psi_{i}" for i in range(10)]]
    clusters = [dict.fromkeys(columns, "1.234567890123")] * 5000
    data = ReportData(
        RunRecord("hour", Path(), {}, None, [], tracking_s=1.0), {}, tracks, truth,
        evaluate(truth, tracks), clusters, sample, [],
    )  # fmt: skip
    page = page_of(data)
    assert len(page.encode()) < MOST_BYTES
    shown = text_of(page)
    assert "Of the truth one row in 15 is drawn" in shown
    assert "Of the estimate one row in 8 is drawn" in shown
    assert "40,000 of 90,000 target returns" in shown
    assert "the best 1,000 take part" in shown


def test_each_track_has_one_colour_in_figures_curves_time_steps_and_tables(tmp_path):
    data = load_run(make_run(tmp_path / "run", track_ids=(3, 4, 11)))
    colours = track_colours(data.tracks.track_id)
    assert len(set(colours.values())) == 3
    page = page_of(data)
    content = embedded(page)
    for number, colour in colours.items():
        name = f"track {number:g}"
        assert f"style='background:{colour}'></span>{number:g}<" in page
        for figure in ("scene", "over_time"):
            drawn = [t for t in content["figures"][figure]["data"] if t.get("name") == name]
            assert drawn
            assert {trace["line"]["color"] for trace in drawn} == {colour}
        assert [c["colour"] for c in content["courses"] if c.get("name") == name] == [colour]
        assert [colour] in content["moments"]["colours"]
        handles = figure_legend(figure_data(data))
        assert (name, colour) in [(h.get_label(), h.get_color()) for h in handles]
    lone = load_run(make_run(tmp_path / "lone", track_ids=(4,)))
    assert list(track_colours(lone.tracks.track_id)) == [4.0]


def test_lines_and_tubes_carry_their_times(data):
    from unlidar.report.charts import FIRST_TRAJECTORY, scene

    begin_s = begin_of(data)
    packed = pack_trajectories(data, begin_s, FIRST_TRAJECTORY)
    names = [scene(data).data[course["trace"]].name for course in packed]
    assert names == ["truth", "track 0", "track 0 ± 2 sigma"]

    def floats(text: str) -> np.ndarray:
        return np.frombuffer(base64.b64decode(text), "<f4")

    line, tube_of = packed[1], packed[2]
    times = floats(line["time"])
    assert np.allclose(times, data.tracks.time_s - begin_s, atol=1e-3)
    assert np.allclose(floats(line["points"]).reshape(-1, 3), data.tracks.xyz_m, atol=1e-4)
    assert line["spans"] == [[pytest.approx(0), pytest.approx(2.9)]]
    rings = floats(tube_of["points"]).reshape(len(floats(tube_of["time"])), 8, 3)
    assert np.allclose(rings.mean(axis=1), data.tracks.xyz_m, atol=1e-4)
    faces = np.frombuffer(base64.b64decode(tube_of["faces"]), "<u2")
    assert faces.max() == 8 * len(rings) - 1


@pytest.mark.parametrize(("method", "folded"), [("robust", True), ("paper", False)])
def test_the_papers_scores_are_folded_away_where_they_decide_nothing(method, folded, tmp_path):
    page = page_of(load_run(make_run(tmp_path / "run", method=method)))
    scores = page.split("<h2>Cluster scores</h2>")[1].split("</section>")[0]
    assert scores.strip().startswith("<details>") == folded
    assert "cluster_rows" in scores


def test_of_several_drones_each_is_compared_with_its_own_track():
    times = np.arange(0, 5, 0.1)
    truth = join_truths(truth_at(times), truth_at(times, target=1.0, away_m=9.0))
    tracks = track_at(times, [0.4, 0, 0])
    sample = sampling.sample_returns({}, tracks, np.zeros((0, 3)), 0)
    data = ReportData(
        RunRecord("two", Path(), {}, None, [], tracking_s=1.0), {}, tracks, truth,
        evaluate(truth, tracks), [], sample, [],
    )  # fmt: skip
    errors = errors_of(data)
    assert set(errors.target) == {0.0}
    assert np.allclose(lengths_of(errors)[0], 0.4)
    shown = text_of(page_of(data))
    for words in (
        "RMSE 0.400 m (one track a drone, 50.0 % of the time)",
        "drone matched RMSE of the matched [m] coverage 0 100.0 % 0.400 100.0 % 1 0.0 % - 100.0 %",
        "against the track that each drone has to itself",
    ):
        assert words in shown, words


def test_errors_are_those_of_the_evaluation(data):
    errors = errors_of(data)
    length, rest = lengths_of(errors)
    assert np.sqrt((length**2).mean()) == pytest.approx(data.measures["rmse"], abs=1e-3)
    assert np.sqrt((rest**2).mean()) == pytest.approx(data.measures["rmse_unbiased"], abs=1e-3)


def test_thinned_lines_keep_their_ends_and_break_where_time_leaps():
    time_s = np.concatenate([np.arange(100) * 0.1, 50 + np.arange(100) * 0.1])
    drawn = drawn_rows(time_s, np.zeros(200), most=20)
    assert [list(piece[[0, -1]]) for piece in drawn.pieces] == [[0, 99], [100, 199]]
    values = drawn.of(time_s)
    assert np.isnan(values).sum() == 1
    assert len(values) <= 20 + 3
    assert drawn_rows(time_s, np.zeros(200)).every == 1


def test_a_target_is_nowhere_in_a_gap():
    time_s = np.array([0.0, 0.1, 0.2, 5.0, 5.1])
    xyz_m = np.arange(15.0).reshape(5, 3)
    (at,) = at_times(time_s, np.zeros(5), xyz_m, np.array([-1.0, 0.15, 2.0, 5.1, 9.0]))
    assert np.isnan(at[[0, 2, 4]]).all()
    assert np.allclose(at[1], [4.5, 5.5, 6.5])
    assert np.allclose(at[3], xyz_m[4])


def test_the_speed_of_a_steady_flight_is_its_speed():
    time_s = np.array([*np.arange(0, 3, 0.05), 10.0])  # the last row stands alone
    xyz_m = time_s[:, None] * np.array([3.0, 0.0, 4.0])
    found = speed(time_s, np.zeros(len(time_s)), xyz_m)
    assert np.allclose(found[:-1], 5.0)
    assert np.isnan(found[-1])


def test_the_sigma_of_the_range_is_that_of_random_positions():
    rng = np.random.default_rng(2)
    centre, sigma = np.array([[20.0, -10.0, 5.0]]), np.array([[0.3, 0.1, 0.5]])
    ranges = np.linalg.norm(centre + sigma * rng.normal(size=(200_000, 3)), axis=1)
    assert range_sigma(centre, sigma)[0] == pytest.approx(ranges.std(), rel=0.02)


def test_the_tube_of_an_equal_sigma_is_round_and_closed_around_the_flight():
    xyz_m = drone_position_m(np.arange(0, 5, 0.1))
    corners, faces, rings = tube([np.arange(50)], xyz_m, np.full((50, 3), 2 * SIGMA_M))
    assert np.array_equal(rings, np.arange(50))
    away = np.linalg.norm(corners - np.repeat(xyz_m, 8, axis=0), axis=1)
    assert np.allclose(away, 2 * SIGMA_M)
    assert len(faces) == 49 * 16
    assert faces.max() == len(corners) - 1
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    _, times = np.unique(edges, axis=0, return_counts=True)
    # Only the edges of the two open ends belong to one triangle.
    assert (times == 1).sum() == 2 * 8
    assert set(times) == {1, 2}


def test_a_hovering_target_has_a_tube_too():
    corners, faces, _ = tube([np.arange(9)], np.ones((9, 3)), np.full((9, 3), 0.2))
    assert np.isfinite(corners).all()
    assert len(faces) == 8 * 16


def test_report_rebuilds_the_page_of_a_folder_that_was_moved(run_dir, tmp_path, capsys):
    moved = tmp_path / "elsewhere"
    shutil.copytree(run_dir, moved)
    assert main(["report", str(moved)]) == 0
    assert "report.html" in capsys.readouterr().out
    shown = text_of((moved / "report.html").read_text())
    assert "1 track" in shown
    assert "no longer there" not in shown


def test_frames_that_are_gone_are_reported_and_the_rest_is_drawn(run_dir, tmp_path):
    bare = tmp_path / "bare"
    shutil.copytree(run_dir, bare)
    shutil.rmtree(bare / "frames")
    assert main(["report", str(bare)]) == 0
    shown = text_of((bare / "report.html").read_text())
    assert "no longer there" in shown
    assert "coverage 100.0 %" in shown


@pytest.mark.parametrize("kind", ["run.json", "summary.json", "traj.csv", "clusters.csv"])
def test_a_folder_with_a_missing_or_broken_file_is_one_clear_line(kind, run_dir, tmp_path, fails):
    broken = tmp_path / "broken"
    shutil.copytree(run_dir, broken)
    (broken / kind).write_text("[1]\n2,3\n")
    assert kind in fails(4, "report", broken)
    (broken / kind).unlink()
    assert kind in fails(4, "report", broken)


@pytest.mark.parametrize("truth", [True, False])
def test_figures_for_papers_are_written_as_png_and_pdf(truth, tmp_path):
    run = make_run(tmp_path / "run", truth=truth)
    assert main(["report", str(run), "--static"]) == 0
    names = {"flight", "over_time"} | ({"error"} if truth else set())
    figures = run / "figures"
    assert {path.name for path in figures.iterdir()} == {
        f"{name}.{kind}" for name in names for kind in ("png", "pdf")
    }
    first = {path.name: path.read_bytes() for path in figures.iterdir()}
    assert all(b.startswith(b"%PDF" if n.endswith("f") else b"\x89PNG") for n, b in first.items())
    assert main(["report", str(run), "--static"]) == 0
    assert {path.name: path.read_bytes() for path in figures.iterdir()} == first


def test_without_rerun_the_wish_for_a_recording_is_refused(run_dir, fails, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    assert "unlidar-track[rerun]" in fails(2, "report", run_dir, "--rerun")
    assert not (run_dir / "recording.rrd").exists()


def test_a_recording_for_rerun_holds_returns_truth_and_estimate(tmp_path):
    pytest.importorskip("rerun", reason="the extra 'rerun' is not installed")
    run = make_run(tmp_path / "run", frames=10)
    assert main(["report", str(run), "--rerun"]) == 0
    content = (run / "recording.rrd").read_bytes()
    assert content.startswith(b"RRF")
    for entity in (b"world/returns/now", b"world/target_returns/now", b"world/truth/0",
                   b"world/estimate/0/two_sigma"):  # fmt: skip
        assert entity in content, entity
