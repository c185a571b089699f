"""The page's server while others do their worst: each is served within a second or so."""

from __future__ import annotations

import asyncio
import contextlib
import http.client
import itertools
import json
import socket
import sqlite3
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import station_events
from live_program import PATIENCE_S, wait_until
from station_events import appended, end, row, sensor, state, track
from test_watch import Watch, stored
from unlidar.events.event import decode
from unlidar.events.site import Site
from unlidar.events.station import Message, Station
from unlidar.history.store import Store
from unlidar.history.timeline import Archive, UnansweredError, rows, spans
from unlidar.watch import connections
from unlidar.watch.connections import Connections, Listener
from unlidar.watch.metrics import Metrics, Taken
from unlidar.watch.pages import Pages
from unlidar.watch.server import Serving, make_app
from unlidar.watch.sky import FORGET_S, MOST_TRACKS, Sky

AHEAD_S = 3.9e9  # of 2093
SOON_S = 20.0  # of a loaded machine; what hangs takes for ever


class Server:
    """Serves in this process, so that its patience can be shortened."""

    def __init__(self) -> None:
        self.store = Store(None)
        self.pages = Pages(Sky())
        self._archive = Archive(self.store.location)
        sky, connections = self.pages._sky, Connections()
        metrics = Metrics(sky, self.pages, connections, Taken())
        app = make_app(sky, self.pages, self._archive, Site(), (), None, None, metrics)
        self.serving = Serving(app, self.pages, connections, None, None)
        self._listener = Listener.at("127.0.0.1", 0, self.serving.connections)
        self.port = self._listener.getsockname()[1]

    @contextlib.contextmanager
    def running(self) -> Iterator[None]:
        loop = asyncio.new_event_loop()
        threading.Thread(target=loop.run_forever, daemon=True).start()

        async def start() -> None:
            self.serving.start(self._listener)

        asyncio.run_coroutine_threadsafe(start(), loop).result(PATIENCE_S)
        try:
            yield
        finally:
            self.serving.stop()
            self._archive.close()
            self.store.close()
            loop.call_soon_threadsafe(loop.stop)

    def connect(self, text: str = "") -> socket.socket:
        connection = socket.create_connection(("127.0.0.1", self.port), PATIENCE_S)
        connection.sendall(text.encode())
        return connection

    def get(self, path: str) -> tuple[int, bytes]:
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=SOON_S)
        with contextlib.closing(connection):
            connection.request("GET", path)
            answer = connection.getresponse()
            return answer.status, answer.read()


@pytest.fixture
def server() -> Iterator[Server]:
    server = Server()
    with server.running():
        wait_until(lambda: server.get("/")[0] == 200, "it serves")
        yield server


@pytest.fixture
def hasty(monkeypatch) -> None:
    for name in ("SILENT_S", "STUCK_S"):
        monkeypatch.setattr(connections, name, 0.5)
    monkeypatch.setattr(connections, "_LOOK_S", 0.1)


def is_closed(connection: socket.socket) -> bool:
    connection.settimeout(0.05)
    try:
        return connection.recv(1 << 20) == b""
    except TimeoutError:
        return False
    except OSError:
        return True


def told(*lines: str) -> list[Message]:
    station = Station(Site())
    return [message for line in lines for message in station.take(line)]


def message_of(line: str, station: str = "station") -> Message:
    event, text = decode(line)[0], line
    return Message(event.event, station, event.at, text, event)


def test_connections_that_say_nothing_make_way_for_who_asks(server) -> None:
    idle = [server.connect("GET / HT" if i % 2 else "") for i in range(300)]
    assert server.get("/")[0] == 200
    for connection in idle:
        connection.close()


def test_who_asks_for_the_head_of_the_live_page_holds_no_place(server) -> None:
    for _ in range(3):
        with server.connect("HEAD /live HTTP/1.1\r\nHost: localhost\r\n\r\n") as head:
            head.settimeout(PATIENCE_S)
            assert head.recv(1 << 16).startswith(b"HTTP/1.1 200")
            assert not server.pages._new | server.pages._queues


