"""Adds to the package what CMake builds and installs for it; takes the version of CMakeLists.txt.

An install in place builds nothing: there CMake itself puts the engine where it is found.

UNLIDAR_BUILD_DIR names a build that is there already, as tools/package.sh does; without it CMake
builds anew, with what CMAKE_ARGS says besides.
"""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

from setuptools import Distribution, setup
from setuptools.command.build_py import build_py

PROJECT = Path(__file__).resolve().parent


def version() -> str:
    text = (PROJECT / "CMakeLists.txt").read_text()
    return re.search(r"^project\(\w+ VERSION ([0-9.]+)", text, re.MULTILINE)[1]


def cmake(*arguments: str | Path) -> None:
    try:
        subprocess.run(["cmake", *arguments], check=True, stdin=subprocess.DEVNULL)
    except FileNotFoundError:
        raise SystemExit("CMake is needed to build this, and was not found in PATH") from None
    except subprocess.CalledProcessError as failed:
        raise SystemExit(f"failed: {shlex.join(map(str, failed.cmd))}") from None


class BuildWhole(build_py):
    def run(self) -> None:
        super().run()
        if self.editable_mode:
            return
        build_dir = os.environ.get("UNLIDAR_BUILD_DIR") or self.configured()
        cmake("--build", build_dir, "--parallel", str(len(os.sched_getaffinity(0))),
              "--target", "unlidar_track", "unlidar_python")  # fmt: skip
        cmake("--install", build_dir, "--component", "wheel",
              "--prefix", Path(self.build_lib).resolve() / "unlidar")  # fmt: skip

    def configured(self) -> str:
        """A build folder for this Python, of what is packed and nothing else."""
        build_dir = str(Path(self.get_finalized_command("build").build_temp).resolve())
        cmake("-S", PROJECT, "-B", build_dir, "-DCMAKE_BUILD_TYPE=Release", "-DUNLIDAR_UNITY=ON",
              "-DUNLIDAR_BUILD_TESTS=OFF", "-DUNLIDAR_BUILD_BENCHMARKS=OFF",
              "-DUNLIDAR_WARNINGS_AS_ERRORS=OFF",  # of compilers that were never tried
              f"-DPython_EXECUTABLE={sys.executable}", f"-DUNLIDAR_PYTHON_DIR={build_dir}",
              *shlex.split(os.environ.get("CMAKE_ARGS", "")))  # fmt: skip
        return build_dir


class BuiltDistribution(Distribution):
    """Of one kind of machine and one version of Python."""

    def has_ext_modules(self) -> bool:
        return True


setup(
    version=version(),
    cmdclass={"build_py": BuildWhole},
    distclass=BuiltDistribution,
    options={"build": {"build_base": "build-wheel"}},  # build/ is CMake's
)
