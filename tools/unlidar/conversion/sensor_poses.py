"""The common coordinate frame of a bag's sensors, and poses in it."""

from collections.abc import Mapping

import numpy as np

from unlidar.conversion.carriers import Carriers
from unlidar.conversion.transforms import Placement, StaticTransforms, plain_frame
from unlidar.poses import Poses
from unlidar.station import Pose

Position = tuple[float, float, float]


class SensorPoses:
    """Poses of sensors and positions of truth in the common frame, as far as that is known.

    That of sensors that move is the world of their carriers.
    """

    def __init__(
        self,
        transforms: StaticTransforms,
        frames: Mapping[str, str],
        carriers: Carriers | None = None,
    ) -> None:
        """`frames`: the frame_id of each sensor, empty if it has none."""
        self._transforms, self._carriers = transforms, carriers
        self.common = carriers.world if carriers else transforms.common_frame(frames.values())
        # Without transforms all LiDARs are assumed to share one pose.
        self._reference = self.common or next((f for f in frames.values() if f), "")
        self._frames = dict(frames)
        self._unrelated: dict[str, None] = {}  # frames of truth, in order

    def add_sensor(self, name: str, frame_id: str) -> None:
        """Adds a sensor that was first seen during the conversion."""
        if not self._frames.get(name):
            self._frames[name] = plain_frame(frame_id)

    def mountings(self) -> dict[str, Pose]:
        """The poses of all sensors, on their carriers if they move; empty if none is known."""
        if self.common is None:
            return {}
        known = self._carriers.mounting if self._carriers else self._known
        return {name: _pose(known(frame)) for name, frame in self._frames.items()}

    def poses(self) -> dict[str, Poses]:
        """The poses of the carriers of the sensors that move."""
        if self._carriers is None:
            return {}
        found = {name: self._carriers.poses(frame) for name, frame in self._frames.items()}
        return {name: poses for name, poses in found.items() if poses is not None}

    def truth(self, frame_id: str, xyz_m: Position, stamp_ns: int) -> Position:
        """A truth position in the common frame; unchanged if no transform relates the two."""
        frame = plain_frame(frame_id)
        if frame == self._reference:
            return xyz_m
        placement = self._known(frame, stamp_ns)
        if placement is None:
            self._unrelated[frame] = None
            return xyz_m
        x, y, z = placement.apply(np.array(xyz_m))
        return float(x), float(y), float(z)

    def notes(self) -> list[str]:
        """Notes on the common frame, and on frames without a relation to it."""
        notes = []
        if self.common is not None and self._carriers is None:
            notes.append(
                f"positions are in the frame '{self.common}' of /tf_static, see station.yaml"
            )
        lost = {frame: None for frame in self._frames.values() if self._is_unrelated(frame)}
        if lost:
            notes.append(
                f"no /tf_static relates {_quoted(lost)} of LiDARs to '{self._reference}': "
                "taken to be the same place"
            )
        truths = [frame for frame in self._unrelated if self._is_unrelated(frame)]
        if truths:
            notes.append(
                f"no /tf_static relates {_quoted(truths)} of the truth to '{self._reference}': "
                "taken to be the same place"
            )
        if self._transforms.unusable:
            notes.append(
                f"/tf_static: transforms of {_quoted(dict.fromkeys(self._transforms.unusable))} "
                "are none, left out"
            )
        return notes

    def _known(self, frame: str, stamp_ns: int = 0) -> Placement | None:
        if self._carriers is not None:
            return self._carriers.placement(frame, stamp_ns)
        return self._transforms.placement(frame, self._reference)

    def _is_unrelated(self, frame: str) -> bool:
        """True for a named frame without a relation; unnamed frames are not reported."""
        return bool(frame and self._reference) and self._known(frame) is None


def _pose(placement: Placement | None) -> Pose:
    if placement is None:
        return Pose()
    x, y, z = (float(v) for v in placement.translation_m)
    i, j, k, w = (float(v) for v in placement.rotation.as_quat())
    return Pose((x, y, z), (i, j, k, w))


def _quoted(names: Mapping[str, None] | list[str]) -> str:
    return ", ".join(f"'{name}'" for name in names)
