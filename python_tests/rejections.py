"""Names of the program's rules that refuse a plot, a path or a track, read from its source."""

from __future__ import annotations

import re

from synthetic import PROJECT

# For all that flies is as low as people, and that nothing stands below it is never sure enough.
NEAR_GROUND = (
    "--set", "robust.off_ground_m=1000", "--set", "robust.false_alarms_per_recording=1e-300",
)  # fmt: skip


def rejections() -> set[str]:
    """As `--trace` writes them."""
    header = (PROJECT / "src/tracking/rejection.hpp").read_text()
    names = re.findall(r"^  k([A-Z]\w+)", header, re.MULTILINE)
    return {re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower() for name in names} - {"none"}
