"""Configurations for data sets with properties that are not in their frames."""

from pathlib import Path

from unlidar.configs import CONFIG_DIR
from unlidar.errors import InputError
from unlidar.limits import load_yaml
from unlidar.record import read_object

MMAUD = CONFIG_DIR / "mmaud.yaml"
_HOLDS = "input.stamp"
_MMAUD_KIND, _MMAUD_TRUTH = "mmaud", "/leica/point/relative"  # of a folder, and of its bags
_PRISM = "a prism on the drone, a constant offset of about 0.57 m from the centre of the returns"


def preset_of(frames: Path, options: list[str]) -> Path | None:
    """The configuration for the converted recording `frames` unless `options` override it.

    That is MMAUD's for an MMAUD folder, unless a `--config` or the same key is among the options.
    """
    if "--config" in options or any(option.startswith(f"{_HOLDS}=") for option in options):
        return None
    return MMAUD if _conversion(frames).get("kind") == _MMAUD_KIND else None


def about_preset(name: str) -> str:
    """A line on the configuration of this name."""
    values = ", ".join(f"{key}={value}" for key, value in _mmaud_settings().items())
    return f"{name}, for MMAUD folders: {values}; --config or --set takes its place"


def preset_settings(recording: Path, kind: str) -> dict[str, object]:
    """Values of the same configuration by their keys, for a recording of this kind of source."""
    is_mmaud = _MMAUD_KIND in (kind, _conversion(recording).get("kind"))
    return _mmaud_settings() if is_mmaud else {}


def _mmaud_settings() -> dict[str, object]:
    return {
        f"{section}.{name}": value
        for section, values in load_yaml(MMAUD).items()
        for name, value in values.items()
    }


def about_truth(truth: Path) -> dict[str, str]:
    """Measures' entry on a truth whose reference point is known to differ from the returns'."""
    known = _conversion(truth.parent)
    is_prism = known.get("kind") == _MMAUD_KIND or _MMAUD_TRUTH in known.get("truth_topics", ())
    return {"truth_is": _PRISM} if is_prism else {}


def _conversion(frames: Path) -> dict:
    try:
        return read_object(frames / "conversion.json")
    except InputError:
        return {}  # frames from elsewhere
