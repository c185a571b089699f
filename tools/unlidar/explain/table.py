"""Output of `unlidar explain`: table of runs, meanings of stages, and shares."""

import math
from collections.abc import Iterable
from dataclasses import asdict

from rich import box
from rich.table import Table

from unlidar.explain import Explained
from unlidar.explain.stages import (
    Run,
    meaning_of,
    measured,
    shares_of,
)
from unlidar.sanitize import cell
from unlidar.stamps import format_stamp_ns

HEADS = ("from", "to", "seconds", "stage", "measured")


def runs_table(explained: Explained) -> Table:
    """A row for each run of seconds."""
    table = Table(
        title=cell(explained.target),
        box=box.SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
    )
    for name in HEADS:
        table.add_column(
            name,
            justify="right" if name == "seconds" else "left",
            no_wrap=name != "measured",
            overflow="fold",
        )
    for run in explained.runs:
        table.add_row(*map(cell, row_of(run)))
    return table


def row_of(run: Run) -> tuple[str, ...]:
    """The cells of a run below `HEADS`."""
    return (
        _stamp(run.begin_ns),
        _stamp(run.end_ns),
        str(run.seconds),
        run.stage,
        measured(run.evidence, run.stage),
    )


def meanings(explained: Iterable[Explained]) -> list[tuple[str, str]]:
    """Each stage that occurs, with its sentence, configuration keys and page."""
    stages = dict.fromkeys(run.stage for one in explained for run in one.runs)
    texts = []
    for stage in stages:
        meaning = meaning_of(stage)
        see = ", ".join((*meaning.keys, f"docs/{meaning.page}"))
        texts.append((stage, f"{meaning.sentence} See {see}"))
    return texts


def summary_line(explained: Explained) -> str:
    """The share of each stage in the seconds of a target."""
    seconds = sum(run.seconds for run in explained.runs)
    if not seconds:
        return f"{explained.target}: never in view while there are frames"
    shares = ", ".join(
        f"{stage} {100 * share:.1f} %" for stage, share in shares_of(explained.runs).items()
    )
    return f"{explained.target}: {seconds} s: {shares}"


def as_json(explained: Iterable[Explained]) -> dict:
    """The same as a JSON object; times are seconds, lengths metres."""
    return {
        "targets": [
            {
                "target": one.target,
                "seconds": sum(run.seconds for run in one.runs),
                "shares": {s: round(share, 4) for s, share in shares_of(one.runs).items()},
                "runs": [_run_json(run) for run in one.runs],
            }
            for one in explained
        ]
    }


def _run_json(run: Run) -> dict:
    meaning = meaning_of(run.stage)
    return {
        "from_s": run.begin_ns / 1e9,
        "to_s": run.end_ns / 1e9,
        "seconds": run.seconds,
        "stage": run.stage,
        "measured": measured(run.evidence, run.stage),
        "evidence": _evidence_json(run),
        "meaning": meaning.sentence,
        "keys": list(meaning.keys),
        "page": f"docs/{meaning.page}",
    }


def _evidence_json(run: Run) -> dict:
    values = asdict(run.evidence)
    path = values.pop("path")
    # Undefined extremes are infinite, which JSON cannot represent.
    known = {name: _rounded(value) for name, value in values.items() if math.isfinite(value)}
    return known | ({} if path is None else {"path": {k: _rounded(v) for k, v in path.items()}})


def _rounded(value: object) -> object:
    return round(value, 4) if isinstance(value, float) else value


def _stamp(stamp_ns: int) -> str:
    return format_stamp_ns(stamp_ns).rstrip("0").rstrip(".")
