"""The frame that all sensors of a bag have in common, and what lies where in it."""

from collections.abc import Mapping

import numpy as np

from unlidar_tools.conversion.transforms import Placement, StaticTransforms, plain_frame
from unlidar_tools.station import Pose

Position = tuple[float, float, float]


class SensorPoses:
    """Poses of sensors and positions of truth, in the common frame as far as it is known."""

    def __init__(self, transforms: StaticTransforms, frames: Mapping[str, str]) -> None:
        """The frame_id of each sensor; empty where it has none."""
        self._transforms = transforms
        self.common = transforms.common_frame(frames.values())
        # Without transforms the LiDARs are taken to stand at one place, as they always were.
        self._reference = self.common or next((f for f in frames.values() if f), "")
        self._frames = dict(frames)
        self._unrelated: dict[str, None] = {}  # frames of truth, in order

    def add_sensor(self, name: str, frame_id: str) -> None:
        """One whose frame_id was not known before."""
        if not self._frames.get(name):
            self._frames[name] = plain_frame(frame_id)

    def poses(self) -> dict[str, Pose]:
        """Of the sensors, if anything is known of one."""
        if self.common is None:
            return {}
        return {name: _pose(self._known(frame)) for name, frame in self._frames.items()}

    def truth(self, frame_id: str, xyz_m: Position) -> Position:
        """A position of truth in the common frame; as it is where nothing relates the two."""
        frame = plain_frame(frame_id)
        if frame == self._reference:
            return xyz_m
        placement = self._known(frame)
        if placement is None:
            self._unrelated[frame] = None
            return xyz_m
        x, y, z = placement.apply(np.array(xyz_m))
        return float(x), float(y), float(z)

    def notes(self) -> list[str]:
        """What is common, and what could not be related to it."""
        notes = []
        if self.common is not None:
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

    def _known(self, frame: str) -> Placement | None:
        return self._transforms.placement(frame, self._reference)

    def _is_unrelated(self, frame: str) -> bool:
        """Frames without a name are not spoken of: nothing can be known of them."""
        return bool(frame and self._reference) and self._known(frame) is None


def _pose(placement: Placement | None) -> Pose:
    if placement is None:
        return Pose()
    x, y, z = (float(v) for v in placement.translation_m)
    i, j, k, w = (float(v) for v in placement.rotation.as_quat())
    return Pose((x, y, z), (i, j, k, w))


def _quoted(names: Mapping[str, None] | list[str]) -> str:
    return ", ".join(f"'{name}'" for name in names)
