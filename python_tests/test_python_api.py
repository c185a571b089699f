"""The package as a library: the documented example runs, and no measure gets lost."""

from __future__ import annotations

import contextlib
import dataclasses
import io
import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
import unlidar
from flights import join_tracks, join_truths, track_at, truth_at, write_result
from many import StandIn, make_sequence
from synthetic import PROJECT
from unlidar.cli import main
from unlidar.evaluation import Options, evaluate_files

PAGE = PROJECT / "docs/python_api.md"
TIMES = np.arange(0, 6, 0.1)


@pytest.fixture
def stand_in(tmp_path, monkeypatch) -> StandIn:
    program = StandIn(tmp_path)
    monkeypatch.setenv("UNLIDAR_TRACK", str(program.write()))
    return program


def test_the_examples_of_the_page_work_as_written(program, shared, tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("UNLIDAR_TRACK", str(program))
    monkeypatch.chdir(tmp_path)
    Path("mmaud").symlink_to(shared / "data/mmaud")
    Path("flight.bag").symlink_to(shared / "data/formats/bags/ros1_pointcloud2.bag")
    pytest.importorskip("unlidar._engine", reason="the engine for Python is not built")
    names: dict[str, object] = {}
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        for page in (PROJECT / "README.md", PAGE):
            for example in re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL):
                exec(compile(example, str(page), "exec"), names)
    first, begun, *lines = printed.getvalue().splitlines()
    assert re.fullmatch(r"track 0: \d+ rows, drone 0\.\d\d, z \d+\.\d m", first)
    assert begun == "track 0 begins"
    assert lines[0] == "1 track(s) in out/seq0001/traj.csv"
    assert re.fullmatch(r"RMSE 0\.5\d\d m over 100% of the truth", lines[1])
    assert lines[2].startswith("without the mean offset 0.03")
    assert "frames" in lines[3]
    assert len(lines) == 4


def test_run_gives_what_the_command_line_writes(stand_in, tmp_path) -> None:
    source = make_sequence(tmp_path / "seq")
    found = unlidar.run(
        str(source), tmp_path / "out", method="paper", settings={"a.b": [1, 2.5], "c": True}
    )
    assert main(["evaluate", str(found.out)]) == 0
    for path in (found.trajectory, found.summary, found.target_returns, found.clusters,
                 found.figure, found.page, found.truth):  # fmt: skip
        assert path.is_file()
    assert (found.tracks, found.measures.rmse, found.measures.coverage) == (1, 0.0, 1.0)
    assert found.frames == {"lidar_360": tmp_path / "out/frames/lidar_360"}
    told = json.loads(found.summary.read_text())["told"]
    assert [word for word in told if "=" in word][1:] == ["method=paper", "a.b=[1, 2.5]", "c=true"]


def test_nothing_is_printed(stand_in, tmp_path, capfd) -> None:
    stand_in.write("print('told'); print('unlidar_track: a note', file=sys.stderr)")
    found = unlidar.run(make_sequence(tmp_path / "seq"), tmp_path / "out")
    assert found.messages == ("unlidar_track: a note",)
    said = capfd.readouterr()
    assert (said.out, said.err) == ("", "")


def test_convert_reports_what_it_did(tmp_path) -> None:
    source = make_sequence(tmp_path / "seq")
    done = unlidar.convert(source, tmp_path / "out")
    assert done.frames == {"lidar_360": 3}
    assert done.returns == {"lidar_360": 12}
    assert done.truth_rows == 3
    assert done.truth.is_file()
    with pytest.raises(unlidar.OutputError, match="exists already"):
        unlidar.convert(source, tmp_path / "out")
    options = unlidar.ConvertOptions(start_s=0.15)
    less = unlidar.convert(source, tmp_path / "out", force=True, options=options)
    assert less.frames == {"lidar_360": 1}


@pytest.mark.parametrize(
    ("several", "options"),
    [
        (False, Options()),
        (True, Options()),
        (True, Options(align="se3", time_offset=0.05)),
        (False, Options(time_offset="auto", bootstrap=0)),
    ],
)
def test_no_measure_is_lost(several, options, tmp_path) -> None:
    noise = np.random.default_rng(1).normal(0, 0.1, (len(TIMES), 3))
    truth, tracks = truth_at(TIMES), track_at(TIMES, noise, sigma_m=np.full((len(TIMES), 3), 0.1))
    if several:
        truth = join_truths(truth, truth_at(TIMES, target=1.0, away_m=15.0))
        tracks = join_tracks(tracks, track_at(TIMES[:9], [15.0, 0, 0], 1.0))
    folder = write_result(tmp_path, truth, tracks)
    files = folder / "ground_truth.csv", folder / "traj.csv"
    expected = evaluate_files(*files, options)
    found = unlidar.evaluate(*map(str, files), options)
    as_json = json.loads(json.dumps(dataclasses.asdict(found)))
    for name, value in expected.items():
        if name == "targets":
            assert [{k: v for k, v in one.items() if v is not None} for one in as_json[name]] == (
                value
            )
        else:
            assert as_json[name] == json.loads(json.dumps(value)), name
    absent = {f.name for f in dataclasses.fields(found)} - set(expected)
    for name in absent:
        assert getattr(found, name) in (None, (), {}, 0.0, False, "none"), name


