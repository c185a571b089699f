"""`unlidar history` and the store behind it."""

from __future__ import annotations

import contextlib
import csv
import io
import json
import sqlite3
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from station_events import BEGIN_NS, end, row, sensor, square, stamp, state, track, write_site
from unlidar.cli import main
from unlidar.events.site import Place, load_site, load_zones
from unlidar.events.station import Message, Station
from unlidar.history.ageing import Ageing
from unlidar.history.reader import Reader
from unlidar.history.store import Store

PLACE = Place(latitude_deg=47.0, longitude_deg=8.0, height_m=500.0)


def flight(number: int = 7, begin: float = 0.0, rows: int = 50) -> list[str]:
    return [
        track(number, begin + 1.0),
        *[row(number, begin + t / 10, (t / 10, 0.0, 20.0)) for t in range(rows)],
        end(number, begin + rows / 10 + 10),
    ]


def messages(folder: Path, *lines: str) -> list[Message]:
    site = load_site(write_site(folder, [square(50, "apron")]))
    station = Station(site, load_zones(site))
    return [m for line in lines for m in station.take(line)]


@pytest.fixture
def store(tmp_path: Path) -> Path:
    path = tmp_path / "sky.db"
    keeping = Store(path)
    keeping.place("north", PLACE)
    lines = [sensor("mid360", "ok"), state("running"), *flight(), *flight(8, 3600.0)]
    keeping.take(messages(tmp_path, *lines))
    keeping.close()
    return path


def history(capsys, *arguments: object) -> str:
    capsys.readouterr()
    assert main(["history", *map(str, arguments)]) == 0
    return capsys.readouterr().out


def table(text: str) -> list[dict]:
    return list(csv.DictReader(io.StringIO(text)))


def test_every_row_comes_back_to_the_nanosecond(store, capsys) -> None:
    rows = table(history(capsys, store, "--format", "csv"))
    expected = [stamp(t / 10) for t in range(50)] + [stamp(3600 + t / 10) for t in range(50)]
    assert [r["timestamp"] for r in rows] == expected
    assert [int(r["track_id"]) for r in rows] == [7] * 50 + [8] * 50
    assert [float(r["x"]) for r in rows[:50]] == [t / 10 for t in range(50)]
    assert float(rows[0]["latitude"]) == pytest.approx(47.0, abs=1e-8)


def test_since_and_until_bound_the_rows(store, capsys) -> None:
    def stamps(*span: str) -> list[str]:
        rows = table(history(capsys, store, "--format", "csv", *span))
        return [r["timestamp"] for r in rows]

    assert stamps("--since", stamp(1.0), "--until", stamp(1.2)) == [stamp(t) for t in (1, 1.1, 1.2)]
    assert stamps("--since", "1s") == [stamp(3600 + t / 10) for t in range(39, 50)]
    assert len(stamps("--since", "2h")) == 100
    assert len(stamps("--until", "30min")) == 50
    day = "2024-01-26T20:30:00"  # BEGIN_NS is at 20:30:00.12 UTC
    assert len(stamps("--since", day)) == 100
    assert len(stamps("--until", day)) == 0
    assert len(stamps("--since", "2024-01-26T21:31+01:00")) == 50


@pytest.mark.parametrize(
    ("since", "count"),
    [("99999999d", 100), ("9" * 400 + "d", 100), ("0001-01-01", 100), ("9999-12-31", 0)],
)
def test_a_time_beyond_all_that_can_be_kept_is_no_error(since, count, store, capsys) -> None:
    assert len(table(history(capsys, store, "--since", since, "--format", "csv"))) == count
    with contextlib.closing(sqlite3.connect(store, isolation_level=None)) as db:
        db.execute("UPDATE row SET stamp_ns = stamp_ns - ?", (8 * 10**18,))
        db.execute("UPDATE track SET begin_ns = -9e18, newest_ns = -9e18")
    history(capsys, store, "--since", "7d")


