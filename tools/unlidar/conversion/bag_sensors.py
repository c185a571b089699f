"""Sensors of a bag: a topic is one LiDAR, or one for each of its frame_ids."""

from collections.abc import Mapping, Sequence

from unlidar.conversion.transforms import plain_frame
from unlidar.names import folder_names

# Topics of the MMAUD data set with the names of its folders.
_MMAUD = {"/livox_mid360/lidar": "lidar_360", "/livox_avia/lidar": "livox_avia"}


class BagSensors:
    """Sensor names by topic and frame_id, valid as folder names."""

    def __init__(self, frame_ids: Mapping[str, Sequence[str]]) -> None:
        """`frame_ids`: those seen in each cloud topic; empty where it has no messages."""
        self._labels: list[str] = []
        self._names: dict[tuple[str, str | None], str] = {}
        for topic, seen in frame_ids.items():
            frames = list(dict.fromkeys(map(plain_frame, seen)))
            if len(frames) < 2:
                self._add(topic, frames[0] if frames else None, _label(topic))
                continue
            for frame in frames:
                self._add(topic, frame, frame or _label(topic))

    def name(self, topic: str, frame_id: str) -> str:
        """The sensor name of a message; an unknown frame_id adds a sensor."""
        frame = plain_frame(frame_id)
        if (topic, frame) not in self._names:
            if (topic, None) in self._names:
                self._names[topic, frame] = self._names.pop((topic, None))
            else:
                self._add(topic, frame, frame or _label(topic))
        return self._names[topic, frame]

    def all(self) -> dict[str, str]:
        """The topic of every sensor."""
        return {name: topic for (topic, _), name in self._names.items()}

    def of_topic(self, topic: str) -> list[str]:
        """The sensors of a topic; none if it is no topic of clouds."""
        return [name for (of, _), name in self._names.items() if of == topic]

    def frames(self) -> dict[str, str]:
        """The frame_id of every sensor; empty where it has none."""
        return {name: frame or "" for (_, frame), name in self._names.items()}

    def _add(self, topic: str, frame: str | None, label: str) -> None:
        # Existing names never change.
        self._labels.append(label)
        self._names[topic, frame] = folder_names(self._labels)[-1]


def _label(topic: str) -> str:
    return _MMAUD.get(topic, topic.strip("/"))
