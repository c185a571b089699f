"""Laws of `unlidar explain`: of seconds, runs and evidence, of stages and their page."""

from __future__ import annotations

import copy
import itertools
import re

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from rejections import rejections
from ruamel.yaml import YAML
from synthetic import PROJECT
from traced_run import BEGIN_NS, SECOND_NS
from unlidar.explain.evidence import Collector, Evidence, PathThere
from unlidar.explain.stages import GATES, MEANINGS, RULES, runs_of, shares_of, stage_of
from unlidar.explain.targets import Reach, targets_of
from unlidar.mounting import Mounting
from unlidar.truth import Tracks, Truth

COUNTS = st.integers(0, 3)
PATHS = st.none() | st.builds(
    PathThere,
    detections=st.integers(1, 9),
    log_likelihood_ratio=st.floats(-50, 50),
    crowding_penalty=st.floats(0, 50),
    threshold=st.floats(10, 20),
    rejection=st.none() | st.sampled_from(["below_threshold", *GATES]),
)
EVIDENCE = st.builds(
    Evidence, frames=COUNTS, returns=COUNTS, bodies=COUNTS, detections=COUNTS, rows_near=COUNTS,
    path=PATHS,
)  # fmt: skip
UNSEARCHED = st.builds(lambda n: Evidence(detections=n, unsearched=n), st.integers(1, 3))
ORDER = (
    "no", "structure", "body", "unsearched", "detection", "path", "gate", "track", "found",
)  # fmt: skip


def rank(evidence: Evidence) -> int:
    return ORDER.index(stage_of(evidence).split()[0])


@given(st.dictionaries(st.integers(0, 40), EVIDENCE))
def test_every_second_is_of_exactly_one_run_and_neighbours_differ(by_second) -> None:
    found = {BEGIN_NS + k * SECOND_NS: evidence for k, evidence in by_second.items()}
    runs = runs_of(copy.deepcopy(found))
    told = {
        begin_ns: run.stage
        for run in runs
        for begin_ns in range(run.begin_ns, run.end_ns, SECOND_NS)
    }
    assert sum(run.seconds for run in runs) == len(told) == len(found)
    assert told == {begin_ns: stage_of(evidence) for begin_ns, evidence in found.items()}
    for run, later in itertools.pairwise(runs):
        assert run.end_ns < later.begin_ns or run.stage != later.stage
    assert sum(run.evidence.returns for run in runs) == sum(e.returns for e in found.values())
    assert not runs or sum(shares_of(runs).values()) == pytest.approx(1)


def with_path(score: float, rejection: str | None) -> Evidence:
    return Evidence(path=PathThere(3, score, 0.0, 16.0, rejection))


@given(EVIDENCE | UNSEARCHED, EVIDENCE | UNSEARCHED)
@example(with_path(30.0, "below_threshold"), with_path(20.0, "crowded"))
@example(with_path(30.0, "crowded"), with_path(20.0, None))
def test_more_evidence_never_loses_a_target_earlier(one, other) -> None:
    both = copy.deepcopy(one)
    both.add(other)
    assert rank(both) == max(rank(one), rank(other))


@given(st.lists(st.tuples(*[st.floats(-80, 80)] * 3), min_size=2, max_size=20), st.floats(0, 9))
def test_a_second_is_found_exactly_where_the_trajectory_is_at_the_truth(places, off_m) -> None:
    time_ns = np.array([BEGIN_NS + k * SECOND_NS // 2 for k in range(len(places))])
    at_m = np.array(places)
    truth = Truth(time_ns * 1e-9, np.zeros(len(at_m)), at_m, np.ones(len(at_m), dtype=bool))
    collector = Collector(targets_of(truth), {}, Reach([Mounting()], 4.5))
    above_m = at_m + np.array([0.0, 0.0, off_m])
    tracks = Tracks(time_ns * 1e-9, np.zeros(len(at_m)), above_m, stamp_ns=time_ns)
    collector.add_rows(tracks)
    told = {stage_of(evidence) for evidence in collector.found[0].values()}
    assert len(collector.found[0]) >= len(places) // 2
    if abs(off_m - 4.5) > 1e-3:
        assert told == {"found" if off_m < 4.5 else "no return"}


def test_every_meaning_names_keys_and_pages_that_are_there() -> None:
    default = YAML(typ="safe").load(PROJECT / "configs/default.yaml")
    for meaning in (*MEANINGS.values(), *GATES.values()):
        for key in meaning.keys:
            value = default
            for part in key.split("."):
                assert part in value, key
                value = value[part]
        page, _, anchor = meaning.page.partition("#")
        text = (PROJECT / "docs" / page).read_text()
        heads = {
            re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-")
            for head in re.findall(r"^#+ (.*)$", text, re.MULTILINE)
        }
        assert not anchor or anchor in heads, meaning.page


def rows_of(section: str) -> list[list[str]]:
    """The cells of a table of docs/explain.md whose rows begin with a name."""
    page = (PROJECT / "docs/explain.md").read_text().partition(f"## {section}\n")[2]
    page = page.partition("\n## ")[0]
    return [line[2:-2].split(" | ") for line in page.splitlines() if line.startswith("| `")]


def test_every_stage_and_every_rule_has_a_row_on_the_page() -> None:
    assert {row[0].strip("`") for row in rows_of("Stages")} == {*MEANINGS, "gate NAME"}
    assert {row[0].strip("`") for row in rows_of("Gates")} == rejections()


def test_every_rule_of_the_program_has_a_meaning_or_its_stage() -> None:
    assert {*RULES, *GATES} == rejections() and not {*RULES} & {*GATES}
    assert {*RULES.values()} <= {*MEANINGS}


def test_every_rule_that_is_disabled_by_name_is_on_the_page() -> None:
    keys = (PROJECT / "src/config/config_keys.hpp").read_text()
    names = set(re.findall(r'\{"(\w+)", Rule::', keys))
    of_motion = set(re.findall(r'\{"(\w+)", MotionRule::', keys))
    page = (PROJECT / "docs/explain.md").read_text()
    of_gates = {rule for row in rows_of("Gates") for rule in re.findall(r"rule `(\w+)`", row[-1])}
    others = set(re.findall(r"^- `(\w+)`:", page, re.MULTILINE))
    assert of_gates | others == names | of_motion
    spelled_out = YAML(typ="safe").load(PROJECT / "configs/default.yaml")["robust"]
    assert spelled_out["disabled_rules"] == []
    text = (PROJECT / "configs/default.yaml").read_text()
    listed = re.search(r"# Rules that are not applied.*?\n  disabled_rules", text, re.DOTALL)
    assert listed is not None
    assert names <= set(re.findall(r"\w+", listed[0]))
    listed = re.search(r"# Parts of the model of motion.*?\n  disabled_rules", text, re.DOTALL)
    assert listed is not None
    assert of_motion <= set(re.findall(r"\w+", listed[0]))
