"""The harness of unlidar_track: recordings in, trajectories measured, figures out.

The public names are those of the stub, `__init__.pyi`. They are imported on first access, so that
importing the package, and with it every command, stays fast.
"""

from functools import cache
from importlib import import_module
from typing import Any


@cache
def _module_of() -> dict[str, str]:
    import ast
    from pathlib import Path

    stub = ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    imports = [node for node in stub.body if isinstance(node, ast.ImportFrom)]
    return {alias.name: str(node.module) for node in imports for alias in node.names}


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import PackageNotFoundError, version

        try:
            return version("unlidar-track")
        except PackageNotFoundError:  # used from a source tree that was not installed
            return "0+uninstalled"
    if name == "__all__":
        return sorted([*_module_of(), "__version__"])
    if not name.startswith("_") and name in _module_of():
        return getattr(import_module(_module_of()[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*__getattr__("__all__"), *(name for name in globals() if name[:2] == "__")])
