"""What is kept of a recording's frames and truth, and what is left out, with the reason."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from unlidar.conversion.merge import merged
from unlidar.conversion.source import Options, SourceFrame, TruthRow, Unreadable
from unlidar.errors import InputError
from unlidar.frames_io import is_return
from unlidar.stamps import parse_stamp_ns


class KeptItems:
    """Joins messages to frames; leaves out rays without a return and, if asked, what is bad."""

    def __init__(self, path: Path, options: Options) -> None:
        self._path, self._options = path, options
        self.left_out: dict[str, int] = {}  # frames and rows of truth, by topic or sensor
        self._why: dict[str, str] = {}  # reason for the first of them
        self._stamps: dict[tuple[str, int], str] = {}

    def of(
        self, items: Iterable[SourceFrame | TruthRow | Unreadable]
    ) -> Iterator[SourceFrame | TruthRow]:
        """The items to use. InputError for a bad one, unless `skip_bad` leaves such out."""
        for item in merged(self._readable(items), self._options.merge):
            if isinstance(item, TruthRow):
                yield item
            elif self._is_new(item):
                with np.errstate(over="ignore"):  # to what is not finite
                    xyz_m = item.xyz_m.astype(np.float32)
                kept = is_return(xyz_m)
                fields = {name: column[kept] for name, column in item.fields.items()}
                yield replace(item, xyz_m=xyz_m[kept], fields=fields)

    def stamps_ns(self) -> list[int]:
        """Of the frames so far."""
        return [stamp_ns for _, stamp_ns in self._stamps]

    def notes(self) -> list[str]:
        """Notes on items left out."""
        return [
            f"{where}: left out {count}, the first: {self._why[where]}"
            for where, count in self.left_out.items()
        ]

    def refuse_nothing(self, broken: str | None) -> None:
        """InputError for a recording of no frames that has, or may have, some."""
        why = broken or next(iter(self._why.values()), None)
        if why is not None:
            raise InputError(f"{why}; no frame could be read")
        if self._options.start_s or self._options.duration_s is not None:
            raise InputError(f"{self._path}: no frame lies in the time asked for")

    def _readable(
        self, items: Iterable[SourceFrame | TruthRow | Unreadable]
    ) -> Iterator[SourceFrame | TruthRow]:
        for item in items:
            if isinstance(item, Unreadable):
                self._leave_out(item.where, item.why)
            else:
                yield item

    def _is_new(self, frame: SourceFrame) -> bool:
        key = (frame.sensor, parse_stamp_ns(frame.stamp))
        if key not in self._stamps:
            self._stamps[key] = frame.stamp
            return True
        self._leave_out(
            frame.sensor,
            f"{self._path}: two frames of {frame.sensor} at one time, {self._stamps[key]} and "
            f"{frame.stamp}; --stamp log may tell those of a bag apart",
        )
        return False

    def _leave_out(self, where: str, why: str) -> None:
        if not self._options.skip_bad:
            raise InputError(f"{why} (--skip-bad leaves such out)")
        self.left_out[where] = self.left_out.get(where, 0) + 1
        self._why.setdefault(where, why)
