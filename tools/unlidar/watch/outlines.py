"""Outlines of zones for pages, simplified to a number of corners that a page can draw."""

from collections.abc import Sequence
from typing import Any

from unlidar.events.site import MOST_AWAY_M, Zone
from unlidar.reporting import note
from unlidar.sanitize import printable

_MOST_CORNERS = 50_000  # of all zones: five of each of 10,000
_STEP_M = 0.1  # initial tolerance of the simplification; doubled until it fits
_RING = 4  # corners at least: three and the first again

Ring = list[list[float]]


def drawable(zones: Sequence[Zone]) -> list[list[Ring]]:
    """The rings of each zone in m, for drawing; alarms use the exact zones."""
    import shapely

    sizes = [int(shapely.get_num_coordinates(zone.polygon)) for zone in zones]
    room = _share(sizes)
    shown, drawn = [], 0
    for zone, size in zip(zones, sizes, strict=True):
        rings = shapely.get_rings(shapely.get_parts(zone.polygon))
        if size > room:
            rings = _simpler(rings, room)
        shown.append([shapely.get_coordinates(ring).round(2).tolist() for ring in rings])
        drawn += sum(map(len, shown[-1]))
    if drawn < sum(sizes):
        largest = printable(zones[sizes.index(max(sizes))].name)
        note(
            f"zones have {sum(sizes)} corners, '{largest}' {max(sizes)} of them: pages draw "
            f"{drawn}, alarms go by all"
        )
    return shown


def _share(sizes: Sequence[int]) -> int:
    """Corners allowed per zone; unused room of small zones is shared."""
    room, left = _MOST_CORNERS, len(sizes)
    for size in sorted(sizes):
        if size * left > room:
            return room // left
        room, left = room - size, left - 1
    return _MOST_CORNERS


def _simpler(rings: Any, room: int) -> Any:
    """Simplifies rings to `room` corners at most; of too many rings keeps the longest."""
    import numpy as np
    import shapely

    rings = rings[np.argsort(-shapely.length(rings), kind="stable")[: max(1, room // _RING)]]
    tolerance_m = _STEP_M
    while shapely.get_num_coordinates(rings).sum() > room and tolerance_m < MOST_AWAY_M:
        coarser = shapely.simplify(rings, tolerance_m)
        rings = np.where(shapely.get_num_coordinates(coarser) >= _RING, coarser, rings)
        tolerance_m *= 2
    fits = shapely.get_num_coordinates(rings).cumsum() <= room
    return rings[fits] if fits.any() else rings[:1]
