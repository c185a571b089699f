"""Truth out of messages: positions of a target in metres."""

import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np

from unlidar.geodesy import Origin, from_geodetic

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
# In order of preference where several topics could be the truth.
POSITION_TYPES = (*_POINTS, FIX)

# Names of truth topics, by content or by instrument. Short ones must be whole words, long ones may
# be parts of words.
_TRUTH_WORDS = ("gt", "rtk", "ppk")
_TRUTH_PARTS = (
    "truth", "vicon", "mocap", "motioncapture", "optitrack", "natnet", "vrpn", "qualisys",
    "leica", "prism", "totalstation", "lasertracker",
)  # fmt: skip


def says_truth(topic: str) -> bool:
    """True if the name of a position topic marks it as truth."""
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
        """The position (x, y, z) in m of a message; None without a fix or if not finite."""
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
        if abs(fix[0]) > 90 or abs(fix[1]) > 360:  # no place on Earth
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
