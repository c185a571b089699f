"""Base class of recordings that are one file without truth."""

from collections.abc import Iterable, Iterator, Sized
from contextlib import contextmanager
from typing import ClassVar, Generic, TypeVar

from unlidar.conversion.source import Stream
from unlidar.errors import InputError
from unlidar.poses import Poses
from unlidar.station import Pose

T = TypeVar("T")


class OneFileSource:
    """Reads the file twice, for `sensors` and for the frames; it is closed in between."""

    keeps_beginning: ClassVar[bool] = True
    truths: int = 0
    sensors: dict[str, int]
    _spans_ns: dict[str, tuple[int, int]]
    _holds: ClassVar[str]  # name of the content in messages

    def lidars(self) -> list[str]:
        """All of them."""
        return list(self.sensors)

    def streams(self) -> list[Stream]:
        """All of them."""
        return [Stream(name, self._holds, n, "frames") for name, n in self.sensors.items()]

    def spans_ns(self) -> dict[str, tuple[int, int]]:
        """First and last stamp of each sensor, from the first reading."""
        return self._spans_ns

    def total(self, sensors: list[str]) -> int:
        """The number of their frames, from the first reading."""
        return sum(self.sensors[name] for name in sensors)

    def station(self) -> dict[str, Pose]:
        """Empty: such files hold no poses."""
        return {}

    def poses(self) -> dict[str, Poses]:
        """Empty: such files tell of no motion."""
        return {}

    def notes(self) -> list[str]:
        """Empty: there is nothing to note."""
        return []

    def facts(self) -> dict:
        """Empty: there are no further facts."""
        return {}

    def close(self) -> None:
        """Nothing is open between the calls."""


@contextmanager
def up_to_damage(found: Sized) -> Iterator[None]:
    """Ends the first reading at damage; items() reports it again behind the frames before it.

    InputError if nothing was found before.
    """
    try:
        yield
    except InputError:
        if not found:
            raise


class BeforeDamage(Iterator[T], Generic[T]):
    """Packets up to the damage, which is reported behind the frames that they still make."""

    def __init__(self, packets: Iterable[T]) -> None:
        self._packets = iter(packets)
        self._damage: InputError | None = None

    def __next__(self) -> T:
        try:
            return next(self._packets)
        except InputError as error:
            self._damage = error
        raise StopIteration

    def report(self) -> None:
        """InputError if damage has ended them."""
        if self._damage is not None:
            raise self._damage
