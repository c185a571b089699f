"""/tf_static: how the coordinate frames of a recording that never move lie to each other."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

TRANSFORM_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
# A float32 holds a millimetre up to here; earth-centred and map-grid frames begin farther off.
_FARTHEST_M = 10_000.0
_LEAST_NORM = 0.1  # of a quaternion that says anything


class Placement:
    """Where a frame lies in another: p_other = rotation * p + translation_m."""

    def __init__(self, rotation: Rotation, translation_m: np.ndarray) -> None:
        self.rotation, self.translation_m = rotation, translation_m

    def apply(self, xyz_m: np.ndarray) -> np.ndarray:
        """Positions (..., 3) of the frame in the other."""
        return self.rotation.apply(xyz_m) + self.translation_m

    def within(self, outer: "Placement") -> "Placement":
        """In the frame in which the other one is placed."""
        return Placement(outer.rotation * self.rotation, outer.apply(self.translation_m))

    def inverse(self) -> "Placement":
        """Of the other frame in this one."""
        turned = self.rotation.inv()
        return Placement(turned, -turned.apply(self.translation_m))


_HERE = Placement(Rotation.identity(), np.zeros(3))


def is_static_topic(topic: str, msgtype: str) -> bool:
    """Whether a topic holds static transforms; /tf has the same type and moves."""
    return msgtype in TRANSFORM_TYPES and topic.rstrip("/").endswith("tf_static")


def plain_frame(frame_id: str) -> str:
    """ROS 1 wrote frames with a slash before them."""
    return frame_id.strip("/")


class StaticTransforms:
    """A forest of frames, each placed in the one above it."""

    def __init__(self) -> None:
        self._above: dict[str, tuple[str, Placement]] = {}
        self.unusable: list[str] = []  # children of transforms that are none

    def add(self, message: Any) -> None:
        """The transforms of a TFMessage; the last one for a frame counts."""
        for stamped in message.transforms:
            parent, child = (
                plain_frame(stamped.header.frame_id),
                plain_frame(stamped.child_frame_id),
            )
            t, q = stamped.transform.translation, stamped.transform.rotation
            translation = np.array([t.x, t.y, t.z], dtype=float)
            quaternion = np.array([q.x, q.y, q.z, q.w], dtype=float)
            numbers = np.isfinite(translation).all() and np.isfinite(quaternion).all()
            if parent == child or not numbers or np.linalg.norm(quaternion) < _LEAST_NORM:
                self.unusable.append(child)
                continue
            self._above[child] = (parent, Placement(Rotation.from_quat(quaternion), translation))

    def __bool__(self) -> bool:
        """Whether anything is known."""
        return bool(self._above)

    def common_frame(self, frames: Iterable[str]) -> str | None:
        """The frame in which all of these are placed: the uppermost that is not too far off.

        Usually that of the station or of its surroundings, with its z axis up. None where nothing
        is known of any; frames that cannot be related to the first one known do not count.
        """
        chains = [self._chain(frame) for frame in dict.fromkeys(frames) if self._knows(frame)]
        if not chains:
            return None
        related = [chain for chain in chains if list(chain)[-1] == list(chains[0])[-1]]
        shared = [frame for frame in chains[0] if all(frame in chain for chain in related)]
        near = [
            frame
            for frame in shared
            if all(np.linalg.norm(c[frame].translation_m) <= _FARTHEST_M for c in related)
        ]
        return near[-1] if near else shared[0]

    def placement(self, frame: str, common: str) -> Placement | None:
        """Of a frame in another; None where nothing relates them."""
        if frame == common:
            return _HERE
        mine, others = self._chain(frame), self._chain(common)
        meeting = next((above for above in mine if above in others), None)
        return None if meeting is None else mine[meeting].within(others[meeting].inverse())

    def _knows(self, frame: str) -> bool:
        return frame in self._above or any(parent == frame for parent, _ in self._above.values())

    def _chain(self, frame: str) -> dict[str, Placement]:
        """The frame in itself, then in each one above it."""
        chain = {frame: _HERE}
        while (found := self._above.get(frame)) is not None and found[0] not in chain:
            chain[found[0]] = chain[frame].within(found[1])
            frame = found[0]
        return chain
