"""Paths of the bundled configurations and scenarios."""

from pathlib import Path

_INSTALLED = Path(__file__).parent / "configs"  # of a wheel, by setup.py
CONFIG_DIR = _INSTALLED if _INSTALLED.is_dir() else Path(__file__).parents[2] / "configs"
SCENARIO_DIR = CONFIG_DIR / "scenarios"


def scenario_names() -> list[str]:
    return sorted(path.stem for path in SCENARIO_DIR.glob("*.yaml"))
