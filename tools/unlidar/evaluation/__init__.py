"""Accuracy of a trajectory against ground truth, and its coverage.

Two sets of measures:

- At the truth's stamps (`rmse`, `dx` .. `within1m`, `coverage`): at each in-view truth position,
  where is the nearest track then? Tracks are interpolated between rows at most MAX_STEP_S apart.
  Every instant of the flight counts once, also where a method has no track.
- At the trajectory's own rows (`rows_*`): how far is each row from the nearest target then? Truth
  is interpolated. This counts every row once. Rows outside the truth's time span cannot be judged;
  they are counted in `rows_unjudged` and left out. `false` in contrast judges all rows and takes
  the nearest end of the truth for those outside its span.

docs/evaluate.md has the formula of every measure.
"""

from collections.abc import Sequence
from pathlib import Path

from unlidar.evaluate_options import Options
from unlidar.evaluation.association import FALSE_BEYOND_M, MAX_STEP_S
from unlidar.evaluation.comparison import Comparison, compare, compare_files
from unlidar.evaluation.measures import WITHIN_M, measure
from unlidar.presets import about_truth
from unlidar.truth import Tracks, Truth

__all__ = [
    "FALSE_BEYOND_M",
    "MAX_STEP_S",
    "WITHIN_M",
    "Comparison",
    "Options",
    "compare",
    "evaluate",
    "evaluate_files",
    "measure",
]


def evaluate_files(
    truth: Path, tracks: Path | Sequence[Path], options: Options | None = None
) -> dict:
    """`evaluate` on files, with the truth's reference point; the tracks may be in several files."""
    options = options or Options()
    files = [tracks] if isinstance(tracks, Path) else tracks
    return measure([compare_files(truth, files, options)], options) | about_truth(truth)


def evaluate(truth: Truth, tracks: Tracks, options: Options | None = None) -> dict:
    """All measures by name, lengths in m; a measure that is not defined is absent or None."""
    options = options or Options()
    return measure([compare(truth, tracks, options)], options)
