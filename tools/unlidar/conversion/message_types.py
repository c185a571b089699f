"""Message definitions: those of the bag, else the known ones."""

from functools import cache

from rosbags.interfaces import Connection, ConnectionExtRosbag1, MessageDefinitionFormat
from rosbags.typesys import (
    Stores,
    TypesysError,
    get_types_from_idl,
    get_types_from_msg,
    get_typestore,
)
from rosbags.typesys.store import Typestore

from unlidar.errors import reason

ROS1_ENCODING, ROS2_ENCODING = "ros1", "cdr"
# One layout in all of Livox's drivers.
LIVOX_PACKAGES = ("livox_ros_driver", "livox_ros_driver2", "livox_interfaces")
LIVOX_CLOUDS = tuple(f"{package}/msg/CustomMsg" for package in LIVOX_PACKAGES)
_LIVOX_POINT = """
uint32 offset_time
float32 x
float32 y
float32 z
uint8 reflectivity
uint8 tag
uint8 line
"""
_LIVOX_CLOUD = """
std_msgs/Header header
uint64 timebase
uint32 point_num
uint8 lidar_id
uint8[3] rsvd
CustomPoint[] points
"""
_IDL_SEPARATOR = "=" * 80 + "\n"


def encoding_of(connection: Connection) -> str:
    """The message encoding of a topic: ROS 1, ROS 2, or another."""
    extension = connection.ext
    if isinstance(extension, ConnectionExtRosbag1):
        return ROS1_ENCODING
    return extension.serialization_format


def is_ros1(connection: Connection) -> bool:
    """True if messages are serialised as in ROS 1."""
    return encoding_of(connection) == ROS1_ENCODING


def register_livox(store: Typestore) -> Typestore:
    """Adds the messages of Livox's drivers to a store of types."""
    for package in LIVOX_PACKAGES:
        types = get_types_from_msg(_LIVOX_POINT, f"{package}/msg/CustomPoint")
        types |= get_types_from_msg(_LIVOX_CLOUD, f"{package}/msg/CustomMsg")
        store.register(types)
    return store


@cache
def known_types() -> Typestore:
    """Types for bags of ROS 2 without definitions, as all .db3 before Iron."""
    return register_livox(get_typestore(Stores.ROS2_HUMBLE))


def types_of(connection: Connection) -> Typestore:
    """The types of one topic, from the bag's own definition where it has one.

    ValueError if the definition cannot be understood or is unknown.
    """
    definition = connection.msgdef
    if definition.format == MessageDefinitionFormat.NONE or not definition.data.strip():
        if is_ros1(connection) or connection.msgtype not in known_types().fielddefs:
            raise ValueError(f"the bag has no definition of {connection.msgtype}")
        return known_types()
    return _types_from_text(connection.msgtype, definition.format, definition.data)


@cache
def _types_from_text(msgtype: str, kind: MessageDefinitionFormat, text: str) -> Typestore:
    store = get_typestore(Stores.EMPTY)
    try:
        for part in text.split(_IDL_SEPARATOR):
            if kind == MessageDefinitionFormat.MSG:
                store.register(get_types_from_msg(text, msgtype))
                break
            if idl := part.partition("\n")[2] if part.startswith("IDL: ") else part:
                store.register(get_types_from_idl(idl))
        store.get_msgdef(msgtype)
    except (TypesysError, LookupError, SyntaxError, ValueError, TypeError) as error:
        said = f"the bag's definition of {msgtype} cannot be understood: {reason(error)}"
        raise ValueError(said) from error
    return store
