"""Tables of text: lines with their numbers, and the rows of CSV files with named columns."""

import csv
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

from unlidar.errors import InputError, listed, reason
from unlidar.limits import MOST_LINE, MOST_TABLE, TooLargeError, require_file

# No text: NUL, and bytes that are no UTF-8, which "surrogateescape" leaves in the line.
_NO_TEXT = re.compile("[\0\udc80-\udcff]")


@dataclass(frozen=True, slots=True)
class Row:
    """The values of one row by the names of their columns."""

    path: Path
    line: int
    values: dict[str, str]

    @property
    def where(self) -> str:
        """FILE:LINE, for messages."""
        return f"{self.path}:{self.line}"

    def number(self, name: str, default: float | None = None) -> float:
        """The finite number of a column; `default` where the column or its value is missing.

        InputError for any other value.
        """
        text = self.values.get(name, "").strip()
        if not text and default is not None:
            return default
        try:
            return finite_number(text)
        except ValueError as error:
            raise InputError(f"{self.where}: {name} is {reason(error)}") from error


def finite_number(text: str) -> float:
    """ValueError for all else, as for 1_000, which Python takes for a number."""
    try:
        value = math.nan if "_" in text else float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"'{text[:40]}', expected a finite number")
    return value


def numbered_lines(
    path: Path, most: int = MOST_TABLE, most_line: int = MOST_LINE, pipes: bool = False
) -> Iterator[tuple[int, str]]:
    """The lines of a text with their numbers from 1, one at a time, in bounded memory.

    InputError for what is no file, no UTF-8, has a NUL, or is longer than a table or line may be.
    With `pipes` it may be a pipe, for whose writer this waits.
    """
    try:
        if not pipes:
            require_file(path)
        file = path.open(newline="", encoding="utf-8-sig", errors="surrogateescape")
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read: {reason(error)}") from error
    with file:
        number, read = 0, 0
        while line := _next_line(path, file, most_line + 1):
            number, read = number + 1, read + len(line)
            if len(line) > most_line:
                raise InputError(f"{path}:{number}: has more than {most_line:,} characters")
            if read > most:
                raise InputError(f"{path}: cannot be read: {TooLargeError('it', None, most)}")
            if found := _NO_TEXT.search(line):
                byte = ord(found[0]) & 0xFF
                raise InputError(f"{path}:{number}: has the byte 0x{byte:02x}, expected UTF-8 text")
            yield number, line


def columns_of(path: Path) -> list[str]:
    """The names in the first line of a CSV; empty for an empty file."""
    return _names(path, csv.reader((line for _, line in numbered_lines(path)), strict=True))


def csv_rows(
    path: Path,
    required: Sequence[str] = (),
    expected: str | None = None,
    lines: Iterable[tuple[int, str]] | None = None,
) -> Iterator[Row]:
    """The rows of a CSV file whose first line names its columns; blank lines are skipped.

    InputError as of `numbered_lines`, for a column of `required` that is missing, a repeated name,
    and a row of another number of values. `expected` describes the file in messages; `lines` are
    its lines, if they have been opened already.
    """
    lines = numbered_lines(path) if lines is None else lines
    reader = csv.reader((line for _, line in lines), strict=True)
    names = _names(path, reader)
    if missing := next((name for name in required if name not in names), None):
        expected = expected or f"{','.join(required)} in its first line"
        found = _found(names, reader.line_num > 0)
        raise InputError(f"{path}: has no column {missing}, {found}, expected {expected}")
    if twice := next((name for name in names if name and names.count(name) > 1), None):
        raise InputError(f"{path}: has a second column {twice[:40]}, expected each name once")
    while (values := _next_values(path, reader)) is not None:
        if not values or (len(values) == 1 and not values[0].strip()):
            continue
        if len(values) != len(names):
            raise InputError(
                f"{path}:{reader.line_num}: {len(values)} values, expected {len(names)}"
            )
        yield Row(path, reader.line_num, dict(zip(names, values, strict=True)))


def _next_line(path: Path, file: TextIO, most: int) -> str:
    try:
        return file.readline(most)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {reason(error)}") from error


def _names(path: Path, reader: Any) -> list[str]:
    return [name.strip() for name in _next_values(path, reader) or []]


def _next_values(path: Path, reader: Any) -> list[str] | None:
    """The next row; None at the end. Strict, as an open quote would swallow all further rows."""
    try:
        return next(reader, None)
    except csv.Error as error:
        raise InputError(
            f"{path}:{reader.line_num}: no row of a CSV file: {reason(error)}"
        ) from error


def _found(names: Sequence[str], begins: bool) -> str:
    """A description of an unexpected first line, for messages."""
    first = ",".join(names).strip()
    words = first.replace(",", " ").replace(";", " ").split()
    if not words:
        return "its first line is empty" if begins else "it is empty"
    if all(_is_number(word) for word in words):
        return f"its first line is {'a number' if len(words) == 1 else f'{len(words)} numbers'}"
    if len(names) == 1 and len(words) > 1:
        return "its first line has no commas"
    return f"it has {listed(names)}"


def _is_number(text: str) -> bool:
    try:
        finite_number(text)
    except ValueError:
        return False
    return True
