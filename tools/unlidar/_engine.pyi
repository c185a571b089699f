"""The C++ engine. Use unlidar.Engine and unlidar.track."""

from typing import Any

import numpy as np
import numpy.typing as npt

# Stamps, (n,), and positions in metres with quaternions x, y, z, w, (n, 7).
_PoseArrays = tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]

class Stream:
    """Events frame by frame, as dictionaries. Not thread-safe."""

    def __init__(
        self,
        config: str,
        assignments: list[str],
        nanohertz: int,
        poses: dict[str, str | _PoseArrays],
    ) -> None: ...
    def add(
        self, sensor: str, stamp_ns: int, xyz: object, offsets_ns: object
    ) -> list[dict[str, Any]]: ...
    def advance(self, now_ns: int) -> list[dict[str, Any]]: ...
    def close(self) -> list[dict[str, Any]]: ...
    def take_notes(self) -> list[str]: ...

class Recording:
    """Tracks of a whole recording. Not thread-safe."""

    def __init__(
        self,
        config: str,
        assignments: list[str],
        nanohertz: int,
        poses: dict[str, str | _PoseArrays],
    ) -> None: ...
    def add(self, sensor: str, stamp_ns: int, xyz: object, offsets_ns: object) -> None: ...
    def tracks(self) -> list[tuple[int, bytearray, tuple[float, float, float]]]: ...
    def take_notes(self) -> list[str]: ...
