"""Outlines of zones for pages: bounded, and near to what the zones are."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from unlidar.events.site import Rule, Site, Zone
from unlidar.watch.outlines import _MOST_CORNERS, drawable
from unlidar.watch.server import _begin


def zone(polygon: shapely.Polygon, name: str = "apron") -> Zone:
    return Zone(name, Rule(zones="zones.geojson"), polygon, 0.0, 100.0)


def coast(corners: int, radius_m: float = 1000.0) -> shapely.Polygon:
    """Ragged by metres, as surveys of coasts and borders are."""
    angle = np.linspace(0, 2 * np.pi, corners, endpoint=False)
    radius_m = radius_m + np.random.default_rng(3).normal(0, 1.0, corners)
    return shapely.Polygon(np.column_stack([radius_m * np.cos(angle), radius_m * np.sin(angle)]))


def corners(outlines: list) -> int:
    return sum(len(ring) for rings in outlines for ring in rings)


def test_what_pages_can_draw_is_sent_corner_by_corner(caplog) -> None:
    zones = [zone(shapely.box(i, 0, i + 0.5, 1), f"z{i}") for i in range(10_000)]
    assert drawable(zones)[7] == [[[7.5, 0.0], [7.5, 1.0], [7.0, 1.0], [7.0, 0.0], [7.5, 0.0]]]
    assert corners(drawable(zones)) == 50_000
    (outline,) = drawable([zone(coast(40_000))])
    assert len(outline[0]) == 40_001
    assert caplog.messages == []


def test_a_zone_of_ever_so_many_corners_is_drawn_near_to_where_it_is(caplog) -> None:
    polygon = coast(200_000)
    (rings,) = drawable([zone(polygon)])
    assert 1000 < len(rings[0]) <= _MOST_CORNERS
    drawn = shapely.LinearRing(rings[0])
    some = shapely.points(shapely.get_coordinates(polygon)[::2000])
    assert shapely.distance(drawn, some).max() < 5.0
    (said,) = caplog.messages
    assert "200001 corners" in said
    assert len(said) <= 200
    assert len(_begin(Site(), [zone(polygon)])) < 2_000_000


def test_one_large_zone_takes_no_corner_of_small_ones() -> None:
    small = [zone(shapely.box(i, 0, i + 1, 1), f"z{i}") for i in range(1000)]
    shown = drawable([zone(coast(200_000)), *small])
    assert all(len(rings[0]) == 5 for rings in shown[1:])
    assert corners(shown) <= _MOST_CORNERS
    assert corners(shown[:1]) > 1000


@pytest.mark.parametrize("kind", ["holes", "parts", "round"])
def test_no_zones_take_more_than_a_page_can_draw(kind) -> None:
    squares = [
        shapely.box(3 * (i % 200), 3 * (i // 200), 3 * (i % 200) + 1, 3 * (i // 200) + 1)
        for i in range(20_000)
    ]
    if kind == "holes":
        whole = shapely.box(-10, -10, 1000, 1000).exterior
        zones = [zone(shapely.Polygon(whole, [square.exterior for square in squares]))]
    elif kind == "parts":
        zones = [zone(shapely.MultiPolygon(squares))]
    else:
        zones = [zone(square.buffer(1), f"z{i}") for i, square in enumerate(squares[:5000])]
    shown = drawable(zones)
    assert corners(shown) <= _MOST_CORNERS
    assert all(rings and all(len(ring) >= 4 for ring in rings) for rings in shown)
    if kind == "holes":
        assert [-10.0, -10.0] in shown[0][0]  # the longest ring stays
