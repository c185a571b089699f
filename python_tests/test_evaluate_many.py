"""Many sequences: groups, manifests, tables."""

import json
from pathlib import Path

import numpy as np
import pytest
from flights import track_at, truth_at, write_result
from unlidar.cli import main
from unlidar.evaluation import evaluate_files

TIMES = np.arange(0, 6, 0.1)


@pytest.fixture
def data_set(tmp_path) -> Path:
    """Two flights by day and one by night, off by 0.1, 0.3 and 0.6 m."""
    for name, error, times in (
        ("day/a", 0.1, TIMES),
        ("day/b", 0.3, np.arange(0, 12, 0.1)),
        ("night/a", 0.6, TIMES),
    ):
        write_result(tmp_path / name, truth_at(times), track_at(times, [error, 0, 0]))
    return tmp_path


def as_json(capsys, *arguments: object) -> dict:
    capsys.readouterr()
    assert main(["evaluate", *map(str, arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_in_a_group_every_stamp_of_every_flight_counts_once(data_set, capsys):
    groups = [f"--group={name}={data_set / name}" for name in ("day", "night")]
    result = as_json(capsys, *groups)
    assert list(result["groups"]) == ["day", "night", "all"]
    day = np.sqrt((60 * 0.1**2 + 120 * 0.3**2) / 180)
    assert result["groups"]["day"]["rmse"] == pytest.approx(day, abs=1e-4)
    assert result["groups"]["night"]["rmse"] == 0.6
    everything = np.sqrt((60 * 0.1**2 + 120 * 0.3**2 + 60 * 0.6**2) / 240)
    assert result["groups"]["all"]["rmse"] == pytest.approx(everything, abs=1e-4)
    assert (result["groups"]["all"]["tracks"], result["groups"]["all"]["rows"]) == (3, 240)


def test_each_sequence_has_the_measures_that_it_has_alone(data_set, capsys):
    result = as_json(capsys, data_set)
    assert [one["sequence"] for one in result["sequences"]] == ["day/a", "day/b", "night/a"]
    for one in result["sequences"]:
        folder = data_set / one["sequence"]
        alone = evaluate_files(folder / "ground_truth.csv", folder / "traj.csv")
        assert one == {"sequence": one["sequence"], "group": "", **alone}


def test_the_interval_of_a_group_knows_that_flights_differ(data_set, capsys):
    m = as_json(capsys, f"--group=day={data_set / 'day'}")["groups"]["day"]
    assert m["intervals"]["rmse"] == [0.1, 0.3]


@pytest.mark.parametrize("kind", ["csv", "json"])
def test_a_manifest_names_truth_trajectory_sequence_and_group(kind, data_set, capsys):
    rows = [
        {
            "sequence": f"flight {i}",
            "group": name.split("/")[0],
            "truth": f"{name}/ground_truth.csv",
            "trajectory": f"{name}/traj.csv",
        }
        for i, name in enumerate(("day/a", "night/a", "day/b"))
    ]
    manifest = data_set / f"flights.{kind}"
    if kind == "json":
        manifest.write_text(json.dumps(rows))
    else:
        lines = [",".join(rows[0]), *(",".join(row.values()) for row in rows)]
        manifest.write_text("\n".join(lines) + "\n")
    result = as_json(capsys, "--manifest", manifest)
    by_folder = as_json(capsys, *(f"--group={name}={data_set / name}" for name in ("day", "night")))
    for group in ("day", "night"):
        ours, theirs = result["groups"][group], by_folder["groups"][group]
        assert ours.pop("intervals").keys() == theirs.pop("intervals").keys()
        assert ours == theirs
    assert [one["sequence"] for one in result["sequences"]] == ["flight 0", "flight 1", "flight 2"]


def test_a_converted_recording_keeps_its_truth_with_its_frames(tmp_path, capsys):
    folder = write_result(tmp_path / "a", truth_at(TIMES), track_at(TIMES))
    (folder / "frames").mkdir()
    (folder / "ground_truth.csv").rename(folder / "frames" / "ground_truth.csv")
    assert as_json(capsys, folder)["sequences"][0]["sequence"] == "a"


def test_a_flight_without_a_drone_counts_only_its_false_rows(data_set, capsys):
    write_result(data_set / "sky/a", truth_at(np.zeros(0)), track_at(TIMES))
    groups = [f"--group={name}={data_set / name}" for name in ("day", "sky")]
    result = as_json(capsys, *groups)
    assert result["groups"]["sky"] == {"tracks": 1, "rows": 60, "false": 1.0}
    assert result["groups"]["all"]["rmse"] == result["groups"]["day"]["rmse"]
    assert result["groups"]["all"]["false"] == pytest.approx(60 / 240)
    for output in ([], ["--markdown"]):
        assert main(["evaluate", *groups, *output]) == 0


def test_the_markdown_table_has_a_row_for_each_sequence_each_group_and_all(data_set, capsys):
    groups = [f"--group={name}={data_set / name}" for name in ("day", "night")]
    assert main(["evaluate", *groups, "--markdown"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split("|")[1].strip() for line in lines[2:]] == [
        "day: a", "day: b", "night: a", "**day**", "**night**", "**all**",
    ]  # fmt: skip
    assert len({line.count("|") for line in lines}) == 1
    columns = [cell.strip() for cell in lines[0].split("|")]
    night = [cell.strip() for cell in lines[6].split("|")]
    assert night[columns.index("RMSE")] == night[columns.index("Dx")] == "0.600"
    assert night[columns.index("coverage")] == "100.0 %"


def test_the_table_shows_every_sequence_and_group(data_set, capsys):
    assert main(["evaluate", f"--group=day={data_set / 'day'}", f"--group=n={data_set}/night"]) == 0
    out = capsys.readouterr().out
    for said in ("day: a", "day: b", "n: a", "all", "0.600", "100.0 %"):
        assert said in out, said


def test_what_is_missing_is_named(data_set, tmp_path, fails):
    (data_set / "empty").mkdir()
    assert "holds no traj.csv" in fails(4, "evaluate", data_set / "empty")
    (data_set / "day/a/ground_truth.csv").unlink()
    line = fails(4, "evaluate", data_set)
    assert "day/a" in line
    assert "ground_truth.csv" in line
    assert "absent" in fails(4, "evaluate", "--group", f"x={data_set}/absent")
    fails(2, "evaluate", "--group", "nonsense")
    fails(2, "evaluate", "--group", f"all={data_set}")
    fails(2, "evaluate")
    for text, said in (
        ("", "it is empty"),
        ("truth,trajectory\n", "no sequence"),
        ("truth\nx\n", "no column trajectory"),
        ("truth,trajectory\nx.csv,y.csv\n", "x.csv"),
    ):
        (data_set / "m.csv").write_text(text)
        assert said in fails(4, "evaluate", "--manifest", data_set / "m.csv")
    (data_set / "m.json").write_text("[3]")
    assert "entry 1" in fails(4, "evaluate", "--manifest", data_set / "m.json")
    (data_set / "m.json").write_text("{")
    assert "m.json" in fails(4, "evaluate", "--manifest", data_set / "m.json")
    files = (data_set / "day/b/ground_truth.csv", data_set / "day/b/traj.csv")
    fails(2, "evaluate", *files, "--group", f"x={data_set / 'day/b'}")
    assert "second sequence" in fails(4, "evaluate", data_set / "day/b", data_set / "day/b")
