"""Takes the version of the project, and its configs/ for installs that are not in place."""

import re
import shutil
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

PROJECT = Path(__file__).resolve().parents[1]


def version() -> str:
    text = (PROJECT / "CMakeLists.txt").read_text()
    return re.search(r"^project\(\w+ VERSION ([0-9.]+)", text, re.MULTILINE)[1]


class BuildWithConfigs(build_py):
    def run(self) -> None:
        super().run()
        if not self.editable_mode:
            shutil.copytree(
                PROJECT / "configs",
                Path(self.build_lib) / "unlidar/configs",
                dirs_exist_ok=True,
            )


setup(version=version(), cmdclass={"build_py": BuildWithConfigs})
