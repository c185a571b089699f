"""The rules of the standard that a message itself declares: what must be there, and ids."""

import re
import uuid
from collections.abc import Iterator

from google.protobuf.descriptor import FieldDescriptor, OneofDescriptor
from google.protobuf.message import Message
from sapient_msg import proto_options_pb2

_ULID = re.compile("[0-7][0-9A-HJKMNP-TV-Z]{25}")
_UUID_VERSION = 4
_OURS = "sapient_msg."  # prefix of the standard's types, which declare rules


def faults(message: Message, path: str = "") -> Iterator[str]:
    """The violated rules of a message and all in it, each with the path of its field."""
    for oneof in message.DESCRIPTOR.oneofs:
        if _is_mandatory_choice(oneof) and message.WhichOneof(oneof.name) is None:
            yield f"{path}{oneof.name}: is missing"
    for field in message.DESCRIPTOR.fields:
        where = f"{path}{field.name}"
        values = _values(message, field)
        options = field.GetOptions().Extensions[proto_options_pb2.field_options]
        if options.is_mandatory and not values:
            yield f"{where}: is missing"
        for value in values:
            if options.is_uuid and not _is_uuid(value):
                yield f"{where}: is no UUID of version {_UUID_VERSION}"
            if options.is_ulid and not _ULID.fullmatch(value):
                yield f"{where}: is no ULID"
            if field.type == FieldDescriptor.TYPE_ENUM:
                number = field.enum_type.values_by_number.get(value)
                if number is None or (options.is_mandatory and value == 0):
                    yield f"{where}: {value} is none of its values"
            if field.message_type is not None and field.message_type.full_name.startswith(_OURS):
                yield from faults(value, f"{where}.")


def _values(message: Message, field: FieldDescriptor) -> list:
    value = getattr(message, field.name)
    if field.is_repeated:
        return list(value)
    if field.has_presence:
        return [value] if message.HasField(field.name) else []
    return [value] if value else []


def _is_mandatory_choice(oneof: OneofDescriptor) -> bool:
    return oneof.GetOptions().Extensions[proto_options_pb2.oneof_options].is_mandatory


def _is_uuid(text: str) -> bool:
    try:
        value = uuid.UUID(text)
    except ValueError:
        return False
    return str(value) == text and value.version == _UUID_VERSION
