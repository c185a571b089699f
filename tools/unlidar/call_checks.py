"""Checks of what callers of the library hand over; those of the command line: cli/arguments.py."""

import math
import os
import reprlib
from collections.abc import Mapping, Sequence
from numbers import Integral, Real
from pathlib import Path
from typing import TypeVar

from unlidar.errors import ConfigError, UsageError
from unlidar.pose_files import ALL

T = TypeVar("T")


def expect(holds: bool, name: str, value: object, expected: str) -> None:
    """Throws UsageError with name, value and expectation unless `holds`."""
    if not holds:
        told = " ".join(reprlib.repr(value).split())
        raise UsageError(f"{name}: {told}, expected {expected}")


def expect_number(name: str, value: object, least: float = -math.inf) -> None:
    """Throws UsageError for all but a finite number from `least` on."""
    told = "a number" if math.isinf(least) else f"a number from {least:g} on"
    is_right = isinstance(value, Real) and math.isfinite(value) and value >= least
    expect(is_right, name, value, told)


def expect_positive(name: str, value: object) -> None:
    """Throws UsageError for all but a finite number above 0."""
    is_right = isinstance(value, Real) and math.isfinite(value) and value > 0
    expect(is_right, name, value, "a number above 0")


def expect_whole(name: str, value: object, least: int) -> None:
    """Throws UsageError for all but an integer from `least` on."""
    is_whole = isinstance(value, Integral) and value >= least
    expect(is_whole, name, value, f"a whole number from {least} on")


def expect_names(name: str, value: object) -> None:
    """Throws UsageError for all but a sequence of texts: a lone text is one of letters."""
    is_list = isinstance(value, Sequence) and not isinstance(value, (str, bytes))
    expect(is_list and all(isinstance(n, str) for n in value), name, value, "a list of names")


def chosen_sensors(sensors: Sequence[str] | None) -> list[str] | None:
    """The names that a caller chose; None for all."""
    if sensors is None:
        return None
    expect_names("sensors", sensors)
    expect(0 < len(set(sensors)) == len(sensors), "sensors", sensors, "different names, or None")
    return list(sensors)


def options_of(kind: type[T], name: str, options: T | None) -> T:
    """Those that a caller gave, by default those of `kind`, which has the public `name`."""
    expect(options is None or isinstance(options, kind), "options", options, f"unlidar.{name}(...)")
    return kind() if options is None else options


def settings_of(settings: Mapping[str, object] | None) -> dict[str, object]:
    """Keys of the program's configuration with their values."""
    is_mapping = settings is None or isinstance(settings, Mapping)
    expect(is_mapping, "settings", settings, "keys with values, as {'live.delay_s': 0.5}")
    return dict(settings or {})


def config_path(config: str | os.PathLike[str] | None) -> str | None:
    """The path of a YAML file; None for none."""
    if config is None:
        return None
    path = os.fspath(config)
    if not isinstance(path, str) or not path or "\0" in path:
        raise ConfigError(f"config: {path!r}, expected the path of a YAML file")
    return path


def pose_files_of(
    poses: str | os.PathLike[str] | Mapping[str, str | os.PathLike[str]] | None,
) -> dict[str, Path]:
    """The files of poses by the name of the sensor that they carry; ALL: of all others."""
    if poses is None:
        return {}
    named = {ALL: poses} if isinstance(poses, (str, os.PathLike)) else poses
    is_right = isinstance(named, Mapping) and all(
        isinstance(name, str) and isinstance(path, (str, os.PathLike)) and os.fspath(path)
        for name, path in named.items()
    )
    expect(is_right, "poses", poses, "a TUM file, or one for each sensor by its name")
    return {name: Path(path) for name, path in named.items()}
