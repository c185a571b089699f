"""Configurations for data sets of which something is known that their frames do not tell."""

import json
from pathlib import Path

from unlidar_tools.configs import CONFIG_DIR

MMAUD = CONFIG_DIR / "mmaud.yaml"
_HOLDS = "input.stamp"


def preset_of(frames: Path, options: list[str]) -> Path | None:
    """What the converted recording `frames` is tracked with unless `options` of the program differ.

    That is MMAUD's for an MMAUD folder, unless a `--config` or the same key is among the options.
    """
    if "--config" in options or any(option.startswith(f"{_HOLDS}=") for option in options):
        return None
    return MMAUD if _kind(frames) == "mmaud" else None


def _kind(frames: Path) -> str | None:
    try:
        return json.loads((frames / "conversion.json").read_text())["kind"]
    except (OSError, ValueError, KeyError, TypeError):
        return None  # frames from elsewhere
