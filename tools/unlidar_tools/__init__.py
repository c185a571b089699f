"""The name of the package `unlidar` up to version 0.1: every module of it is that of `unlidar`.

Stations and scripts that were written for it go on; it warns and will be gone with version 1.
"""

import importlib
import logging
import sys
import warnings
from collections.abc import Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

import unlidar


class _SameModules(MetaPathFinder, Loader):
    """Finds modules of the former name: not copies, whose classes would not be those of unlidar."""

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        return ModuleSpec(name, self) if name.startswith(__name__ + ".") else None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        module = importlib.import_module("unlidar" + spec.name.removeprefix(__name__))
        spec.loader_state = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        spec = module.__spec__
        module.__spec__ = spec.loader_state if spec is not None else None


warnings.warn("unlidar_tools is unlidar now: import unlidar", DeprecationWarning, stacklevel=2)
logging.Logger.manager.loggerDict[__name__] = logging.getLogger("unlidar")
sys.meta_path.insert(0, _SameModules())
__all__ = unlidar.__all__


def __getattr__(name: str) -> object:
    return getattr(unlidar, name)
