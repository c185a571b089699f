"""Input that `unlidar explain` rejects: questions, folders, and lines that are no trace."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from synthetic import seconds
from traced_run import BEGIN_NS, SECOND_NS
from unlidar import explain as package
from unlidar.errors import InputError
from unlidar.record import EXPLANATION
from unlidar.report.explanation import read_explanation


def test_without_truth_and_without_a_place_nothing_can_be_reported(traced, fails) -> None:
    run = traced(truth=None)
    run.second(0)
    assert "--at T --near X,Y,Z" in fails(2, "explain", run.write())
    run.truth = []
    assert "has no target" in fails(2, "explain", run.write())


def test_a_truth_that_is_gone_is_named(traced, fails) -> None:
    run = traced()
    run.every_stage()
    folder = run.write()
    (folder / "ground_truth.csv").unlink()
    assert "ground_truth.csv" in fails(4, "explain", folder)


def test_an_instant_without_frames_is_reported_with_those_that_there_are(traced, fails) -> None:
    run = traced()
    run.every_stage()
    said = fails(2, "explain", run.write(), "--at", 17)
    assert "--at 17.0" in said and str(BEGIN_NS // SECOND_NS) in said


def test_only_runs_of_the_robust_method_have_stages(traced, fails) -> None:
    run = traced(method="paper")
    run.every_stage()
    assert "method paper" in fails(2, "explain", run.write())


@pytest.mark.parametrize(
    "options",
    [["--at", "noon"], ["--near", "1,2"], ["--near", "1,2,nan"], ["--radius", "0"],
     ["--radius", "inf"], ["--at", "1e300"], ["--at", "9223372036.8"],
     ["--near", "1,2,1e300"]],
    ids=" ".join,
)  # fmt: skip
def test_a_wrong_value_is_a_usage_error(options, fails) -> None:
    assert options[0] in fails(2, "explain", "run", *options)


def test_a_folder_that_no_run_wrote_is_refused(tmp_path, fails) -> None:
    assert "unlidar run" in fails(4, "explain", tmp_path)


def hostile_lines() -> dict[str, str]:
    frame = {
        "trace": "frame", "sensor": "lidar", "stamp": seconds(BEGIN_NS),
        "middle": seconds(BEGIN_NS), "returns": 1, "bodies": [], "detections": [],
    }  # fmt: skip
    path = {
        "trace": "path", "first": seconds(BEGIN_NS), "last": seconds(BEGIN_NS), "threshold": 1.0,
        "log_likelihood_ratio": 1.0, "crowding_penalty": 0.0, "rejection": None, "detections": [],
    }  # fmt: skip
    return {
        "empty": "",
        "no JSON": "frame",
        "no object": "[]",
        "cut": json.dumps(frame)[:-4],
        "deep": "[" * 100_000,
        "unknown kind": json.dumps(frame | {"trace": "\x1b[31m"}),
        "no kind": "{}",
        "second header": json.dumps(
            {"trace": "header", "version": "1", "method": "robust", "sensors": []}
        ),
        "other sensor": json.dumps(frame | {"sensor": "avia"}),
        "unknown frame": json.dumps(frame | {"stamp": "12.5"}),
        "stamp a number": json.dumps(frame | {"stamp": 1.5}),
        "stamp no number": json.dumps(frame | {"middle": "x" * 1000}),
        "stamp of 2250": json.dumps(frame | {"stamp": "8836000000.0"}),
        "stamp too large": json.dumps(frame | {"stamp": "1e99"}),
        "negative count": json.dumps(frame | {"returns": -1}),
        "body of two": json.dumps(frame | {"bodies": [[1, 2]]}),
        "body at infinity": json.dumps(frame | {"bodies": [[1, 2, 3]]}).replace("3]", "1e999]"),
        "body below": json.dumps(frame | {"bodies": [[1, 2, 3]]}).replace("3]", "-1e999]"),
        "body nowhere": json.dumps(frame | {"bodies": [[1, 2, float("nan")]]}),
        "missing": json.dumps({k: v for k, v in frame.items() if k != "detections"}),
        "score a text": json.dumps(path | {"log_likelihood_ratio": "high"}),
        "threshold NaN": json.dumps(path | {"threshold": float("nan")}),
        "strange rule": json.dumps(path | {"rejection": "\x1b[31m"}),
        "detection of three": json.dumps(path | {"detections": [[seconds(BEGIN_NS), 1, 2]]}),
    }


@pytest.mark.parametrize("line", hostile_lines().values(), ids=list(hostile_lines()))
def test_a_line_that_is_no_trace_is_refused_by_its_number(line, traced, fails, monkeypatch) -> None:
    run = traced()
    run.second(0, returns=True)
    run.add_truth(1)

    def program(*arguments):
        outcome = run.program(*arguments)
        trace = Path(arguments[2][arguments[2].index("--trace") + 1])
        trace.write_text(trace.read_text() + line + "\n")
        return outcome

    monkeypatch.setattr(package, "run_program", program)
    said = fails(4, "explain", run.write())
    assert "trace.jsonl:6:" in said or "no frame has the stamp" in said
    assert "\x1b" not in said and len(said) < 300


@pytest.mark.parametrize("keep", [0, 1], ids=["empty", "without a header"])
def test_a_trace_without_its_header_is_refused(keep, traced, fails) -> None:
    run = traced()
    run.second(0)
    run.add_truth(1)
    run.lines = run.lines[1 : 1 + keep]
    assert "trace" in fails(4, "explain", run.write())


def test_a_line_that_never_ends_is_refused(traced, fails, monkeypatch) -> None:
    from unlidar.explain import trace

    monkeypatch.setattr(trace, "MOST_TRACE_LINE", 100)
    run = traced()
    run.second(0)
    run.add_truth(1)
    assert "more than 100 characters" in fails(4, "explain", run.write())


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"targets": [{"target": 1}]}'])
def test_an_explanation_that_is_none_is_refused(text, tmp_path) -> None:
    (tmp_path / EXPLANATION).write_text(text)
    with pytest.raises(InputError, match=EXPLANATION):
        read_explanation(tmp_path)
