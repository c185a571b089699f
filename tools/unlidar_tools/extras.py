"""Packages that only some commands need, and that an install need not have."""

from collections.abc import Sequence
from importlib.util import find_spec

from unlidar_tools.errors import UsageError

_STATION = {
    "paho": "paho-mqtt",
    "shapely": "shapely",
    "starlette": "starlette",
    "uvicorn": "uvicorn",
    "websockets": "websockets",
}


def need_station(command: str, modules: Sequence[str] = tuple(_STATION)) -> None:
    """UsageError naming the packages of the extra `station` that are missing."""
    missing = [_STATION[name] for name in modules if find_spec(name) is None]
    if missing:
        raise UsageError(
            f"{command}: not installed: {', '.join(missing)}, expected "
            "pip install 'unlidar-tools[station]' before"
        )
