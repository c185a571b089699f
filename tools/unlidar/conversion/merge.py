"""Several messages of a rosette scanner as one frame."""

from collections.abc import Iterable, Iterator

import numpy as np

from unlidar.conversion.source import SourceFrame, TruthRow
from unlidar.errors import InputError
from unlidar.point_times import OFFSET_FIELD
from unlidar.stamps import parse_stamp_ns


def merged(
    items: Iterable[SourceFrame | TruthRow], messages: int
) -> Iterator[SourceFrame | TruthRow]:
    """Joins messages of one sensor to frames with the stamp of their first; the last has fewer.

    Points without a time of their own get that of their message.
    """
    waiting: dict[str, list[SourceFrame]] = {}
    broken = None
    try:
        for item in items:
            if isinstance(item, TruthRow) or messages == 1:
                yield item
                continue
            parts = waiting.setdefault(item.sensor, [])
            parts.append(item)
            if len(parts) == messages:
                yield _one(waiting.pop(item.sensor))
    except InputError as error:
        broken = error
    for parts in waiting.values():
        yield _one(parts)
    if broken is not None:
        raise broken


def _one(parts: list[SourceFrame]) -> SourceFrame:
    first = parts[0]
    begin_ns = parse_stamp_ns(first.stamp)
    offsets = []
    for part in parts:
        own = part.fields.get(OFFSET_FIELD, np.zeros(len(part.xyz_m), dtype=np.int64))
        offsets.append(own.astype(np.int64) + (parse_stamp_ns(part.stamp) - begin_ns))
    common = set.intersection(*(set(part.fields) for part in parts)) - {OFFSET_FIELD}
    fields = {
        name: np.concatenate([part.fields[name] for part in parts])
        for name in first.fields
        if name in common
    }
    xyz_m = np.concatenate([part.xyz_m for part in parts])
    return SourceFrame(
        first.sensor, first.stamp, xyz_m, {OFFSET_FIELD: np.concatenate(offsets), **fields}
    )
