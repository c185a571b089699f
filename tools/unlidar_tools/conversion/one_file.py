"""What recordings that are one file without truth have in common."""

from collections.abc import Iterator, Sized
from contextlib import contextmanager
from typing import ClassVar

from unlidar_tools.conversion.source import Stream
from unlidar_tools.errors import InputError
from unlidar_tools.station import Pose


class OneFileSource:
    """The file is read twice, for `sensors` and for the frames; nothing is open between."""

    keeps_beginning: ClassVar[bool] = True
    truths: int = 0
    sensors: dict[str, int]
    _spans_ns: dict[str, tuple[int, int]]
    _holds: ClassVar[str]  # what its sensors sent

    def lidars(self) -> list[str]:
        """All of them."""
        return list(self.sensors)

    def streams(self) -> list[Stream]:
        """All of them."""
        return [Stream(name, self._holds, n, "frames") for name, n in self.sensors.items()]

    def spans_ns(self) -> dict[str, tuple[int, int]]:
        """As the first reading found them."""
        return self._spans_ns

    def total(self, sensors: list[str]) -> int:
        """Their frames, as the first reading counted them."""
        return sum(self.sensors[name] for name in sensors)

    def station(self) -> dict[str, Pose]:
        """Such files do not tell where a LiDAR stands."""
        return {}

    def notes(self) -> list[str]:
        """None."""
        return []

    def facts(self) -> dict:
        """Nothing besides."""
        return {}

    def close(self) -> None:
        """Nothing is open between the calls."""


@contextmanager
def up_to_damage(found: Sized) -> Iterator[None]:
    """Ends the first reading where the file is broken; items() meets that behind what can be kept.

    InputError if nothing was found before.
    """
    try:
        yield
    except InputError:
        if not found:
            raise
