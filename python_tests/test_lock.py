"""The lock of Python packages: whole, exact and with hashes."""

from __future__ import annotations

import importlib.metadata
import re
import tomllib

from packaging.requirements import Requirement
from synthetic import PROJECT


def locked() -> dict[str, tuple[str, int]]:
    """Packages of the lock with their versions, and how many hashes each has.

    Without those that are for another machine or Python.
    """
    entries: dict[str, tuple[str, int]] = {}
    for name in ("requirements.txt", "requirements-test.txt"):
        text = (PROJECT / "tools" / name).read_text().replace("\\\n", " ")
        for line in text.splitlines():
            if line and not line.startswith(("#", "-r ")):
                package, _, version = line.split()[0].partition("==")
                assert re.fullmatch(r"[a-z0-9-]+", package) and version, line
                assert package not in entries, package
                if not applies(Requirement(line.partition(" --hash")[0])):
                    continue
                hashes = re.findall(r"--hash=sha256:[0-9a-f]{64}(?!\S)", line)
                entries[package] = version, len(hashes)
    return entries


def applies(requirement: Requirement) -> bool:
    """Here, by its marker."""
    return requirement.marker is None or requirement.marker.evaluate({"extra": ""})


def test_all_that_the_harness_needs_is_in_the_lock_at_the_version_that_is_installed() -> None:
    lock = locked()
    installed = {
        re.sub(r"[-_.]+", "-", found.name).lower(): found.version
        for found in importlib.metadata.distributions()
    }
    own = {"unlidar-track", "pip"}  # pip is that of the system's Python
    assert {name: version for name, (version, _) in lock.items()} == {
        name: version for name, version in installed.items() if name not in own
    }
    assert [name for name, (_, hashes) in lock.items() if hashes == 0] == []
    project = tomllib.loads((PROJECT / "pyproject.toml").read_text())
    needed = [
        *project["build-system"]["requires"],
        *project["project"]["dependencies"],
        *(r for rs in project["project"]["optional-dependencies"].values() for r in rs),
    ]
    for requirement in map(Requirement, needed):
        # rerun is of an extra that no script installs.
        if requirement.name != "rerun-sdk" and applies(requirement):
            version, _ = lock[re.sub(r"[-_.]+", "-", requirement.name).lower()]
            assert requirement.specifier.contains(version), requirement


def test_the_lock_names_no_index() -> None:
    for path in (PROJECT / "tools").glob("requirements*.txt"):
        assert not re.search(r"https?:|--(extra-)?index|--find-links", path.read_text())
