"""Sea level: the height of the geoid EGM96 above the WGS 84 ellipsoid."""

import os
import struct
from pathlib import Path

import numpy as np

from unlidar.errors import InputError, reason

GRID_NAME = "egm96_15.gtx"  # of PROJ: the geoid EGM96, a value every quarter of a degree
_PROJ_FOLDERS = ("/usr/local/share/proj", "/usr/share/proj")
_GTX_HEADER = struct.Struct(">4d2i")  # latitude and longitude: first, step; rows, columns


def find_geoid_grid() -> Path | None:
    """PROJ's grid of EGM96, from its data folders (Debian: the package proj-data)."""
    named = [os.environ.get(name, "") for name in ("PROJ_DATA", "PROJ_LIB")]
    folders = [folder for names in named for folder in names.split(os.pathsep) if folder]
    paths = (Path(folder) / GRID_NAME for folder in (*folders, *_PROJ_FOLDERS))
    return next((path for path in paths if path.is_file()), None)


def geoid_height_m(grid: Path, latitude_deg: float, longitude_deg: float) -> float:
    """Height of the geoid above the ellipsoid, between the four values around a place.

    InputError if the grid, a GTX file of the whole earth, cannot be read.
    """
    try:
        with grid.open("rb") as file:
            lat_0, lon_0, lat_step, lon_step, rows, columns = _GTX_HEADER.unpack(
                file.read(_GTX_HEADER.size)
            )
            if (rows - 1) * lat_step != 180 or columns * lon_step != 360:
                raise ValueError("is no grid of the whole earth")
            row = (latitude_deg - lat_0) / lat_step
            column = (longitude_deg - lon_0) / lon_step % columns
            low, left = min(int(row), rows - 2), int(column) % columns
            corners = np.empty((2, 2))
            for i, j in np.ndindex(2, 2):
                value = (low + i) * columns + (left + j) % columns
                file.seek(_GTX_HEADER.size + 4 * value)
                corners[i, j] = np.frombuffer(file.read(4), dtype=">f4")[0]
    except (OSError, ValueError, IndexError, struct.error) as error:
        raise InputError(f"{grid}: cannot be read as a geoid: {reason(error)}") from error
    up, across = row - low, column - int(column)
    return float(np.array([1 - up, up]) @ corners @ np.array([1 - across, across]))
