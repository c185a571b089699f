"""What describes the release to a public CI names what is there."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path

from ruamel.yaml import YAML
from synthetic import PROJECT


def test_a_release_is_built_of_what_is_there() -> None:
    project = tomllib.loads((PROJECT / "pyproject.toml").read_text())
    wheels = project["tool"]["cibuildwheel"]
    commands = [wheels["linux"]["before-all"], *wheels["linux"]["repair-wheel-command"]]
    named = re.findall(r"tools/[a-z_.]+", " ".join(commands))
    assert named == ["tools/wheel_dependencies.sh", "tools/wheel_licences.py"]
    assert [name for name in named if not (PROJECT / name).is_file()] == []
    oldest = project["project"]["requires-python"].removeprefix(">=3.")
    assert re.search(rf"cp3\{{{oldest},", wheels["build"])
    options = re.findall(r"-D(UNLIDAR_\w+)=", wheels["linux"]["environment"]["CMAKE_ARGS"])
    options += re.findall(r"-D(UNLIDAR_\w+)=", (PROJECT / "setup.py").read_text())
    known = (PROJECT / "CMakeLists.txt").read_text()
    assert [name for name in options if not re.search(rf"(option|set)\({name} ", known)] == []
    jobs = YAML().load(PROJECT / ".github/workflows/wheels.yml")["jobs"]
    steps = [step for job in jobs.values() for step in job["steps"]]
    assert [
        s for s in steps if "run" not in s and not re.search(r"@(v\d|release/)", s["uses"])
    ] == []


def test_tools_are_installed_as_the_project_above(tmp_path: Path) -> None:
    code = (
        "import sys, project_above; project_above.prepare_metadata_for_build_editable(sys.argv[1])"
    )
    command = (sys.executable, "-c", code, tmp_path)
    run = subprocess.run(command, cwd=PROJECT / "tools", capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    described = tomllib.loads((PROJECT / "pyproject.toml").read_text())["project"]
    (metadata,) = tmp_path.glob("*.dist-info/METADATA")
    assert metadata.read_text().splitlines()[1] == f"Name: {described['name']}"
    backend = tomllib.loads((PROJECT / "tools/pyproject.toml").read_text())["build-system"]
    own = tomllib.loads((PROJECT / "pyproject.toml").read_text())["build-system"]
    assert backend["requires"] == own["requires"]
