"""Checks of what callers of the library hand over; those of the command line: cli/arguments.py."""

import math
import os
import reprlib
from collections.abc import Mapping, Sequence
from numbers import Integral, Real
from pathlib import Path
from typing import TypeVar

import numpy as np

from unlidar.errors import ConfigError, UsageError
from unlidar.pose_files import ALL

T = TypeVar("T")


def expect(holds: bool, name: str, value: object, expected: str) -> None:
    """Throws UsageError with name, value and expectation unless `holds`."""
    if not holds:
        told = " ".join(reprlib.repr(value).split())
        raise UsageError(f"{name}: {told}, expected {expected}")


def expect_bool(name: str, value: object) -> None:
    """Throws UsageError for all but True and False: "no" would be true."""
    expect(isinstance(value, (bool, np.bool_)), name, value, "True or False")


def expect_number(
    name: str, value: object, least: float = -math.inf, most: float = math.inf
) -> None:
    """Throws UsageError for all but a finite number from `least` to `most`."""
    told = "a number" if math.isinf(least) else f"a number from {least:g} on"
    told = told if math.isinf(most) else f"a number from {least:g} to {most:g}"
    expect(_is_number(value) and least <= value <= most, name, value, told)


def expect_positive(name: str, value: object) -> None:
    """Throws UsageError for all but a finite number above 0."""
    expect(_is_number(value) and value > 0, name, value, "a number above 0")


def expect_whole(name: str, value: object, least: int) -> None:
    """Throws UsageError for all but an integer from `least` on."""
    is_whole = _is_number(value) and isinstance(value, Integral) and value >= least
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


def path_of(name: str, value: object) -> Path:
    """A path that a caller gave; UsageError for anything else, and for '' (the current folder)."""
    expect(_is_path(value), name, value, "a path")
    return Path(value)


def config_path(config: str | os.PathLike[str] | None) -> str | None:
    """The path of a YAML file; None for none."""
    if config is None:
        return None
    if not (_is_path(config) and is_text(os.fspath(config))):
        raise ConfigError(f"config: {config!r}, expected the path of a YAML file")
    return os.fspath(config)


def pose_files_of(
    poses: str | os.PathLike[str] | Mapping[str, str | os.PathLike[str]] | None,
) -> dict[str, Path]:
    """The files of poses by the name of the sensor that they carry; ALL: of all others."""
    if poses is None:
        return {}
    named = {ALL: poses} if isinstance(poses, (str, os.PathLike)) else poses
    is_right = isinstance(named, Mapping) and all(
        isinstance(name, str) and _is_path(path) and is_text(os.fspath(path))
        for name, path in named.items()
    )
    expect(is_right, "poses", poses, "a TUM file, or one for each sensor by its name")
    return {name: Path(path) for name, path in named.items()}


def is_text(text: str) -> bool:
    """True if the program can take a text: it is UTF-8 without a NUL."""
    return "\0" not in text and text == text.encode(errors="replace").decode()


def _is_path(value: object) -> bool:
    path = os.fspath(value) if isinstance(value, (str, os.PathLike)) else ""
    return isinstance(path, str) and path != "" and "\0" not in path


def _is_number(value: object) -> bool:
    is_real = isinstance(value, Real) and not isinstance(value, bool)  # which is 0 or 1
    try:
        return is_real and math.isfinite(value)
    except OverflowError:  # a whole number beyond float
        return False
