"""The colours of figures, pages and tables: a track has one and the same in all of them."""

import numpy as np

GREY, GREEN, RED = "#9a9a9a", "#1f9d3a", "#d62728"  # returns, target returns, truth
# Distinguishable, also from those above, with the common colour vision deficiencies.
_TRACKS = (
    "#1f4fd6", "#e08a00", "#8e24aa", "#00838f", "#6d4c41", "#d81b8c", "#5f6b00", "#37474f",
)  # fmt: skip


def track_colours(track_id: np.ndarray) -> dict[float, str]:
    """A colour for each track number; repeats where there are more tracks than colours."""
    return {
        float(number): _TRACKS[index % len(_TRACKS)]
        for index, number in enumerate(np.unique(track_id))
    }


def faded(colour: str, opacity: float) -> str:
    """The colour as CSS writes it with an opacity."""
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({red},{green},{blue},{opacity:g})"
