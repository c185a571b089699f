"""Options of `evaluate`, in a module of their own so that --help need not load scipy."""

from dataclasses import dataclass

ALIGNMENTS = ("none", "translation", "yaw", "se3")
AUTO = "auto"


@dataclass(frozen=True)
class Options:
    """Corrections before the evaluation, and the bootstrap of the intervals."""

    align: str = "none"  # one of ALIGNMENTS
    time_offset: float | str = 0.0  # s added to the tracks' stamps, or AUTO
    bootstrap: int = 1000  # replicates of the intervals; 0: none
    block_s: float = 1.0  # block length: errors closer in time are correlated
    seed: int = 0