def test_other_formats_are_those_of_export(store, tmp_path, capsys) -> None:
    collection = json.loads(history(capsys, store, "--format", "geojson"))
    assert [f["properties"]["track_id"] for f in collection["features"]] == [7, 8]
    history(capsys, store, tmp_path / "sky.mcap")
    from mcap_ros2.reader import read_ros2_messages

    with (tmp_path / "sky.mcap").open("rb") as file:
        xs = [
            m.ros_msg.pose.pose.position.x
            for m in read_ros2_messages(file)
            if hasattr(m.ros_msg, "twist")
        ]
    assert sorted(xs) == sorted([t / 10 for t in range(50)] * 2)


def test_without_a_format_it_lists_the_tracks(store, capsys) -> None:
    said = history(capsys, store)
    assert "north" in said
    assert "2024-01-26 20:30:00" in said
    assert "4.9 s" in said


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ([], "the list"),
        (["--format", "csv"], "csv"),
        (["a.geojson"], "a.geojson"),
        (["a.mcap"], ""),
    ],
)
def test_stamps_that_are_no_unix_time_are_noted_where_they_become_dates(
    arguments: list[str], named: str, tmp_path, capsys, monkeypatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for begin_s, is_noted in ((0.0, False), (12 - BEGIN_NS // 10**9, True)):
        keeping = Store(tmp_path / f"{is_noted}.db")
        keeping.place("north", PLACE)
        keeping.take(messages(tmp_path, *flight(begin=begin_s)))
        keeping.close()
        assert main(["history", f"{is_noted}.db", *arguments]) == 0
        said = f"stamp 12.123456789 is no Unix time, as of 1970: dates in {named} are not"
        assert (said in capsys.readouterr().err) == (is_noted and bool(named))


def test_a_store_is_not_replaced_by_what_it_holds(store, fails) -> None:
    before = store.read_bytes()
    for out in (store, store.parent / "." / ".." / store.parent.name / store.name):
        assert "is what is read" in fails(2, "history", store, out, "--format", "csv")
    assert store.read_bytes() == before


def test_taking_the_same_in_again_changes_nothing(store, tmp_path) -> None:
    def content() -> list:
        with sqlite3.connect(store) as db:
            tables = "track", "row", "told"
            return [sorted(db.execute(f"SELECT * FROM {t}").fetchall()) for t in tables]

    before = content()
    again = Store(store)
    again.take(messages(tmp_path, sensor("mid360", "ok"), state("running"), *flight()))
    again.close()
    assert content() == before


def test_a_killed_writers_store_is_whole_and_goes_on(tmp_path) -> None:
    script = (
        "import sys; sys.path.insert(0, sys.argv[2])\n"
        "from pathlib import Path\nfrom test_history import *\n"
        "s = Store(Path(sys.argv[1]) / 'sky.db')\n"
        "for i in range(10**6):\n"
        "  s.take(messages(Path(sys.argv[1]), *flight(i, i * 20.0)))\n"
        "  print(i, flush=True)\n"
    )
    command = [sys.executable, "-c", script, str(tmp_path), str(Path(__file__).parent)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    done = [process.stdout.readline() for _ in range(3)]
    time.sleep(0.05)
    process.kill()
    process.wait()
    process.stdout.close()
    assert [int(x) for x in done] == [0, 1, 2]
    again = Store(tmp_path / "sky.db")
    tracks = list(again.reader().tracks())
    assert len(tracks) >= 3
    assert all(len(t.rows) == 50 for t in tracks)  # a transaction is there or not
    again.close()


def test_numbers_that_begin_anew_are_other_tracks(tmp_path, capsys) -> None:
    path = tmp_path / "sky.db"
    keeping = Store(path)
    lines = [*flight(1), state("warming_up", 100.0), *flight(1, 200.0)]
    # The second engine is killed, the third one has its first track.
    keeping.take(messages(tmp_path, *lines[:-1], state("warming_up", 300.0), *flight(1, 400.0)))
    assert [(t.number, len(t.rows)) for t in keeping.reader().tracks()] == [(1, 50)] * 3
    keeping.close()
    rows = table(history(capsys, path, "--format", "csv"))
    assert len({r["track_id"] for r in rows}) == 3


def test_rows_of_before_are_none_of_a_track_that_goes_on(tmp_path) -> None:
    """A file of events is read again from its begin, and what it told first is not stored."""
    keeping = Store(tmp_path / "sky.db")
    keeping.take(messages(tmp_path, *flight(7, 1000.0)[:-1]))
    keeping.take(messages(tmp_path, *flight(7, 0.0)))
    spans = [[t.rows[0][0], len(t.rows)] for t in keeping.reader().tracks()]
    assert spans == [[BEGIN_NS, 50], [BEGIN_NS + 1000 * 10**9, 50]]
    keeping.close()


def test_days_bound_what_is_kept(tmp_path) -> None:
    """By this computer's clock, whatever the stamps are."""
    now = [time.time_ns()]
    ageing = Ageing(lambda: now[0], lambda: now[0])
    keeping = Store(tmp_path / "sky.db", days=1.5, ageing=ageing)
    for day in range(4):
        keeping.take(messages(tmp_path, state("running", day), *flight(day, day * 100.0)))
        keeping.tidy()
        now[0] += 86_400_000_000_000
    assert [t.number for t in keeping.reader().tracks()] == [2, 3]
    assert len(keeping.reader().told("state", 0, 1 << 62)) == 2
    keeping.close()


def test_size_bounds_what_is_kept_and_the_file(tmp_path) -> None:
    path = tmp_path / "sky.db"
    keeping = Store(path, megabytes=0.25)
    for i in range(20):
        keeping.take(messages(tmp_path, *flight(i, i * 100.0, rows=200)))
        keeping.tidy()
        assert path.stat().st_size < 400_000
    kept = [t.number for t in keeping.reader().tracks()]
    assert kept == list(range(20))[-len(kept) :]  # the newest, none left out between
    assert len(kept) >= 5
    keeping.close()


def test_memory_alone_will_do(tmp_path) -> None:
    keeping = Store(None)
    keeping.take(messages(tmp_path, *flight()))
    (found,) = keeping.reader().tracks()
    assert len(found.rows) == 50


def test_alarms_come_back(tmp_path) -> None:
    keeping = Store(tmp_path / "sky.db")
    keeping.take(messages(tmp_path, *flight()))
    told = [json.loads(text) for text in keeping.reader().alarms(0, 1 << 62)]
    assert [(a["state"], a["zone"], a["track"]) for a in told] == [
        ("raised", "apron", 7),
        ("ended", "apron", 7),
    ]


def test_relay_keeps_what_it_tells(tmp_path, capsys) -> None:
    path = tmp_path / "sky.db"
    command = [sys.executable, "-m", "unlidar", "relay", "-", "--store", path]
    command += ["--site", write_site(tmp_path)]
    text = "\n".join(flight()) + "\n"
    done = subprocess.run(command, input=text, text=True, capture_output=True, timeout=60)
    assert done.returncode == 0, done.stderr
    (found,) = Reader(path).tracks()
    assert [r[0] for r in found.rows] == [BEGIN_NS + t * 10**8 for t in range(50)]
    assert np.allclose([r[1] for r in found.rows], np.arange(50) / 10)
    assert len(table(history(capsys, path, "--format", "csv"))) == 50


@pytest.mark.parametrize(
    ("content", "arguments", "code", "said"),
    [
        (None, [], 4, "is no store"),
        (b"no database" * 100, [], 4, "cannot be read as a store"),
        (b"", [], 4, "is no store"),
        ("store", ["--since", "yesterday"], 2, "'yesterday', expected 2026"),
        ("store", ["x.tum"], 2, "expected one of csv"),
        ("store", ["--format", "mcap"], 2, "needs a file"),
        ("store", ["--heading", "3"], 2, "--heading needs --origin"),
        ("store", ["--station", "south", "--format", "csv"], 4, "no track of a station 'south'"),
    ],
)
def test_what_cannot_work_is_one_line(content, arguments, code, said, store, fails) -> None:
    path = store if content == "store" else store.with_name("other.db")
    if isinstance(content, bytes):
        path.write_bytes(content)
    assert said in fails(code, "history", path, *arguments)


def test_a_foreign_database_is_not_written_into(tmp_path, fails) -> None:
    path = tmp_path / "other.db"
    with sqlite3.connect(path) as db:
        db.execute("CREATE TABLE mine (x)")
    before = path.read_bytes()
    assert "is a database, but no store" in fails(5, "relay", "/dev/null", "--store", path)
    assert path.read_bytes() == before
