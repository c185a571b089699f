"""Truth out of messages: positions of a target in metres."""

import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np

from unlidar_tools.geodesy import Origin, from_geodetic

Position = tuple[float, float, float]

FIX = "sensor_msgs/msg/NavSatFix"
_NO_FIX = -1  # sensor_msgs/NavSatStatus.msg


def _xyz(point: Any) -> Position:
    return float(point.x), float(point.y), float(point.z)


_POINTS: dict[str, Callable[[Any], Any]] = {
    "geometry_msgs/msg/PointStamped": lambda m: m.point,
    "geometry_msgs/msg/PoseStamped": lambda m: m.pose.position,
    "geometry_msgs/msg/TransformStamped": lambda m: m.transform.translation,
    "geometry_msgs/msg/PoseWithCovarianceStamped": lambda m: m.pose.pose.position,
    "nav_msgs/msg/Odometry": lambda m: m.pose.pose.position,
}
# In the order in which one is taken for the truth where several could be.
POSITION_TYPES = (*_POINTS, FIX)

# What topics of truth are called: by what it is, or by what measures it. The short ones are words
# of their own, the long ones may be parts of words.
_TRUTH_WORDS = ("gt", "rtk", "ppk")
_TRUTH_PARTS = (
    "truth", "vicon", "mocap", "motioncapture", "optitrack", "natnet", "vrpn", "qualisys",
    "leica", "prism", "totalstation", "lasertracker",
)  # fmt: skip


def says_truth(topic: str) -> bool:
    """Whether the name of a topic of positions says that they are the truth."""
    words = re.findall("[a-z]+", re.sub(r"(?<=[a-z])(?=[A-Z])", "_", topic).lower())
    return any(word in words for word in _TRUTH_WORDS) or any(
        part in "".join(words) for part in _TRUTH_PARTS
    )


class Positions:
    """Turns the messages of truth topics into positions; GNSS fixes about one origin for all."""

    def __init__(self, origin: Origin | None) -> None:
        self.origin_given = origin is not None
        self.origin = origin
        self.fixes = 0
        self.skipped = 0

    def read(self, message: Any, msgtype: str) -> Position | None:
        """Of a message; None if it has no fix or a coordinate that is not finite."""
        is_fix = msgtype == FIX
        position = self._read_fix(message) if is_fix else _xyz(_POINTS[msgtype](message))
        if position is None or not all(math.isfinite(v) for v in position):
            self.skipped += 1
            return None
        return position

    def _read_fix(self, message: Any) -> Position | None:
        fix = (float(message.latitude), float(message.longitude), float(message.altitude))
        if not all(math.isfinite(v) for v in fix) or int(message.status.status) <= _NO_FIX:
            return None
        self.fixes += 1
        if self.origin is None:
            self.origin = Origin(*fix)
        east, north, up = from_geodetic(self.origin, np.array([fix]))[0]
        return float(east), float(north), float(up)

    def origin_text(self) -> str | None:
        """The origin of the fixes as `--origin` takes it; None if there were none."""
        if not self.fixes or self.origin is None:
            return None
        o = self.origin
        return f"{o.latitude_deg!r},{o.longitude_deg!r},{o.height_m!r}"
