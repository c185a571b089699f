"""Options of `evaluate`, in a module of their own so that --help need not load scipy."""

from dataclasses import dataclass

from unlidar.call_checks import expect, expect_number, expect_positive, expect_whole

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

    def __post_init__(self) -> None:
        """Throws UsageError for a value that is none."""
        expect(self.align in ALIGNMENTS, "align", self.align, f"one of {', '.join(ALIGNMENTS)}")
        if self.time_offset != AUTO:
            expect_number("time_offset", self.time_offset)
        expect_whole("bootstrap", self.bootstrap, 0)
        expect_positive("block_s", self.block_s)
        expect_whole("seed", self.seed, 0)
