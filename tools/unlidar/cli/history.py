"""`unlidar history`: options and output."""

import argparse
import re
import sys
import tempfile
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from unlidar.cli.arguments import number, origin
from unlidar.errors import InputError, UsageError
from unlidar.stamps import parse_seconds_ns

if TYPE_CHECKING:
    from unlidar.history.reader import Reader

FORMATS = ("csv", "geojson", "kml", "mcap")
EXAMPLE = """unlidar history sky.db --since 2h
  unlidar history sky.db night.csv --since 2026-11-21T20:00 --until 2026-11-22T06:00
  unlidar history sky.db --since 1d --format geojson > day.geojson"""
_TEXTS = "csv", "geojson", "kml"
_UNITS_S = {"s": 1, "min": 60, "h": 3600, "d": 86400}
_LONGEST_S = 1e10  # longer than any store covers
_AGO = re.compile(r"(\d+(?:\.\d+)?)(s|min|h|d)")


def define(p: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    p.add_argument(
        "store", metavar="STORE", type=Path, help="the file that watch --store or relay --store has"
    )
    p.add_argument(
        "out",
        metavar="OUT",
        type=Path,
        nargs="?",
        help="file to be written (default: stdout; without --format a list of the tracks)",
    )
    p.add_argument(
        "--format", choices=FORMATS, help="as of unlidar export (default: by OUT's name)"
    )
    for name, text in (("since", "from"), ("until", "up to")):
        p.add_argument(
            f"--{name}",
            metavar="TIME",
            type=_time,
            help=f"{text} this time: 2026-11-22T08:30 (UTC, or with +01:00), seconds of Unix time, "
            "or so long before the newest row: 90s, 30min, 2h, 7d",
        )
    p.add_argument("--station", metavar="NAME", help="whose tracks, where several are stored")
    p.add_argument(
        "--origin",
        metavar="LAT,LON,HEIGHT",
        type=origin,
        help="where 0,0,0 is (default: what is stored), as of unlidar export",
    )
    p.add_argument(
        "--heading",
        metavar="DEG",
        type=number,
        help="with --origin: compass direction of the x axis (default: 90)",
    )
    p.set_defaults(act=act)


def act(a: argparse.Namespace) -> None:
    """Exports the stored tracks, or lists them."""
    from unlidar.export_options import guess_format
    from unlidar.history.reader import Reader
    from unlidar.output import refuse_input

    if a.heading is not None and a.origin is None:
        raise UsageError("--heading needs --origin")
    form = a.format or (None if a.out is None else guess_format(a.out))
    if form is not None and form not in FORMATS:
        raise UsageError(f"{a.out}: --format {form}, expected one of {', '.join(FORMATS)}")
    if a.out is not None:
        refuse_input(a.out, a.store)
    if form is not None and a.out is None and form not in _TEXTS:
        raise UsageError(f"--format {form} needs a file to be written")
    reader = Reader(a.store)
    try:
        if form is None:
            _list(reader, a)
        else:
            _write(reader, form, a)
    finally:
        reader.close()


def _write(reader: "Reader", form: str, a: argparse.Namespace) -> None:
    from unlidar.export.dates import DATED, note_dates
    from unlidar.history.export import stamps_of, write_history

    stations = [a.station] if a.station else reader.stations()
    if a.station and a.station not in reader.stations():
        raise InputError(f"{a.store}: has no track of a station '{a.station}'")
    if len(stations) > 1:
        raise UsageError(f"{a.store}: give --station, it holds {', '.join(stations)}")
    name = stations[0] if stations else "station"
    place = reader.place(name)
    where = a.origin if a.origin is not None else (place.origin() if place else None)
    if a.heading is not None:
        where = replace(where, heading_deg=a.heading)
    tracks = list(reader.tracks(*_span(reader, a), name))
    if form in DATED:
        note_dates(a.store, stamps_of(tracks), form if a.out is None else a.out.name)
    if a.out is not None:
        for path in write_history(tracks, a.out, form, name, where):
            print(path)
        return
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / f"history.{form}"
        write_history(tracks, out, form, name, where)
        with out.open(encoding="utf-8") as text:
            for line in text:
                sys.stdout.write(line)


def _list(reader: "Reader", a: argparse.Namespace) -> None:
    import numpy as np
    from rich import box
    from rich.table import Table

    from unlidar.export.dates import note_dates
    from unlidar.sanitize import cell
    from unlidar.tables import show

    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for head in ("station", "track", "begin (UTC)", "lasts", "rows", "height", "fastest"):
        table.add_column(head, justify="left" if head in ("station", "begin (UTC)") else "right")
    begins_ns = []
    for track in reader.tracks(*_span(reader, a), a.station):  # one at a time, of months of rows
        begin_ns, end_ns = track.rows[0][0], track.rows[-1][0]
        begins_ns.append(begin_ns)
        heights = [row[3] for row in track.rows]
        speed = max((row[4] ** 2 + row[5] ** 2 + row[6] ** 2) ** 0.5 for row in track.rows)
        table.add_row(
            cell(track.station),
            str(track.number),
            f"{datetime.fromtimestamp(begin_ns // 10**9, UTC):%Y-%m-%d %H:%M:%S}",
            f"{(end_ns - begin_ns) * 1e-9:.1f} s",
            str(len(track.rows)),
            f"{min(heights):.0f} to {max(heights):.0f} m",
            f"{speed:.1f} m/s",
        )
    note_dates(a.store, np.array(begins_ns, dtype=np.int64), "the list")
    show(table)


def _span(reader: "Reader", a: argparse.Namespace) -> tuple[int | None, int | None]:
    newest_ns = reader.newest_ns()
    since_ns, until_ns = (
        None if time is None else time[1] if time[0] else newest_ns - time[1]
        for time in (a.since, a.until)
    )
    return since_ns, until_ns


def _time(text: str) -> tuple[bool, int]:
    """(ns, is_absolute): Unix time if absolute, else the age before the newest row."""
    ago = _AGO.fullmatch(text)
    if ago:
        return False, round(min(float(ago[1]) * _UNITS_S[ago[2]], _LONGEST_S) * 1e9)
    try:
        return True, parse_seconds_ns(text)
    except ValueError:
        pass
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"'{text}', expected 2026-11-22T08:30, seconds of Unix time, or 90s, 30min, 2h, 7d"
        ) from None
    if moment.tzinfo is None:
        moment = moment.replace(tzinfo=UTC)
    return True, round(moment.timestamp() * 1e6) * 1000