def test_errors_of_a_user_are_of_one_kind(tmp_path) -> None:
    (tmp_path / "t.csv").write_text("timestamp,x,y\n")
    with pytest.raises(unlidar.UnlidarError, match="has no column z") as refused:
        unlidar.evaluate(tmp_path / "t.csv", tmp_path / "t.csv")
    assert isinstance(refused.value, unlidar.InputError)
    assert refused.value.exit_code == 4
    with pytest.raises(unlidar.UsageError, match="list of names"):
        unlidar.run(tmp_path, tmp_path / "out", sensors="lidar")


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"align": "foo"}, "align: 'foo', expected one of none, translation, yaw, se3"),
        ({"time_offset": "later"}, "time_offset: 'later', expected a number"),
        ({"bootstrap": -1}, "bootstrap: -1, expected a whole number from 0 on"),
        ({"time_offset": True}, "time_offset: True, expected a number"),
        ({"block_s": 0}, "block_s: 0, expected a number above 0"),
        ({"seed": 1.5}, "seed: 1.5, expected a whole number from 0 on"),
    ],
)
def test_options_of_an_evaluation_are_checked(values, said) -> None:
    with pytest.raises(unlidar.UsageError, match=f"^{said}$"):
        unlidar.EvaluateOptions(**values)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"topics": "/points"}, "topics: '/points', expected a list of names"),
        ({"truths": [7]}, r"truths: \[7\], expected a list of names"),
        ({"start_s": -1}, "start_s: -1, expected a number from 0 on"),
        ({"duration_s": float("inf")}, "duration_s: inf, expected a number above 0"),
        ({"stamp": "Log"}, "stamp: 'Log', expected 'header' or 'log'"),
        ({"merge": 0}, "merge: 0, expected a whole number from 1 on"),
        ({"merge": True}, "merge: True, expected a whole number from 1 on"),
        ({"merge": 10**400}, "merge: 1000.*, expected a whole number from 1 on"),
        ({"skip_bad": "no"}, "skip_bad: 'no', expected True or False"),
        ({"poses_topic": 5}, "poses_topic: 5, expected the name of a topic, or None"),
        ({"rate_hz": np.zeros((9, 9))}, r"rate_hz: array\(\[.*, expected a number above 0"),
        ({"origin": (47.3, 8.5, 480)}, r"origin: \(.*\), expected an unlidar.Origin\(...\)"),
    ],
)
def test_options_of_a_conversion_are_checked(values, said) -> None:
    with pytest.raises(unlidar.UsageError, match=f"^{said}$"):
        unlidar.ConvertOptions(**values)


@pytest.mark.parametrize(
    ("place", "said"),
    [
        ((91, 0, 0), "latitude_deg: 91, expected a number from -90 to 90"),
        ((47, 361, 0), "longitude_deg: 361, expected a number from -360 to 360"),
        ((47, 8, float("nan")), "height_m: nan, expected a number"),
        ((47, 8, 0, "north"), "heading_deg: 'north', expected a number"),
    ],
)
def test_an_origin_is_a_place(place, said) -> None:
    with pytest.raises(unlidar.UsageError, match=f"^{said}$"):
        unlidar.Origin(*place)


@pytest.mark.parametrize("path", [None, 5, b"flight.bag", "", "a\0b", ["flight.bag"], {}])
def test_what_is_no_path_is_refused_wherever_one_is_expected(path, tmp_path) -> None:
    file = tmp_path / "t.csv"
    for name, call in (
        ("recording", lambda: unlidar.read(path)),
        ("recording", lambda: unlidar.convert(path, tmp_path / "out")),
        ("out", lambda: unlidar.convert(tmp_path, path)),
        ("recording", lambda: unlidar.run(path, tmp_path / "out")),
        ("out", lambda: unlidar.run(tmp_path, path)),
        ("truth", lambda: unlidar.evaluate(path, file)),
        ("trajectory", lambda: unlidar.evaluate(file, [path])),
    ):
        with pytest.raises(unlidar.UsageError, match=f"^{name}: .*, expected a path$"):
            call()
    assert list(tmp_path.iterdir()) == []