def test_a_connection_that_never_ends_its_request_is_closed(server, hasty) -> None:
    trickling = server.connect("GET / HTTP/1.1\r\n")
    until = time.monotonic() + PATIENCE_S
    while not is_closed(trickling):
        assert time.monotonic() < until
        with contextlib.suppress(OSError):
            trickling.sendall(b"X: y\r\n")
    again = server.connect("GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")
    again.settimeout(PATIENCE_S)
    while again.recv(1 << 16):  # also one that has asked before
        pass


def test_a_page_that_never_reads_is_cut_off_and_its_place_is_free(server, hasty) -> None:
    deaf = socket.socket()
    deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    deaf.connect(("127.0.0.1", server.port))
    deaf.sendall(b"GET /live HTTP/1.1\r\nHost: localhost\r\n\r\n")
    wait_until(lambda: server.pages._queues, "the page is open")
    (large,) = told(sensor("mid360", "ok"))
    large = Message(large.kind, "station", large.at_ns, large.text + " " * 100_000, large.event)

    def is_gone() -> bool:
        server.pages.take(large)
        return not server.serving._server.server_state.connections

    wait_until(is_gone, "its connection is closed")
    wait_until(lambda: server.pages.count == 0, "its place is free")
    assert server.get("/")[0] == 200
    deaf.close()


def test_pages_are_served_while_the_work_on_events_never_ends(server) -> None:
    done = threading.Event()

    def toil() -> None:
        numbers = list(range(1000))
        while not done.is_set():
            sum(numbers)

    thread = threading.Thread(target=toil)
    thread.start()
    try:
        for path in ("/", "/spans"):
            begin_s = time.monotonic()
            assert server.get(path)[0] == 200
            assert time.monotonic() - begin_s < SOON_S
    finally:
        done.set()
        thread.join()


def test_a_store_of_very_many_tracks_is_sent_in_bounded_answers() -> None:
    store = Store(None)
    now_ns = time.time_ns()
    db = store._connection()
    db.execute("BEGIN")
    db.executemany(
        "INSERT INTO track (station, number, begin_ns, newest_ns, ended, taken_ns) "
        "VALUES ('north', ?, ?, ?, 1, ?)",
        (
            (i, now_ns - i * 10**9, now_ns - i * 10**9 + 10**8, now_ns)
            for i in range(80_000)
        ),
    )  # fmt: skip
    db.execute("COMMIT")

    async def ask() -> tuple[dict, dict]:
        archive = Archive(store.location)
        same = [archive.ask(spans, now_ns - 86_400 * 10**9, now_ns, None) for _ in range(5)]
        answers = await asyncio.gather(*same)
        assert all(answer is answers[0] for answer in answers)  # the store was asked once
        few = await archive.ask(spans, now_ns - 100 * 10**9, now_ns, None)
        archive.close()
        return json.loads(answers[0]), json.loads(few)

    day, few = asyncio.run(ask())
    assert len(day["spans"]) <= 2000
    # No stretch of the time in which something flew is left blank.
    covered = sorted((begin, end) for _, _, begin, end in day["spans"])
    assert all(b[0] - a[1] < 1.1 for a, b in itertools.pairwise(covered))
    assert covered[-1][1] - covered[0][0] > 79_000
    assert 100 <= len(few["spans"]) <= 102
    assert few["spans"][-1][1] == 0
    store.close()


def test_rows_of_many_tracks_are_thinned_and_the_newest_stays() -> None:
    store = Store(None)
    store.take([message_of(row(n, t / 10)) for n in range(1, 41) for t in range(1000)])
    low, high = station_events.BEGIN_NS, station_events.BEGIN_NS + 200 * 10**9
    found = rows(store.location.connect("ro"), low, high, None)
    assert len(found["tracks"]) == 40
    assert found["left_out"] == 0
    assert sum(len(t["rows"]) for t in found["tracks"]) <= 21_000
    newest = (station_events.BEGIN_NS + round(99.9e9)) / 1e9
    assert {t["rows"][-1][0] for t in found["tracks"]} == {newest}
    store.close()


