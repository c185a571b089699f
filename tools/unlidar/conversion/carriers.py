"""Coordinate frames that move: what carries the sensors of a bag, and its poses in the world.

Frames that /tf_static relates are one rigid body. A body is carried by the transform that moves one
of its frames; that frame is the carrier of the sensors in the body.
"""

import itertools
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from unlidar.conversion.transforms import FARTHEST_M, HERE, Placement, StaticTransforms
from unlidar.poses import Poses


class Motion:
    """Transforms of one frame in another over time, as they are read."""

    def __init__(self, parent: str, child: str) -> None:
        self.parent, self.child = parent, child
        self._stamps_ns, self._values = array("q"), array("d")

    def __len__(self) -> int:
        """Number of transforms read."""
        return len(self._stamps_ns)

    def add(self, stamp_ns: int, placement: Placement) -> None:
        """Adds a transform; later ones of the same stamp replace earlier ones."""
        self._stamps_ns.append(stamp_ns)
        self._values.extend(placement.translation_m.tolist())
        self._values.extend(placement.rotation.as_quat().tolist())

    def of(self, child: str) -> "Motion":
        """The same of another frame."""
        motion = Motion(self.parent, child)
        motion._stamps_ns, motion._values = self._stamps_ns, self._values
        return motion

    def step(self) -> Poses | Placement:
        """The poses; a placement if nothing moves."""
        stamps_ns = np.array(self._stamps_ns)[::-1]
        kept, index = np.unique(stamps_ns, return_index=True)
        values = np.array(self._values).reshape(-1, 7)[::-1][index]
        poses = Poses(kept, values[:, :3], Rotation.from_quat(values[:, 3:]))
        return Placement(poses.rotation[0], poses.position_m[0]) if poses.is_still else poses


@dataclass(frozen=True)
class _Way:
    """What bears a frame."""

    mounting: Placement  # of the frame in its carrier
    poses: dict[str, Poses]  # of the carrier in the frames above it, from the nearest up


class Carriers:
    """Carriers of sensors and their poses in one world; `world` is None where nothing moves."""

    def __init__(
        self, static: StaticTransforms, motions: Sequence[Motion], frames: Iterable[str]
    ) -> None:
        """`frames`: those of the sensors."""
        self._static = static
        self._steps: dict[str, tuple[Motion, Poses | Placement]] = {}  # by the body of the child
        for motion in sorted(motions, key=len):  # of several the one with the most transforms
            body = static.root(motion.child)
            if body != static.root(motion.parent):
                self._steps[body] = motion, motion.step()
        self._ways: dict[str, _Way | None] = {}
        ways = [way for frame in frames if (way := self._way(frame)) is not None]
        self.world = _world_of([way.poses for way in ways])

    def mounting(self, frame: str) -> Placement | None:
        """The placement of a frame in its carrier, in the world if it is at rest; None: unknown."""
        way = self._way(frame)
        return self._at_rest(frame) if way is None else way.mounting

    def poses(self, frame: str) -> Poses | None:
        """The poses of a frame's carrier in the world; None for a frame at rest."""
        way = self._way(frame)
        return None if way is None or self.world is None else way.poses.get(self.world)

    def placement(self, frame: str, stamp_ns: int) -> Placement | None:
        """The placement of a frame in the world at a time; None if nothing relates them."""
        way, poses = self._way(frame), self.poses(frame)
        if way is None:
            return self._at_rest(frame)
        if poses is None:
            return None
        position_m, rotation = poses.at(np.array([stamp_ns]))
        return way.mounting.within(Placement(rotation[0], position_m[0]))

    def _at_rest(self, frame: str) -> Placement | None:
        """The placement in the world of a frame that nothing moves."""
        placed = HERE
        for name, step in self._path(frame):
            if name == self.world:
                return placed
            placed = placed.within(step)
        return None if self.world is None else self._static.placement(frame, self.world)

    def _way(self, frame: str) -> _Way | None:
        """The way of a frame's carrier; None if nothing moves it."""
        if frame not in self._ways:
            self._ways[frame] = self._find_way(frame)
        return self._ways[frame]

    def _find_way(self, frame: str) -> _Way | None:
        path = list(self._path(frame))
        moving = [step for _, step in path if isinstance(step, Poses)]
        if not moving:
            return None
        stamps_ns = max(moving, key=lambda poses: len(poses.stamp_ns)).stamp_ns
        mounting = HERE
        while isinstance(path[0][1], Placement):
            mounting = mounting.within(path.pop(0)[1])
        position_m = np.zeros((len(stamps_ns), 3))
        rotation = Rotation.from_quat(np.tile([0.0, 0.0, 0.0, 1.0], (len(stamps_ns), 1)))
        poses: dict[str, Poses] = {}
        for (_, step), (name, _) in itertools.pairwise(path):
            if isinstance(step, Poses):
                at_m, turned = step.at(stamps_ns)
            else:
                at_m, turned = step.translation_m, step.rotation
            position_m, rotation = turned.apply(position_m) + at_m, turned * rotation
            poses[name] = Poses(stamps_ns, position_m, rotation)
        return _Way(mounting, poses)

    def _path(self, frame: str) -> Iterator[tuple[str, Poses | Placement]]:
        """Each frame on the way up, and the step from it to the next."""
        seen: set[str] = set()
        while (body := self._static.root(frame)) in self._steps and body not in seen:
            seen.add(body)
            motion, step = self._steps[body]
            placement = self._static.placement(frame, motion.child)
            assert placement is not None  # both are frames of one body
            yield frame, placement
            yield motion.child, step
            frame = motion.parent
        above = self._static.chain(frame)
        for (name, placed), higher in itertools.pairwise([*above.items(), ("", HERE)]):
            yield name, placed.inverse().within(higher[1])


def _world_of(ways: Sequence[Mapping[str, Poses]]) -> str | None:
    """The uppermost frame above all carriers from which none of them is too far.

    The nearest of the first carrier where there is none; None without carriers.
    """
    if not ways:
        return None
    shared = [name for name in ways[0] if all(name in way for way in ways)]
    near = [
        name
        for name in shared
        if all(np.linalg.norm(way[name].position_m, axis=1).max() <= FARTHEST_M for way in ways)
    ]
    return near[-1] if near else next(iter(shared or ways[0]))