def test_arguments_are_checked_before_the_work(tmp_path) -> None:
    def refused(said: str):
        return pytest.raises(unlidar.UsageError, match=said)

    for read in (unlidar.read, lambda *a, **k: unlidar.convert(*a, tmp_path / "out", **k)):
        with refused(r"options: \{'start_s': 1\}, expected unlidar.ConvertOptions\("):
            read(tmp_path, options={"start_s": 1})
        with refused(r"sensors: \['a', 'a'\], expected different names"):
            read(tmp_path, sensors=["a", "a"])
        with refused(r"sensors: \[\], expected different names"):
            read(tmp_path, sensors=[])
    with refused("force: 'no', expected True or False"):
        unlidar.convert(tmp_path, tmp_path / "out", force="no")
    with refused("report: 'no', expected True or False"):
        unlidar.run(tmp_path, tmp_path / "out", report="no")
    with refused("threads: 1.5, expected a whole number from 1 on"):
        unlidar.run(tmp_path, tmp_path / "out", threads=1.5)
    with refused("settings: .*, expected a text in UTF-8 without a NUL"):
        unlidar.run(tmp_path, tmp_path / "out", settings={"method": "robust\0"})
    with refused("trajectory: 5, expected a path"):
        unlidar.evaluate(tmp_path / "a.csv", 5)
    with refused("settings: 'method=paper', expected keys with values"):
        unlidar.run(tmp_path, tmp_path / "out", settings="method=paper")
    with refused("options: .*, expected unlidar.EvaluateOptions"):
        unlidar.evaluate(tmp_path / "a.csv", tmp_path / "b.csv", {"align": "se3"})
    with refused(r"trajectory: \[\], expected at least one file"):
        unlidar.evaluate(tmp_path / "a.csv", [])


def test_names_are_there_when_asked_for_and_cost_nothing_before() -> None:
    assert [name for name in unlidar.__all__ if not hasattr(unlidar, name)] == []
    with pytest.raises(AttributeError):
        _ = unlidar.nothing
    heavy = "[m for m in ('numpy', 'importlib.metadata') if m in sys.modules]"
    assert printed_by(f"import sys, unlidar; dir(unlidar); print({heavy})") == "[]\n"
    assert printed_by("from unlidar import *; print(track.__name__)") == "track\n"
    # A function keeps its name whatever module was imported before.
    before = "import unlidar.cli, unlidar.pipeline"
    shown = printed_by(f"{before}; from unlidar import convert, evaluate, run; print(run)")
    assert shown.startswith("<function run")


def test_figures_leave_the_backend_of_a_notebook_alone() -> None:
    drawn = "import unlidar.figure, unlidar.report.static, unlidar.compare.figure"
    chosen = "import matplotlib; matplotlib.use('svg')"
    assert printed_by(f"{chosen}; {drawn}; print(matplotlib.get_backend())") == "svg\n"


def printed_by(script: str) -> str:
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_package_says_that_it_is_typed() -> None:
    assert (Path(unlidar.__file__).parent / "py.typed").is_file()
    project = tomllib.loads((PROJECT / "pyproject.toml").read_text())
    packed = project["tool"]["setuptools"]["package-data"]["unlidar"]
    assert {"py.typed", "*.pyi"} <= set(packed)


def test_links_of_the_page_lead_to_files() -> None:
    links = re.findall(r"\]\(([^)#]+)\)", PAGE.read_text())
    assert links
    assert [link for link in links if not (PAGE.parent / link).exists()] == []


def test_the_former_name_of_the_package_gives_the_same_modules_and_warns() -> None:
    code = (
        "import warnings; warnings.simplefilter('error')\n"
        "try: import unlidar_tools\n"
        "except DeprecationWarning as warning: print(warning)\n"
        "warnings.simplefilter('ignore')\n"
        "import logging, unlidar_tools, unlidar\n"
        "from unlidar_tools.events.site import Site\n"
        "import unlidar.events.site as site\n"
        "assert Site is site.Site and site.__spec__.name == site.__name__\n"
        "assert unlidar_tools.run is unlidar.run and unlidar_tools.__all__ == unlidar.__all__\n"
        "assert logging.getLogger('unlidar_tools') is logging.getLogger('unlidar')\n"
        "try: import unlidar_tools.nothing\n"
        "except ModuleNotFoundError as error: print(error.name)\n"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert found.returncode == 0, found.stderr
    assert found.stdout.splitlines() == [
        "unlidar_tools is unlidar now: import unlidar",
        "unlidar.nothing",
    ]
