"""Which topic of a bag tells how its LiDARs move: /tf, odometry, or the one that is asked for."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from unlidar.conversion.bag_topics import BagTopics, Topic
from unlidar.conversion.carriers import Carriers, Motion
from unlidar.conversion.transforms import (
    AT_REST,
    ODOMETRY,
    TRANSFORM_TYPES,
    Placement,
    StaticTransforms,
    placement_of,
    plain_frame,
)
from unlidar.errors import listed

_WORLD = "world"  # of poses without a frame_id
Stamp = Callable[[Any], int]  # of a header, in ns
# Function: a topic -> its messages up to the first damage, each with the clock of its stamps.
Read = Callable[[str], Iterator[tuple[Any, Stamp]]]


@dataclass
class BagPoses:
    """How the LiDARs of a bag move."""

    carriers: Carriers | None = None  # None: they do not, as far as is known
    topic: str | None = None
    notes: list[str] = field(default_factory=list)


def find_poses(
    topics: BagTopics, static: StaticTransforms, frames: Iterable[str], read: Read
) -> BagPoses:
    """The carriers by the topic asked for; else by /tf; else by odometry of what bears a LiDAR.

    `frames`: those of the LiDARs. Where several topics of odometry do, the one with the most
    messages counts. Without a motion nothing is taken.
    """
    frames = list(dict.fromkeys(frames))
    asked = topics.poses_topic
    if asked == AT_REST:
        return BagPoses()
    moving = [t for t in topics.all.values() if t.msgtype in TRANSFORM_TYPES and not t.is_static]
    if asked is not None:
        return _asked_for(topics.all[asked], static, frames, read)
    found = _by_transforms(moving, static, frames, read)
    return found or _by_odometry(topics, static, frames, read)


def _by_transforms(
    topics: list[Topic], static: StaticTransforms, frames: list[str], read: Read
) -> BagPoses | None:
    motions = [motion for topic in topics for motion in _transforms(topic, read)]
    carriers = Carriers(static, motions, frames)
    if carriers.world is None:
        return None
    name = listed(topic.name for topic in topics)
    note = f"the LiDARs move: their poses in '{carriers.world}' are taken from {name}"
    return BagPoses(carriers, name, [note])


def _by_odometry(
    topics: BagTopics, static: StaticTransforms, frames: list[str], read: Read
) -> BagPoses:
    bodies = {static.root(frame) for frame in frames}
    candidates = sorted(
        (t for t in topics.all.values() if t.msgtype == ODOMETRY and t.name not in topics.truths),
        key=lambda topic: -topic.messages,
    )
    used, others, strangers = BagPoses(), [], []
    for topic in candidates:
        motions = _odometry(topic, read)
        carriers = Carriers(static, motions, frames)
        if carriers.world is None:
            if any(static.root(motion.child) not in bodies for motion in motions):
                strangers.append(topic.name)
        elif used.carriers is None:
            note = f"the LiDARs move: their poses in '{carriers.world}' are taken from {topic.name}"
            used = BagPoses(carriers, topic.name, [note])
        else:
            others.append(topic.name)
    if others:
        used.notes[0] += f" and not {listed(others)}: --poses-topic for another"
    if strangers and used.carriers is None:
        used.notes.append(
            f"the LiDARs are taken to be at rest: no /tf_static relates them to what moves by "
            f"{listed(strangers)}, --poses-topic takes one"
        )
    return used


def _asked_for(topic: Topic, static: StaticTransforms, frames: list[str], read: Read) -> BagPoses:
    """By one topic. Poses of nothing, or of what nothing relates to a LiDAR, are of every LiDAR."""
    if topic.msgtype in TRANSFORM_TYPES:
        motions = _transforms(topic, read)
    else:
        bodies = {static.root(frame) for frame in frames}
        motions = _odometry(topic, read)
        if not any(static.root(motion.child) in bodies for motion in motions):
            motions = [motion.of(body) for motion in motions for body in sorted(bodies)]
    carriers = Carriers(static, motions, frames)
    if carriers.world is None:
        return BagPoses(None, None, [f"{topic.name}: moves no LiDAR, they are taken to be at rest"])
    note = f"poses of the LiDARs in '{carriers.world}' are taken from {topic.name} (as asked for)"
    return BagPoses(carriers, topic.name, [note])


def _transforms(topic: Topic, read: Read) -> list[Motion]:
    motions: dict[tuple[str, str], Motion] = {}
    for message, stamp in read(topic.name):
        for stamped in message.transforms:
            placement = placement_of(stamped.transform.translation, stamped.transform.rotation)
            names = stamped.header.frame_id, stamped.child_frame_id
            _add(motions, *names, stamp(stamped.header), placement)
    return list(motions.values())


def _odometry(topic: Topic, read: Read) -> list[Motion]:
    motions: dict[tuple[str, str], Motion] = {}
    for message, stamp in read(topic.name):
        pose = message.pose
        while not hasattr(pose, "position"):  # with a covariance
            pose = pose.pose
        child = message.child_frame_id if topic.msgtype == ODOMETRY else ""
        placement = placement_of(pose.position, pose.orientation)
        _add(motions, message.header.frame_id or _WORLD, child, stamp(message.header), placement)
    return list(motions.values())


def _add(
    motions: dict[tuple[str, str], Motion],
    parent: str,
    child: str,
    stamp_ns: int,
    placement: Placement | None,
) -> None:
    key = plain_frame(parent), plain_frame(child)
    if placement is not None and key[0] != key[1]:
        motions.setdefault(key, Motion(*key)).add(stamp_ns, placement)
