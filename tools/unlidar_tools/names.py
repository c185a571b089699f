"""Names of sensors, which become folders: made and checked here and nowhere else.

Scenarios, topics, frame ids and folders name sensors as they like. What becomes a part of a path,
or a NAME of the program's `--frames NAME=DIR`, is what `check_name` lets through.
"""

import re
import zlib
from collections.abc import Iterable

from unlidar_tools.sanitize import printable

# Half of what file systems take, which leaves room for what is put before and after a name.
_MOST = 120
_NAME = re.compile(rf"[A-Za-z0-9_][A-Za-z0-9_-]{{0,{_MOST - 1}}}")
# Beside the sensors' folders of a recording this is one of positions.
RESERVED = ("ground_truth",)


def check_name(name: str) -> str:
    """The name itself; ValueError unless it can be a sensor's folder inside of any other."""
    if name in RESERVED:
        raise ValueError(f"'{name}', expected another name: this folder is that of the truth")
    if not _NAME.fullmatch(name):
        raise ValueError(
            f"'{printable(name[:_MOST])}', expected a name of at most {_MOST} letters, digits, "
            "'_' and '-'"
        )
    return name


def folder_names(texts: Iterable[str]) -> list[str]:
    """A name for each text, all different: the text itself where that is a name, else like it."""
    names: list[str] = []
    taken: set[str] = set()  # in lower case: file systems that do not tell a from A exist
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
    """A level of a topic: the text itself where that is a name, else one that is like it.

    Brokers refuse wildcards, control characters and long topics, some by closing the connection.
    """
    if _NAME.fullmatch(text):
        return text
    return f"{_similar(text)[: _MOST - 9]}-{zlib.crc32(text.encode('utf-8', 'replace')):08x}"


def _similar(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9_-]+", "_", text)[:_MOST].strip("_-") or "sensor"