def test_a_question_that_takes_too_long_is_given_up() -> None:
    store = Store(None)

    def endless(db: sqlite3.Connection, *_: object) -> dict:
        query = "WITH RECURSIVE n (x) AS (VALUES (1) UNION ALL SELECT x + 1 FROM n) "
        return {"n": db.execute(query + "SELECT max(x) FROM n").fetchall()}

    async def ask() -> None:
        archive = Archive(store.location)
        with pytest.raises(UnansweredError):
            await archive.ask(endless, 0, 1, None)
        archive.close()

    asyncio.run(asyncio.wait_for(ask(), PATIENCE_S))
    store.close()


def test_a_stamp_of_another_century_moves_no_time_and_ends_no_tail() -> None:
    sky = Sky()
    now_s = time.time()
    station_events_begin, station_events.BEGIN_NS = station_events.BEGIN_NS, time.time_ns()
    try:
        lines = [row(1, t / 10) for t in range(20)]
        for line in lines[:10]:
            sky.take(message_of(line))
        stray = json.dumps({"event": "sensor", "at": AHEAD_S, "name": "x", "state": "ok"})
        sky.take(message_of(stray))
        ahead = json.loads(lines[9]) | {"at": AHEAD_S, "timestamp": AHEAD_S}
        sky.take(message_of(json.dumps(ahead)))
        for line in lines[10:]:
            sky.take(message_of(line))
    finally:
        station_events.BEGIN_NS = station_events_begin
    shown = json.loads(sky.snapshot())
    assert abs(shown["now"] - now_s) < 600
    assert len(shown["tracks"][0]["rows"]) >= 9  # what came since


def test_no_names_and_no_numbers_fill_the_sky() -> None:
    sky = Sky()
    for t in range(10):
        sky.take(message_of(row(1_000_000, t / 10)))
    for i in range(20 * MOST_TRACKS):
        sky.take(message_of(row(i, 1.0)))
        sky.take(message_of(sensor(f"s{i}", "ok"), "evil"))
    sky.take(message_of(sensor("mid360", "silent"), "honest"))
    text = sky.snapshot()
    assert len(text) < 1_000_000
    shown = json.loads(text)
    assert len(shown["tracks"]) == MOST_TRACKS
    assert 1_000_000 in {t["track"] for t in shown["tracks"]}  # it flies, the others came once
    assert "mid360" in {e["name"] for e in shown["events"]}  # of another station
    assert shown["crowded"] is True


def test_many_tails_together_are_bounded() -> None:
    sky = Sky()
    for t in range(600):
        for n in range(100):
            sky.take(message_of(row(n, t / 10)))
    tails = [len(t["rows"]) for t in json.loads(sky.snapshot())["tracks"]]
    assert len(tails) == 100
    assert sum(tails) <= 25_000
    assert min(tails) > 100


def test_what_is_not_heard_grows_old_and_is_forgotten(monkeypatch) -> None:
    sky, passed_s = Sky(), [0.0]
    begin_s = time.monotonic()
    monkeypatch.setattr(sky._clock, "_machine_s", lambda: begin_s + passed_s[0])
    for line in (sensor("mid360", "ok"), track(7), row(7, 0.0)):
        sky.take(message_of(line))
    passed_s[0] = 240.0
    shown = json.loads(sky.snapshot())
    assert shown["tracks"][0]["age_s"] == pytest.approx(240, abs=1)
    assert shown["events"][0]["age_s"] == pytest.approx(240, abs=1)
    assert shown["heard"] == {"station": pytest.approx(240, abs=1)}
    sky.take(message_of(end(8, 0.0)))  # as told of a station that says nothing more
    assert json.loads(sky.snapshot())["heard"]["station"] == pytest.approx(240, abs=1)
    passed_s[0] = FORGET_S + 1
    assert json.loads(sky.snapshot())["tracks"] == []


