"""Takes configs/ of the project into the package, for installs that are not in place."""

import shutil
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py


class BuildWithConfigs(build_py):
    def run(self) -> None:
        super().run()
        if not self.editable_mode:
            shutil.copytree(
                Path(__file__).resolve().parents[1] / "configs",
                Path(self.build_lib) / "unlidar_tools/configs",
                dirs_exist_ok=True,
            )


setup(cmdclass={"build_py": BuildWithConfigs})
