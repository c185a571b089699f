"""Takes the version of the project; for installs that are not in place also its configs/ and what
was built: the program and, in the package's folder, the engine for Python.
"""

import re
import shutil
from pathlib import Path

from setuptools import Distribution, setup
from setuptools.command.build_py import build_py

PROJECT = Path(__file__).resolve().parents[1]


def version() -> str:
    text = (PROJECT / "CMakeLists.txt").read_text()
    return re.search(r"^project\(\w+ VERSION ([0-9.]+)", text, re.MULTILINE)[1]


class BuildWhole(build_py):
    def run(self) -> None:
        super().run()
        if self.editable_mode:
            return
        package = Path(self.build_lib) / "unlidar"
        shutil.copytree(PROJECT / "configs", package / "configs", dirs_exist_ok=True)
        program = PROJECT / "build/unlidar_track"
        if not program.is_file() or not any(package.glob("_engine.*.so")):
            raise SystemExit("build/ has no unlidar_track or no unlidar_python: build these first")
        (package / "bin").mkdir(exist_ok=True)
        shutil.copy2(program, package / "bin")


class BuiltDistribution(Distribution):
    """Of one kind of machine and one version of Python."""

    def has_ext_modules(self) -> bool:
        return True


setup(version=version(), cmdclass={"build_py": BuildWhole}, distclass=BuiltDistribution)
