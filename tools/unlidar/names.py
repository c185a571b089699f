"""Sensor names, which become folder names: the only place that makes and checks them.

Scenarios, topics, frame ids and folders hold arbitrary names. Only names accepted by `check_name`
become part of a path, or NAME in the program's `--frames NAME=DIR`.
"""

import re
import zlib
from collections.abc import Iterable

from unlidar.sanitize import printable

# Half of the limit of file systems, to leave room for prefixes and suffixes.
_MOST = 120
_NAME = re.compile(rf"[A-Za-z0-9_][A-Za-z0-9_-]{{0,{_MOST - 1}}}")
# The folder of truth positions, beside those of sensors.
RESERVED = ("ground_truth",)


def check_name(name: str) -> str:
    """Returns the name; ValueError unless it is valid as a sensor's folder."""
    if name in RESERVED:
        raise ValueError(f"'{name}', expected another name: this folder is that of the truth")
    if not _NAME.fullmatch(name):
        raise ValueError(
            f"'{printable(name[:_MOST])}', expected a name of at most {_MOST} letters, digits, "
            "'_' and '-'"
        )
    return name


def folder_names(texts: Iterable[str]) -> list[str]:
    """Distinct names for the texts: the text itself if valid, else a similar name."""
    names: list[str] = []
    taken: set[str] = set()  # lower case, for case-insensitive file systems
    for text in texts:
        plain = text if _NAME.fullmatch(text) else _similar(text)
        plain += "_cloud" if plain in RESERVED else ""
        name, number = plain, 2
        while name.lower() in taken:
            ending = f"_{number}"
            name = plain[: _MOST - len(ending)] + ending
            number += 1
        names.append(name)
        taken.add(name.lower())
    return names


def topic_level(text: str) -> str:
    """A level of an MQTT topic: the text itself if valid, else a similar name with a checksum.

    Brokers refuse wildcards, control characters and long topics, some by closing the connection.
    """
    if _NAME.fullmatch(text):
        return text
    return f"{_similar(text)[: _MOST - 9]}-{zlib.crc32(text.encode('utf-8', 'replace')):08x}"


def _similar(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9_-]+", "_", text)[:_MOST].strip("_-") or "sensor"
