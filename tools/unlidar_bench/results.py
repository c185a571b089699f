"""Results of scenes, one for each scene, weather, mode and switched off rule: files and tables.

A result is a dict with the four names of `IDENTITY`, the values of `MEASURES`, and whatever else
`unlidar evaluate` says of the tracks.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from unlidar.csv_rows import numbered_lines
from unlidar.errors import InputError
from unlidar.evaluation import WITHIN_M, Comparison

from unlidar_bench.paired import mean_of_known
from unlidar_bench.tables import Column, cell, digits, markdown, percent

MODES = ("recording", "stream")
IDENTITY = ("scene", "weather", "mode", "without")
_OF_MEANS = ("weather", "without", "mode")
_JUDGED = (
    Column("within 1 m", "within1m", percent),
    Column("false rows", "false", percent),
    Column("RMSE, m", "rmse", "{:.3f}".format),
    Column("tracks", "tracks", "{:.4g}".format),
)
# Measures of a result; `once_live` is within1m from the first right row of the stream on.
MEASURES = (
    *_JUDGED,
    Column("coverage", "coverage", percent),
    Column("told", "told", percent),
    Column("once live", "once_live", percent),
    Column("NEES", "nees", "{:.2f}".format),
    Column("blinded, s", "blinded_s", "{:.0f}".format),
    Column("CPU, s", "cpu_s", digits),
    Column("MB", "memory_mb", "{:.0f}".format),
)
# Sums over the scenes in which nobody flies.
_EMPTY = (
    Column("nobody flies", "empty", "{:.0f}".format),
    Column("with a track", "alarmed", "{:.0f}".format),
    Column("their tracks", "empty_tracks", "{:.0f}".format),
    Column("rows", "empty_rows", "{:.0f}".format),
)
_SUMMARY = (Column("flights", "flights", "{:.0f}".format), *MEASURES, *_EMPTY)


def once_live(comparisons: Mapping[str, Comparison]) -> dict[str, float]:
    """By mode, the share within 1 m of the truth that is in view once a stream has found its drone.

    A target counts from the first instant on at which the stream has an estimate within 1 m of it.
    Empty without such a one. All modes are compared with the same truth.
    """
    stream = comparisons["stream"]
    right = stream.seen & (stream.nearest.distance_m < WITHIN_M)
    judged = np.zeros(len(right), dtype=bool)
    for target in np.unique(stream.target[right]):
        mine = stream.target == target
        judged |= stream.seen & mine & (stream.time_s >= stream.time_s[right & mine][0])
    if not judged.any():
        return {}
    return {
        mode: round(float((one.nearest.distance_m[judged] < WITHIN_M).mean()), 4)
        for mode, one in comparisons.items()
    }


def read_results(path: Path) -> list[dict]:
    """The results of a file with one JSON object a line. InputError for any other file."""
    results: dict[tuple[str, ...], dict] = {}
    for line, text in numbered_lines(path):
        try:
            result = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise InputError(f"{path}:{line}: is no JSON, expected a result a line") from error
        if not isinstance(result, dict):
            raise InputError(f"{path}:{line}: is '{text[:40].strip()}', expected a JSON object")
        for key in IDENTITY:
            if not isinstance(result.get(key), str):
                raise InputError(f"{path}:{line}: {key} is {result.get(key)!r}, expected a text")
        for key in ("rows", *(column.key for column in MEASURES)):
            value = result.get(key)
            is_absent = value is None and key not in ("tracks", "rows")
            is_number = isinstance(value, int | float) and not isinstance(value, bool)
            if not is_absent and not is_number:
                raise InputError(f"{path}:{line}: {key} is {value!r:.40}, expected a number")
        if _key(result) in results:
            raise InputError(f"{path}:{line}: {name_of(result)} comes again, expected one result")
        results[_key(result)] = result
    return list(results.values())


def name_of(result: dict) -> str:
    """Scene, weather and mode, and the rule that is switched off, if one is."""
    rule = f" without {result['without']}" if result["without"] else ""
    return f"{result['scene']}, {result['weather']}, {result['mode']}{rule}"


def line_of(result: dict) -> str:
    """Name and values of a result."""
    values = (f"{column.title} {cell(column, result)}" for column in MEASURES)
    return f"{name_of(result)}: {', '.join(values)}"


def report(results: Sequence[dict]) -> str:
    """Tables by scene, with the modes side by side, and of the means, and how the modes differ."""
    modes = dict.fromkeys(one["mode"] for one in results)
    scenes = _grouped(results, ("scene", "weather", "without"))
    parts = [
        f"Values: {', '.join(modes)}; one where all are the same.\n",
        _table(("scene", "weather", "without"), MEASURES, scenes, ", "),
    ]
    if len({one["scene"] for one in results}) > 1:
        parts.append(_table(_OF_MEANS, _SUMMARY, [[mean] for mean in _means(results)], ""))
    return "\n".join(parts + _distances(results))


def report_changes(before: Sequence[dict], after: Sequence[dict], name: str) -> str:
    """Differences from the results before, which are those of the file of this name."""
    earlier, later = ({_key(one): one for one in results} for results in (before, after))
    pairs = [(earlier[key], one) for key, one in later.items() if key in earlier]
    different = [
        (old, new)
        for old, new in pairs
        if any(cell(column, old) != cell(column, new) for column in _JUDGED)
    ]
    parts = [
        f"Compared with {name}: {len(different)} of {len(pairs)} results differ, "
        f"{len(pairs) - len(different)} are the same to the digits shown.\n"
    ]
    if different:
        parts.append(_table(IDENTITY, _JUDGED, different, " -> "))
    if pairs:
        means = zip(*(_means(side) for side in zip(*pairs, strict=True)), strict=True)
        parts.append(_table(_OF_MEANS, _SUMMARY, list(means), " -> "))
    for these, others, where in ((earlier, later, "these"), (later, earlier, name)):
        lacking = [name_of(one) for key, one in these.items() if key not in others]
        if lacking:
            parts.append(f"Not among {where}: {'; '.join(lacking)}.\n")
    return "\n".join(parts)


def _key(result: dict) -> tuple[str, ...]:
    return tuple(result[key] for key in IDENTITY)


def _grouped(results: Sequence[dict], names: Sequence[str]) -> list[list[dict]]:
    """Those of the same names together, in the order in which they first come."""
    groups: dict[tuple[str, ...], list[dict]] = {}
    for one in results:
        groups.setdefault(tuple(one[name] for name in names), []).append(one)
    return list(groups.values())


def _flies(result: dict) -> bool:
    """False where the truth is empty: every row is false then."""
    return "drones" in result


def _means(results: Sequence[dict]) -> list[dict]:
    """For each weather, rule and mode: means over the flights, sums where nobody flies."""
    means = []
    for group in _grouped(results, _OF_MEANS):
        flights = [one for one in group if _flies(one)]
        empty = [one for one in group if not _flies(one)]
        mean = {name: group[0][name] for name in _OF_MEANS} | {"flights": len(flights)}
        for key in (column.key for column in MEASURES):
            mean[key] = mean_of_known([one.get(key) for one in flights])
        if empty:
            mean |= {
                "empty": len(empty),
                "alarmed": sum(one["tracks"] > 0 for one in empty),
                "empty_tracks": sum(one["tracks"] for one in empty),
                "empty_rows": sum(one["rows"] for one in empty),
            }
        means.append(mean)
    return means


def _distances(results: Sequence[dict]) -> list[str]:
    """How much more of the truth recordings have within 1 m than streams: a line a weather."""
    lines = []
    for group in _grouped(results, ("weather", "without")):
        said = []
        for key, since in (
            ("within1m", "all in all"),
            ("once_live", "from the first right row of the stream on"),
        ):
            known = [
                {one["mode"]: one[key] for one in scene if one.get(key) is not None}
                for scene in _grouped(group, ("scene",))
            ]
            more = [one["recording"] - one["stream"] for one in known if len(one) == len(MODES)]
            if more:
                said.append(f"{100 * np.mean(more):.2f} points {since} (mean of {len(more)})")
        if said:
            rule = f" without {group[0]['without']}" if group[0]["without"] else ""
            lines.append(
                f"Within 1 m, recording minus stream, {group[0]['weather']}{rule}: "
                f"{', '.join(said)}.\n"
            )
    return lines


def _table(
    names: Sequence[str],
    columns: Sequence[Column],
    groups: Sequence[Sequence[dict]],
    separator: str,
) -> str:
    """A line for each group of rows, whose values stand side by side."""
    lines = [
        {name: rows[0][name] for name in names}
        | {column.key: _side_by_side(column, rows, separator) for column in columns}
        for rows in groups
    ]
    heads = [Column(name, name) for name in names]
    return markdown([*heads, *(Column(c.title, c.key, "{}".format) for c in columns)], lines)


def _side_by_side(column: Column, rows: Sequence[dict], separator: str) -> str:
    """The texts of a value of several rows; one where all are the same."""
    texts = [cell(column, row) for row in rows]
    return texts[0] if len(set(texts)) == 1 else separator.join(texts)
