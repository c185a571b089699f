"""ULIDs of messages and objects, and the UUID of a node."""

import hashlib
import os
import platform
import time
import uuid
from pathlib import Path

_CROCKFORD = "0123456789ABCDEFGHJKMNPQRSTVWXYZ"
_CHARACTERS, _BITS = 26, 5
_TIME_BYTES, _REST_BYTES = 6, 10
_MACHINE_ID = Path("/etc/machine-id")


def new_ulid() -> str:
    """A ULID of now."""
    return _ulid(time.time_ns(), os.urandom(_REST_BYTES))


def lasting_ulid(stamp_ns: int, *of: object) -> str:
    """The ULID of a thing: the same in every connection and after every start."""
    return _ulid(stamp_ns, _digest(*of)[:_REST_BYTES])


def lasting_node_id(station: str) -> str:
    """The UUID of a station on this computer, the same after every start.

    Version 4, as the standard asks, by its bits; not random, as there is nowhere to keep it.
    """
    try:
        machine = _MACHINE_ID.read_text().strip()
    except (OSError, ValueError):
        machine = ""
    return str(uuid.UUID(bytes=_digest(machine or platform.node(), station)[:16], version=4))


def _ulid(stamp_ns: int, rest: bytes) -> str:
    stamp_ms = min(max(stamp_ns // 1_000_000, 0), (1 << 8 * _TIME_BYTES) - 1)
    value = int.from_bytes(stamp_ms.to_bytes(_TIME_BYTES, "big") + rest, "big")
    digits = (value >> _BITS * i & 31 for i in reversed(range(_CHARACTERS)))
    return "".join(_CROCKFORD[digit] for digit in digits)


def _digest(*of: object) -> bytes:
    return hashlib.sha256("\0".join(map(str, of)).encode()).digest()
