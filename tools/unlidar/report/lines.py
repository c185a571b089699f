"""Drawing of trajectories: thinned rows, split at gaps in time, with sigma tubes."""

from dataclasses import dataclass

import numpy as np

from unlidar.pieces import pieces_of

MOST_ROWS = 5_000
MOST_RINGS = 1_500
RING = 8  # corners of a tube's cross-section
_SPEED_HALF_S = 0.25


@dataclass(frozen=True)
class Drawn:
    """Indices of the drawn rows, as pieces in order of time."""

    pieces: list[np.ndarray]
    every: int  # every k-th row is drawn; 1: all

    @property
    def rows(self) -> np.ndarray:
        """All pieces in one array, -1 between them."""
        parts = [part for piece in self.pieces for part in (piece, [-1])]
        return np.concatenate([np.zeros(0, dtype=int), *parts[:-1]]).astype(int)

    def of(self, values: np.ndarray) -> np.ndarray:
        """The values of these rows, NaN between the pieces."""
        rows = self.rows
        if len(rows) == 0:
            return np.zeros((0, *values.shape[1:]), dtype=np.float32)
        taken = values[rows].astype(np.float32)
        taken[rows < 0] = np.nan
        return taken


def drawn_rows(time_s: np.ndarray, group: np.ndarray, most: int = MOST_ROWS) -> Drawn:
    """Every k-th row of each piece, and its last, so that about `most` rows remain."""
    every = max(1, -(-len(time_s) // most))
    return Drawn([_every(piece, every) for piece in pieces_of(time_s, group)], every)


def drawn_by_group(time_s: np.ndarray, group: np.ndarray) -> dict[float, Drawn]:
    """`drawn_rows` of all groups together, for each group on its own."""
    drawn = drawn_rows(time_s, group)
    return {
        float(one): Drawn([p for p in drawn.pieces if group[p[0]] == one], drawn.every)
        for one in np.unique(group)
    }


def _every(piece: np.ndarray, every: int) -> np.ndarray:
    """Every k-th row, and the last."""
    return np.append(piece[:-1:every], piece[-1:])


def at_times(
    time_s: np.ndarray, group: np.ndarray, xyz_m: np.ndarray, wanted_s: np.ndarray
) -> list[np.ndarray]:
    """Positions of each group at the given times, (S, 3) each; NaN if unknown."""
    found = []
    for one in np.unique(group):
        own = pieces_of(time_s[group == one], group[group == one])
        at = np.full((len(wanted_s), 3), np.nan)
        for piece in own:
            piece_s, piece_m = time_s[group == one][piece], xyz_m[group == one][piece]
            inside = (wanted_s >= piece_s[0] - 1e-3) & (wanted_s <= piece_s[-1] + 1e-3)
            for axis in range(3):
                at[inside, axis] = np.interp(wanted_s[inside], piece_s, piece_m[:, axis])
        found.append(at)
    return found


def speed(time_s: np.ndarray, group: np.ndarray, xyz_m: np.ndarray) -> np.ndarray:
    """Speed of positions without velocities: their difference across half a second, (N,) m/s."""
    result = np.full(len(time_s), np.nan)
    for piece in pieces_of(time_s, group):
        own_s = time_s[piece]
        begin = np.maximum(own_s - _SPEED_HALF_S, own_s[0])
        end = np.minimum(own_s + _SPEED_HALF_S, own_s[-1])
        moved = [
            np.interp(end, own_s, xyz_m[piece, i]) - np.interp(begin, own_s, xyz_m[piece, i])
            for i in range(3)
        ]
        span = end - begin
        known = span > 0
        result[piece[known]] = np.linalg.norm(moved, axis=0)[known] / span[known]
    return result


def range_sigma(xyz_m: np.ndarray, sigma_m: np.ndarray) -> np.ndarray:
    """Standard deviation of the distance from the origin, axes taken as independent, (N,) m."""
    range_m = np.linalg.norm(xyz_m, axis=1)
    towards = xyz_m / np.maximum(range_m, 1e-9)[:, None]
    return np.sqrt(((towards * sigma_m) ** 2).sum(axis=1))


def tube(
    pieces: list[np.ndarray], xyz_m: np.ndarray, radius_m: np.ndarray, every: int = 1
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Corners (RING R, 3) and triangles (F, 3) of a tube along the pieces, and the rows of its R
    rings, one at every so many rows.

    `radius_m` (N, 3): the half axes of the ellipsoid at each row. A ring is its outline across
    the flight. Where the target stands still, the last known direction is kept.
    """
    corners, faces, rings = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=int)], [np.zeros(0, int)]
    angle = np.arange(RING) * 2 * np.pi / RING
    around = np.arange(RING)
    for piece in pieces:
        rows = _every(piece, every)
        if len(rows) < 2:
            continue
        count = RING * sum(map(len, rings))
        for row, (side, up) in zip(rows, _frames_along(xyz_m[rows]), strict=True):
            across = np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * up
            length = np.sqrt(((across * radius_m[row]) ** 2).sum(axis=1))
            corners.append(xyz_m[row] + across * length[:, None])
        for ring in range(len(rows) - 1):
            a = count + ring * RING + around
            b = count + ring * RING + (around + 1) % RING
            faces.append(np.stack([a, b, b + RING], axis=1))
            faces.append(np.stack([a, b + RING, a + RING], axis=1))
        rings.append(rows)
    return np.concatenate(corners), np.concatenate(faces), np.concatenate(rings)


def rings_apart(drawn: list[Drawn]) -> int:
    """The number of rows per ring, so that all tubes together have about MOST_RINGS."""
    return max(1, -(-sum(len(piece) for one in drawn for piece in one.pieces) // MOST_RINGS))


def _frames_along(path_m: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Two directions across the path at each of its points, turning as little as possible."""
    along = np.gradient(path_m, axis=0)
    frames, last, side = [], np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    for step in along:
        length = np.linalg.norm(step)
        last = step / length if length > 1e-9 else last
        side = side - last * (side @ last)
        if np.linalg.norm(side) < 1e-6:
            side = np.cross(last, np.eye(3)[np.argmin(np.abs(last))])
        side = side / np.linalg.norm(side)
        frames.append((side, np.cross(last, side)))
    return frames
