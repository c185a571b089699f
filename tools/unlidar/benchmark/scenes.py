"""The scenes of a benchmark, simulated or in folders."""

from dataclasses import dataclass
from pathlib import Path

from unlidar.configs import scenario_names
from unlidar.errors import InputError, UsageError, listed
from unlidar.frames_io import find_sensors
from unlidar.simulate import load_scenario
from unlidar.truth import TRUTH_NAME


@dataclass(frozen=True)
class SceneSeed:
    """One recording: a scenario with a seed, or a folder."""

    scene: str
    seed: str  # empty where a folder has none
    scenario: str | None = None  # to be simulated
    folder: Path | None = None  # holds frame directories and ground_truth.csv


def seeds(text: str) -> list[str]:
    """Parses a list of seeds: `1-5`, `7` or `1,3,8-10`."""
    found: list[str] = []
    for part in text.split(","):
        first, separator, last = part.strip().partition("-")
        if not first.isdecimal() or (separator and not last.isdecimal()):
            raise UsageError(f"--seeds {text}: expected numbers and ranges such as 1-5,8")
        numbers = range(int(first), int(last or first) + 1)
        if not numbers:
            raise UsageError(f"--seeds {text}: {part.strip()} is an empty range")
        found += [str(number) for number in numbers]
    return list(dict.fromkeys(found))


def simulated_scenes(names: list[str], seed_names: list[str]) -> list[SceneSeed]:
    """These scenarios (all bundled ones if none is named) with each seed."""
    names = names or scenario_names()
    for name in names:
        load_scenario(name)  # reports a wrong name or key before anything runs
    return [
        SceneSeed(Path(name).stem if name.endswith((".yaml", ".yml")) else name, seed, name)
        for name in names
        for seed in seed_names
    ]


def find_scenes(directory: Path, names: list[str], seed_names: list[str] | None) -> list[SceneSeed]:
    """The scenes in DIR/SCENE and DIR/SEED/SCENE, in order of scene and seed; of these names and
    seeds if they are given.
    """
    if not directory.is_dir():
        raise InputError(f"{directory}: is no folder of scenes")
    found = []
    for child in sorted(path for path in directory.iterdir() if path.is_dir()):
        if _is_scene(child):
            found.append(SceneSeed(child.name, "", folder=child))
            continue
        found += [
            SceneSeed(scene.name, child.name, folder=scene)
            for scene in sorted(child.iterdir())
            if _is_scene(scene)
        ]
    known = {one.scene for one in found}
    for name in names:
        if name not in known:
            raise UsageError(
                f"{directory}: has no scene '{name}', it holds {listed(sorted(known))}"
            )
    chosen = [
        one
        for one in found
        if (not names or one.scene in names)
        and (seed_names is None or not one.seed or one.seed in seed_names)
    ]
    if not chosen:
        raise InputError(
            f"{directory}: no scenes, expected [SEED/]SCENE/ with frame folders and {TRUTH_NAME}"
        )
    return sorted(chosen, key=lambda one: (one.scene, _number(one.seed), one.seed))


def _is_scene(path: Path) -> bool:
    return path.is_dir() and (path / TRUTH_NAME).is_file() and bool(find_sensors(path))


def _number(seed: str) -> int:
    return int(seed) if seed.isdecimal() else 0
