"""The config as users meet it: default.yaml, --config, --set and what --summary says of them."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from synthetic import PROJECT, make_flight, run_program, track, write_frames

DEFAULT_YAML = PROJECT / "configs" / "default.yaml"
SECTION = re.compile(r"^( *)(\w+):\s*(?:\{\}\s*)?(?:#.*)?$")
KEY = re.compile(r"^( *)(\w+): +(\[[^]]*\]|[^#\s]+) *(# .+)?$")


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("config")
    return write_frames(folder / "frames", make_flight(frames=5))


def effective_config(frames: Path, folder: Path, *arguments: object) -> dict[str, Any]:
    summary = folder / "summary.json"
    track(frames, folder / "traj.csv", "--summary", summary, *arguments)
    return json.loads(summary.read_text())["config"]


def flatten(node: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in node.items():
        if isinstance(value, dict):
            flat |= flatten(value, f"{prefix}{key}.")
        else:
            flat[prefix + key] = value
    return flat


def documented_keys() -> dict[str, tuple[str, str]]:
    """Dotted key -> (value, remark) of default.yaml, read without a YAML parser."""
    keys: dict[str, tuple[str, str]] = {}
    path: list[str] = []
    for line in DEFAULT_YAML.read_text().splitlines():
        if line.lstrip().startswith("#") or not line.strip():
            continue
        key, section = KEY.match(line), SECTION.match(line)
        match = section or key
        assert match, f"neither a section nor `key: value  # remark`: {line}"
        path = [*path[: len(match[1]) // 2], match[2]]
        if not section:
            keys[".".join(path)] = (match[3], match[4] or "")
    return keys


def as_text(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def test_default_yaml_is_the_effective_config_without_any_option(
    frames: Path, tmp_path: Path
) -> None:
    effective = flatten(effective_config(frames, tmp_path))
    documented = {key: value for key, (value, _) in documented_keys().items()}
    assert list(documented) == list(effective)
    for key, value in effective.items():
        if isinstance(value, float | list):
            assert json.loads(documented[key]) == value, key
        else:
            assert documented[key] == as_text(value), key


def test_default_yaml_says_of_each_key_what_it_may_be() -> None:
    for key, (value, remark) in documented_keys().items():
        assert value in ("true", "false") or " to " in remark or " | " in remark, key


@pytest.mark.parametrize("bound", [0, 1])
def test_the_documented_bounds_are_the_bounds(frames: Path, tmp_path: Path, bound: int) -> None:
    for key, (value, remark) in documented_keys().items():
        bounds = re.search(r"(above )?([\d.e+-]+) to ([\d.e+-]+)", remark)
        if bounds is None:
            continue
        limit = float(bounds[2 + bound])
        beyond = limit * 1.5 + 1 if bound else limit - 1
        if bounds[1] and not bound:
            beyond = limit  # "above" leaves the bound itself out
        text = f"{beyond:.0f}" if beyond == int(beyond) else repr(beyond)
        text = f"[{text}]" if value.startswith("[") else text
        out = tmp_path / "traj.csv"
        result = run_program("--frames", frames, "--out", out, "--set", f"{key}={text}")
        assert result.returncode == 3, f"{key}={text}"
        assert key in result.stderr and text in result.stderr


def test_the_summary_holds_what_was_set_and_can_be_used_as_config(
    frames: Path, tmp_path: Path
) -> None:
    settings = ["method=paper", "input.min_range_m=0.25", "paper.window_frames=3"]
    settings += ["sensors.a.translation_m=[1, 2, 3]", "sensors.a.rotation=[0, 0, 1, 0]"]
    arguments = [part for setting in settings for part in ("--set", setting)]
    first = effective_config(frames, tmp_path, *arguments)
    assert first["method"] == "paper"
    assert first["input"]["min_range_m"] == 0.25
    assert first["paper"]["window_frames"] == 3
    assert first["sensors"] == {
        "a": {
            "translation_m": [1, 2, 3],
            "rotation": [0, 0, 1, 0],
            "time_offset_s": 0,
            "frame_rate_hz": 0,
        }
    }
    config = tmp_path / "again.yaml"
    config.write_text(json.dumps(first))  # JSON is YAML
    assert effective_config(frames, tmp_path, "--config", config) == first
