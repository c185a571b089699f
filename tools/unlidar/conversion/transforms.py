"""/tf_static: fixed transforms between the coordinate frames of a recording."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

TRANSFORM_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
ODOMETRY = "nav_msgs/msg/Odometry"
# Messages that can tell how a LiDAR moves.
POSE_TYPES = (
    *TRANSFORM_TYPES,
    ODOMETRY,
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
)
AT_REST = "none"  # in place of a topic that tells how the LiDARs move
# A float32 holds a millimetre up to here; earth-centred and map-grid frames begin farther off.
FARTHEST_M = 10_000.0
_LEAST_NORM = 0.1  # of a usable quaternion


class Placement:
    """The pose of a frame in another: p_other = rotation * p + translation_m."""

    def __init__(self, rotation: Rotation, translation_m: np.ndarray) -> None:
        self.rotation, self.translation_m = rotation, translation_m

    def apply(self, xyz_m: np.ndarray) -> np.ndarray:
        """Transforms positions (..., 3) from the frame to the other."""
        return self.rotation.apply(xyz_m) + self.translation_m

    def within(self, outer: "Placement") -> "Placement":
        """The composition with the other frame's own placement."""
        return Placement(outer.rotation * self.rotation, outer.apply(self.translation_m))

    def inverse(self) -> "Placement":
        """The inverse placement."""
        turned = self.rotation.inv()
        return Placement(turned, -turned.apply(self.translation_m))


HERE = Placement(Rotation.identity(), np.zeros(3))


def placement_of(position: Any, orientation: Any) -> Placement | None:
    """The placement that a message holds; None if it is none."""
    p, q = position, orientation
    translation = np.array([p.x, p.y, p.z], dtype=float)
    quaternion = np.array([q.x, q.y, q.z, q.w], dtype=float)
    numbers = np.isfinite(translation).all() and np.isfinite(quaternion).all()
    if not numbers or np.linalg.norm(quaternion) < _LEAST_NORM:
        return None
    return Placement(Rotation.from_quat(quaternion), translation)


def is_static_topic(topic: str, msgtype: str) -> bool:
    """True for a topic of static transforms; /tf has the same type but changes over time."""
    return msgtype in TRANSFORM_TYPES and topic.rstrip("/").endswith("tf_static")


def plain_frame(frame_id: str) -> str:
    """The frame_id without the leading slash of ROS 1."""
    return frame_id.strip("/")


class StaticTransforms:
    """A forest of frames, each with its placement in its parent."""

    def __init__(self) -> None:
        self._above: dict[str, tuple[str, Placement]] = {}
        self.unusable: list[str] = []  # child frames of invalid transforms

    def add(self, message: Any) -> None:
        """Adds the transforms of a TFMessage; later ones replace earlier ones."""
        for stamped in message.transforms:
            parent, child = (
                plain_frame(stamped.header.frame_id),
                plain_frame(stamped.child_frame_id),
            )
            placement = placement_of(stamped.transform.translation, stamped.transform.rotation)
            if parent == child or placement is None:
                self.unusable.append(child)
                continue
            self._above[child] = (parent, placement)

    def __bool__(self) -> bool:
        """True if anything is known."""
        return bool(self._above)

    def common_frame(self, frames: Iterable[str]) -> str | None:
        """The common ancestor of these frames: the uppermost that is not too far off.

        Usually that of the station or of its surroundings, with its z axis up. None where nothing
        is known of any; frames that cannot be related to the first one known do not count.
        """
        chains = [self.chain(frame) for frame in dict.fromkeys(frames) if self._knows(frame)]
        if not chains:
            return None
        related = [chain for chain in chains if list(chain)[-1] == list(chains[0])[-1]]
        shared = [frame for frame in chains[0] if all(frame in chain for chain in related)]
        near = [
            frame
            for frame in shared
            if all(np.linalg.norm(c[frame].translation_m) <= FARTHEST_M for c in related)
        ]
        return near[-1] if near else shared[0]

    def placement(self, frame: str, common: str) -> Placement | None:
        """The placement of a frame in another; None if no transforms relate them."""
        if frame == common:
            return HERE
        mine, others = self.chain(frame), self.chain(common)
        meeting = next((above for above in mine if above in others), None)
        return None if meeting is None else mine[meeting].within(others[meeting].inverse())

    def root(self, frame: str) -> str:
        """The uppermost ancestor of a frame: frames with the same one are one rigid body."""
        return list(self.chain(frame))[-1]

    def _knows(self, frame: str) -> bool:
        return frame in self._above or any(parent == frame for parent, _ in self._above.values())

    def chain(self, frame: str) -> dict[str, Placement]:
        """The frame's placement in itself, then in each ancestor."""
        chain = {frame: HERE}
        while (found := self._above.get(frame)) is not None and found[0] not in chain:
            chain[found[0]] = chain[frame].within(found[1])
            frame = found[0]
        return chain
