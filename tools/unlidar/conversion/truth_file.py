"""ground_truth.csv, row by row: a recording's truth may be long."""

from pathlib import Path
from typing import Self, TextIO

from unlidar.conversion.source import TruthRow


class TruthFile:
    """Writes truth with every digit kept; the file appears with its first row."""

    def __init__(self, path: Path, targets: int) -> None:
        self._path, self._targets = path, targets
        self._file: TextIO | None = None

    def __enter__(self) -> Self:
        """Opens nothing yet: a recording may have no truth."""
        return self

    def __exit__(self, *_exception: object) -> None:
        """Ends the file."""
        if self._file is not None:
            self._file.close()

    def add(self, row: TruthRow) -> None:
        """Writes a row with the original text of the stamp; optional columns only if used."""
        further = {}
        if self._targets > 1:
            further["target"] = str(row.target)
        if row.in_view is not None:
            further["in_view"] = str(int(row.in_view))
        if self._file is None:
            self._file = self._path.open("w", newline="")
            self._file.write(",".join(["timestamp", "x", "y", "z", *further]) + "\n")
        columns = [row.stamp, *(repr(v) for v in row.xyz_m), *further.values()]
        self._file.write(",".join(columns) + "\n")
