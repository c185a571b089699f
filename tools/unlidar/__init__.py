"""The harness of unlidar_track: recordings in, trajectories measured, figures out.

The library interface is that of `api`. Names are imported on first access, so that importing the
package, and with it every command, stays fast.
"""

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
    from unlidar.errors import (
        ConfigError,
        InputError,
        OutputError,
        ProgramError,
        UnlidarError,
        UsageError,
    )

    __version__: str

__all__ = [
    "ConfigError",
    "Conversion",
    "ConvertOptions",
    "DroneMeasures",
    "EvaluateOptions",
    "InputError",
    "Measures",
    "OutputError",
    "ProgramError",
    "Run",
    "UnlidarError",
    "UsageError",
    "__version__",
    "convert",
    "evaluate",
    "run",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import PackageNotFoundError, version

        try:
            return version("unlidar-track")
        except PackageNotFoundError:  # used from a source tree that was not installed
            return "0+uninstalled"
    if name in __all__:
        from unlidar import api, errors

        return getattr(errors if name.endswith("Error") else api, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
