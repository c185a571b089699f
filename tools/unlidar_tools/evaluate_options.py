"""What can be asked of `evaluate`; apart from it so that --help need not wait for scipy."""

from dataclasses import dataclass

ALIGNMENTS = ("none", "translation", "yaw", "se3")
AUTO = "auto"


@dataclass(frozen=True)
class Options:
    """What is taken off before judging, and how the intervals are drawn."""

    align: str = "none"  # one of ALIGNMENTS
    time_offset: float | str = 0.0  # s added to the tracks' stamps, or AUTO
    bootstrap: int = 1000  # replicates of the intervals; 0: none
    block_s: float = 1.0  # what is drawn together: errors closer in time are alike
    seed: int = 0
