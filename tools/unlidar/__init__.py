"""The harness of unlidar_track: recordings in, trajectories measured, figures out.

The library interface is that of `api`, `engine` and `reading`. Names are imported on first access,
so that importing the package, and with it every command, stays fast.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from unlidar.api import (
        Conversion,
        ConvertOptions,
        DroneMeasures,
        EvaluateOptions,
        Measures,
        Run,
        convert,
        evaluate,
        run,
    )
    from unlidar.engine import (
        Engine,
        EngineState,
        Event,
        Frame,
        Frames,
        Kind,
        Now,
        Row,
        SensorState,
        Track,
        TrackBegins,
        TrackEnds,
        track,
    )
    from unlidar.errors import (
        ConfigError,
        InputError,
        OutputError,
        ProgramError,
        UnlidarError,
        UsageError,
    )
    from unlidar.reading import read

    __version__: str

_MODULES = {
    "api": (
        "Conversion",
        "ConvertOptions",
        "DroneMeasures",
        "EvaluateOptions",
        "Measures",
        "Run",
        "convert",
        "evaluate",
        "run",
    ),
    "engine": (
        "Engine",
        "EngineState",
        "Event",
        "Frame",
        "Frames",
        "Kind",
        "Now",
        "Row",
        "SensorState",
        "Track",
        "TrackBegins",
        "TrackEnds",
        "track",
    ),
    "errors": (
        "ConfigError",
        "InputError",
        "OutputError",
        "ProgramError",
        "UnlidarError",
        "UsageError",
    ),
    "reading": ("read",),
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}
__all__ = [
    "ConfigError",
    "Conversion",
    "ConvertOptions",
    "DroneMeasures",
    "Engine",
    "EngineState",
    "EvaluateOptions",
    "Event",
    "Frame",
    "Frames",
    "InputError",
    "Kind",
    "Measures",
    "Now",
    "OutputError",
    "ProgramError",
    "Row",
    "Run",
    "SensorState",
    "Track",
    "TrackBegins",
    "TrackEnds",
    "UnlidarError",
    "UsageError",
    "__version__",
    "convert",
    "evaluate",
    "read",
    "run",
    "track",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import PackageNotFoundError, version

        try:
            return version("unlidar-track")
        except PackageNotFoundError:  # used from a source tree that was not installed
            return "0+uninstalled"
    if name in _MODULE_OF:
        return getattr(import_module(f"unlidar.{_MODULE_OF[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*__all__, *(name for name in globals() if name.startswith("__"))]
