"""`explanation.json`, which `unlidar explain` leaves for the page: where the truth was lost."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import Field, TypeAdapter, ValidationError

from unlidar.errors import InputError, reason
from unlidar.limits import MOST_TABLE, read_limited
from unlidar.record import EXPLANATION

_Finite = Annotated[float, Field(allow_inf_nan=False)]


@dataclass(frozen=True)
class LostRun:
    """Seconds in a row in which a target was lost at one stage, or found."""

    from_s: _Finite  # Unix time
    to_s: _Finite
    seconds: int
    stage: str
    measured: str
    meaning: str


@dataclass(frozen=True)
class Lost:
    """Explanation of one target."""

    target: str
    runs: list[LostRun]
    shares: dict[str, _Finite]


@dataclass(frozen=True)
class _Explanation:
    targets: list[Lost]


_FILE = TypeAdapter(_Explanation)


def read_explanation(run: Path) -> list[Lost]:
    """The explanation; empty without `unlidar explain`, InputError for a foreign file."""
    path = run / EXPLANATION
    if not path.is_file():
        return []
    try:
        return _FILE.validate_json(read_limited(path, MOST_TABLE)).targets
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        key = ".".join(map(str, fault["loc"]))
        raise InputError(f"{path}: {key}: {fault['msg']}, run unlidar explain again") from error
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read: {reason(error)}") from error
