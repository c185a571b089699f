"""What a file of events held before the start, without what matters no more.

A station's file of a day has millions of lines. Nearly all are positions of tracks that have ended,
and as long as they are read a relay tells nothing of now.
"""

import re
from collections.abc import Iterable
from typing import BinaryIO

from unlidar.events.lines import Lines

_RECENT_S = 60.0  # tracks that ended as near to the end are read: it may not have been told
_CHUNK = 1 << 20
# As the engine begins its lines; others are read.
_AT = re.compile(rb'\{"event": ?"\w+", ?"at": ?(-?\d+)')
_END = re.compile(rb'\{"event": ?"end", ?"at": ?(-?\d+)[.\d]*, ?"track": ?(\d+)[,}]')
_POSITION = re.compile(rb'\{"event": ?"(?:row|now)", ?"at": ?[-.\d]+, ?"track": ?(\d+)[,}]')
_RETURNS = re.compile(rb'\{"event": ?"returns"')


class Bygone:
    """The tracks that ended in the first part of a file, and at which of its lines."""

    def __init__(self, file: BinaryIO, old_bytes: int) -> None:
        """Reads `old_bytes` from the file's begin. OSError."""
        ends: dict[bytes, tuple[int, int]] = {}  # of a track: number of the line, second
        number = newest_s = 0
        cut = Lines()
        while data := file.read(min(_CHUNK, old_bytes)):
            old_bytes -= len(data)
            lines = cut.take(data)
            for line in lines:
                number += 1
                if found := _END.match(line):
                    ends[found[2]] = number, int(found[1])
            if lines and (found := _AT.match(lines[-1])):
                newest_s = int(found[1])
        self._ends = {
            track: number for track, (number, at_s) in ends.items() if at_s < newest_s - _RECENT_S
        }
        self._number = 0  # of the last line that was asked for

    def rest(self, lines: Iterable[bytes]) -> list[bytes]:
        """What matters of the part's next lines: no position before its track's end, no returns."""
        rest = []
        for line in lines:
            self._number += 1
            if found := _POSITION.match(line):
                matters = self._number > self._ends.get(found[1], 0)
            else:
                matters = _RETURNS.match(line) is None
            if matters:
                rest.append(line)
        return rest