def test_what_an_old_file_says_is_as_old_as_its_stamps() -> None:
    sky = Sky()
    before, station_events.BEGIN_NS = station_events.BEGIN_NS, time.time_ns() - 3 * 3600 * 10**9
    try:
        sky.take(message_of(state("running")), old=True)
    finally:
        station_events.BEGIN_NS = before
    assert json.loads(sky.snapshot())["events"][0]["age_s"] == pytest.approx(3 * 3600, abs=60)


def test_a_flood_is_sent_as_the_sky_that_it_makes() -> None:
    async def check() -> None:
        pages = Pages(Sky())
        page = pages.told("{}")
        await anext(page)
        waits = asyncio.ensure_future(anext(page))
        await asyncio.sleep(0)
        pages.tell()
        assert b"snapshot" in await waits
        for t in range(5000):
            pages.take(message_of(row(1, t / 100)))
        assert len(pages._fresh) <= 1100
        pages._snapshot_s = -1e9
        pages.tell()
        answer = await anext(page)
        assert answer.startswith(b"event: snapshot")
        assert len(answer) < 200_000

    asyncio.run(check())


@pytest.mark.parametrize(
    ("path", "headers", "status"),
    [
        ("/spans", {"Sec-Fetch-Site": "cross-site"}, 403),
        ("/spans", {"Sec-Fetch-Site": "same-site"}, 403),
        ("/live", {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "no-cors"}, 403),
        ("/page.js", {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Dest": "script"}, 403),
        ("/history?since=0&until=1", {"Origin": "http://evil.example"}, 403),
        ("/history?since=0&until=1", {"Origin": "null"}, 403),
        ("/spans", {"Origin": "http://localhost:1"}, 403),
        ("/spans", {"Upgrade": "websocket"}, 400),
        ("/spans", {"Sec-Fetch-Site": "same-origin"}, 200),
        ("/spans", {"Sec-Fetch-Site": "none"}, 200),
        ("/", {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "navigate",
               "Sec-Fetch-Dest": "document"}, 200),
        ("/", {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "navigate",
               "Sec-Fetch-Dest": "iframe"}, 403),
    ],
)  # fmt: skip
def test_what_another_site_asks_is_not_worked_off(path, headers, status, server) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=PATIENCE_S)
    with contextlib.closing(connection):
        connection.request("GET", path, headers=headers)
        assert connection.getresponse().status == status


def test_the_token_is_not_said_and_its_file_is(tmp_path) -> None:
    secret = "S" * 20
    file = tmp_path / "token"
    file.write_text(secret)
    with Watch("-", "--token-file", file) as watch:
        assert watch.url == f"http://127.0.0.1:{watch.port}/"
        code, said = watch.end()
    assert code == 0
    assert str(file) in said
    assert secret not in said


def test_a_locked_and_then_damaged_store_ends_nothing(tmp_path: Path) -> None:
    path, append = tmp_path / "sky.db", appended(tmp_path / "events.jsonl")
    append(row(1, 0.0))
    with Watch(tmp_path / "events.jsonl", "--store", path) as watch:
        wait_until(lambda: stored(watch), "it is stored")
        other = sqlite3.connect(path, isolation_level=None)
        other.execute("BEGIN IMMEDIATE")
        append(*[row(1, t / 10) for t in range(1, 20)])
        for _ in range(5):
            assert watch.ask("/")[0] == 200
        other.execute("ROLLBACK")
        wait_until(lambda: stored(watch)[0][3] - stored(watch)[0][2] > 1.8, "the rest is stored")
        other.close()
        assert watch.end()[0] == 0
