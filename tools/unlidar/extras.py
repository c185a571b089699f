"""Optional packages that only some commands need."""

import shlex
import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.util import find_spec
from types import ModuleType

from unlidar.errors import UsageError

_STATION = {
    "paho": "paho-mqtt",
    "sapient_msg": "sapient-proto",
    "shapely": "shapely",
    "starlette": "starlette",
    "uvicorn": "uvicorn",
    "websockets": "websockets",
}


def need_station(command: str, modules: Sequence[str]) -> None:
    """UsageError naming the packages of the extra `station` that are missing."""
    missing = [_STATION[name] for name in modules if find_spec(name) is None]
    if missing:
        raise UsageError(_advised(f"{command}: not installed: {', '.join(missing)}", "station"))


def load_extra(module: str, extra: str, missing: str) -> ModuleType:
    """The module; UsageError that says `missing` and names the extra if it is not installed."""
    try:
        return import_module(module)
    except ImportError as error:
        raise UsageError(_advised(missing, extra)) from error


def load_lone(module: str, package: str, missing: str) -> ModuleType:
    """As load_extra, for a package installed without its declared dependencies, which conflict."""
    try:
        return import_module(module)
    except ImportError as error:
        raise UsageError(f"{missing}, expected {_pip()} --no-deps '{package}' before") from error


def advice(extra: str) -> str:
    """The command that installs an extra into the environment of unlidar-track."""
    return f"{_pip()} 'unlidar-track[{extra}]'"


def _advised(missing: str, extra: str) -> str:
    return f"{missing}, expected {advice(extra)} before"


def _pip() -> str:
    # This environment's pip: Debian's refuses, another one would install elsewhere.
    return f"{shlex.quote(sys.executable)} -m pip install"
