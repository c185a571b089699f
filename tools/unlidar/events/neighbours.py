"""Search for tracks near a position."""

import itertools
from heapq import nsmallest

Key = tuple[str, int]  # station, number of its track
Position = tuple[float, float, float]  # metres

_MOST = 4  # per station, so that crowding costs nothing and hides no other station


class Neighbours:
    """Tracks by grid cell of their position."""

    def __init__(self, reach_m: float) -> None:
        """`reach_m`: largest distance of neighbours along each axis."""
        self._reach_m = reach_m
        self._cells: dict[tuple[int, int], dict[str, dict[Key, Position]]] = {}
        self._cell: dict[Key, tuple[int, int]] = {}  # of each track

    def put(self, key: Key, position: Position) -> None:
        """Sets the position of a track."""
        cell = self._cell_of(position)
        if self._cell.get(key, cell) != cell:
            self.remove(key)
        self._cell[key] = cell
        self._cells.setdefault(cell, {}).setdefault(key[0], {})[key] = position

    def remove(self, key: Key) -> None:
        """Removes a track."""
        cell = self._cell.pop(key, None)
        if cell is None:
            return
        stations = self._cells[cell]
        del stations[key[0]][key]
        if not stations[key[0]]:
            del stations[key[0]]
        if not stations:
            del self._cells[cell]

    def around(self, key: Key) -> list[Key]:
        """The nearest tracks of every other station. KeyError for an unknown track."""
        x, y = self._cell[key]
        position = self._cells[x, y][key[0]][key]
        near: dict[str, list[tuple[float, Key]]] = {}
        for cell in itertools.product((x - 1, x, x + 1), (y - 1, y, y + 1)):
            for station, tracks in self._cells.get(cell, {}).items():
                if station != key[0]:
                    far = ((_apart_m(there, position), other) for other, there in tracks.items())
                    near.setdefault(station, []).extend(e for e in far if e[0] <= self._reach_m)
        return [other for found in near.values() for _, other in nsmallest(_MOST, found)]

    def _cell_of(self, position: Position) -> tuple[int, int]:
        return int(position[0] // self._reach_m), int(position[1] // self._reach_m)


def _apart_m(one: Position, two: Position) -> float:
    return max(abs(one[0] - two[0]), abs(one[1] - two[1]), abs(one[2] - two[2]))
