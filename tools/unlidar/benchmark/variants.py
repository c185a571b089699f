"""The variants run on each scene: methods by name or file, and changes of one of them."""

from dataclasses import dataclass
from pathlib import Path

from ruamel.yaml import YAMLError

from unlidar.configs import CONFIG_DIR
from unlidar.errors import ConfigError, UsageError, reason
from unlidar.limits import load_yaml

ROBUST = "robust"
_PAPER = ("paper", "paper_best")
_ABLATION = CONFIG_DIR / "ablation.yaml"


@dataclass(frozen=True)
class Variant:
    """A configuration of the program under a name."""

    name: str
    config: Path | None = None  # its own defaults if None
    assignments: tuple[str, ...] = ()  # key=value, after the file
    base: str | None = None  # the variant that it is compared with

    @property
    def options(self) -> list[str]:
        """The variant as options of the program."""
        options = ["--config", str(self.config.resolve())] if self.config else []
        for assignment in self.assignments:
            options += ["--set", assignment]
        return options


def methods(text: str) -> list[Variant]:
    """Comma-separated methods: `robust`, a bundled configuration, or a YAML file."""
    found = [_method(name.strip()) for name in text.split(",") if name.strip()]
    if not found or len({v.name for v in found}) != len(found):
        raise UsageError(f"--methods {text}: expected different methods")
    return found


def variant(text: str, base: Variant) -> Variant:
    """`NAME=key=value,...`: the base with these keys changed. Commas in [] separate nothing."""
    name, separator, rest = text.partition("=")
    assignments = _split(rest)
    if not separator or not name or not all("=" in a.strip("=") for a in assignments):
        raise UsageError(f"--variant {text}: expected NAME=key=value,key=value...")
    return _changed(base, name, assignments)


def ablation(base: Variant) -> list[Variant]:
    """The pieces of evidence of the robust method, each switched off."""
    try:
        known = load_yaml(_ABLATION)
        return [
            _changed(base, name, [f"{key}={value}" for key, value in keys.items()])
            for name, keys in known.items()
        ]
    except (OSError, ValueError, AttributeError, RecursionError, YAMLError) as error:
        raise ConfigError(f"{_ABLATION}: expected names with keys: {reason(error)}") from error


def _changed(base: Variant, name: str, assignments: list[str]) -> Variant:
    return Variant(name, base.config, (*base.assignments, *assignments), base.name)


def _method(name: str) -> Variant:
    if name == ROBUST:
        return Variant(name)
    path = Path(name)
    if path.suffix in (".yaml", ".yml"):
        if not path.is_file():
            raise UsageError(f"--methods {name}: no such file")
        return Variant(path.stem, path)
    if name not in _PAPER:
        raise UsageError(
            f"--methods {name}: expected a .yaml file or one of {', '.join([ROBUST, *_PAPER])}"
        )
    return Variant(name, CONFIG_DIR / f"{name}.yaml")


def _split(text: str) -> list[str]:
    parts, depth = [""], 0
    for character in text:
        depth += {"[": 1, "]": -1}.get(character, 0)
        if character == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += character
    return parts
