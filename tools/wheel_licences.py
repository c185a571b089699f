"""Adds to a wheel, in .dist-info/licenses, the licences of all that is in it besides the project.

    python tools/wheel_licences.py WHEEL FOLDER

FOLDER has a file for each library, by its name.
"""

import hashlib
import sys
import zipfile
from base64 import urlsafe_b64encode
from pathlib import Path


def record_line(name: str, content: bytes) -> str:
    digest = urlsafe_b64encode(hashlib.sha256(content).digest()).decode().rstrip("=")
    return f"{name},sha256={digest},{len(content)}\n"


def main(wheel: Path, folder: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        files = {info: archive.read(info) for info in archive.infolist()}
    (record,) = (info for info in files if info.filename.endswith(".dist-info/RECORD"))
    licences = f"{record.filename.removesuffix('RECORD')}licenses/"
    for text in sorted(folder.iterdir()):
        info = zipfile.ZipInfo(licences + text.name, record.date_time)
        info.external_attr = record.external_attr
        files[info] = text.read_bytes()
        files[record] += record_line(info.filename, files[info]).encode()
    unfinished = wheel.with_suffix(".part")
    with zipfile.ZipFile(unfinished, "w", zipfile.ZIP_DEFLATED) as archive:
        for info, content in files.items():
            archive.writestr(info, content, zipfile.ZIP_DEFLATED)
    unfinished.replace(wheel)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
