"""`unlidar watch`: what its server answers, and what it never does."""

from __future__ import annotations

import asyncio
import contextlib
import http.client
import json
import os
import re
import shutil
import signal
import socket
import ssl
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from live_program import PATIENCE_S, wait_until
from station_events import (
    BEGIN_NS,
    appended,
    end,
    returns,
    row,
    sensor,
    square,
    stamp,
    state,
    track,
    write_site,
)
from unlidar.events.site import Site, load_site, load_zones
from unlidar.events.station import Station
from unlidar.watch.pages import Pages
from unlidar.watch.sky import TAIL_S, Sky

SECRET = "0123456789abcdef"
PATHS = (
    "/",
    "/page.css",
    "/page.js",
    "/draw.js",
    "/live.js",
    "/spans",
    "/history?since=0&until=9",
    "/metrics",
    "/live",
)


class Watch:
    """The command as a process of its own, at a port that the kernel chose."""

    def __init__(self, *arguments: object, port: int = 0) -> None:
        self.process = subprocess.Popen(
            [
                sys.executable,
                "-m",
                "unlidar",
                "watch",
                *map(str, arguments),
                "--port",
                str(port),
            ],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.url = self.process.stdout.readline().strip()
        found = re.search(r":(\d+)/", self.url)
        assert found, self.process.stderr.read()
        self.port = int(found[1])

    def __enter__(self) -> Watch:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.communicate()

    def end(self) -> tuple[int, str]:
        self.process.send_signal(signal.SIGTERM)
        _, said = self.process.communicate(timeout=PATIENCE_S)
        return self.process.returncode, said

    def ask(
        self, path: str, method: str = "GET", body: bytes | None = None, **headers: str
    ) -> tuple[int, dict, bytes]:
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE_S)
        try:
            connection.request(method, path, body, headers)
            answer = connection.getresponse()
            told = {k.lower(): v for k, v in answer.getheaders()}
            content = (
                b"" if told.get("content-type", "").startswith("text/event") else answer.read()
            )
            return answer.status, told, content
        finally:
            connection.close()

    @contextlib.contextmanager
    def live(self) -> Iterator[list[tuple[str, dict]]]:
        """Server-sent events as they come: (name, data)."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE_S)
        connection.request("GET", "/live")
        answer = connection.getresponse()
        assert answer.status == 200
        got: list[tuple[str, dict]] = []

        def read() -> None:
            name = "message"
            with contextlib.suppress(
                OSError, ValueError, AttributeError, http.client.HTTPException
            ):
                for line in iter(answer.readline, b""):
                    if line.startswith(b"event: "):
                        name = line[7:].strip().decode()
                    elif line.startswith(b"data: "):
                        got.append((name, json.loads(line[6:])))
                        name = "message"

        reader = threading.Thread(target=read, daemon=True)
        reader.start()
        try:
            yield got
        finally:
            with contextlib.suppress(OSError):
                connection.sock and connection.sock.shutdown(socket.SHUT_RDWR)
            reader.join(PATIENCE_S)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("watch")


@pytest.fixture(scope="module")
def watch(folder) -> Iterator[Watch]:
    events = folder / "events.jsonl"
    lines = [sensor("mid360", "ok"), state("running"), track(7, 1.0)]
    appended(events)(*lines, *[row(7, t / 10) for t in range(30)])
    site = write_site(folder, [square(50, "apron")])
    with Watch(events, "--site", site, "--store", folder / "sky.db") as watch:
        yield watch


def stored(watch: Watch) -> list:
    return json.loads(watch.ask("/spans")[2])["spans"]


def test_the_page_and_its_parts_are_served_with_strict_headers(watch) -> None:
    for path in PATHS:
        status, headers, content = watch.ask(path)
        assert status == 200, path
        assert "default-src 'none'" in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff"
        assert "access-control-allow-origin" not in headers
        assert "server" not in headers
        # Nothing is asked of any other machine.
        assert not re.search(rb"(src|href|url\(|fetch\(|import)[^\n]{0,9}https?://", content)


def test_no_request_but_get_is_answered(watch) -> None:
    for method in ("POST", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "FOO"):
        for path in (*PATHS, "/else"):
            assert watch.ask(path, method, b"x=1")[0] == 405, (method, path)


@pytest.mark.parametrize(
    "path",
    [
        "/../../etc/passwd", "/..%2f..%2fetc%2fpasswd", "//etc/passwd", "/page.js/../../server.py",
        "/site.yaml", "/sky.db", "/%00", "/page.js%00.html", "/page", "/static/page.js", "/.git",
        "/history/../page.js", "/favicon.ico",
    ],
)  # fmt: skip
def test_no_path_reads_a_file(path, watch) -> None:
    assert watch.ask(path)[0] == 404


@pytest.mark.parametrize(
    "query",
    [
        "", "?since=0", "?since=a&until=b", "?since=nan&until=1", "?since=inf&until=inf",
        "?since=5&until=1", "?since=0&until=1e9", "?since=1%27;DROP%20TABLE%20row&until=2",
        "?since=" + "9" * 400 + "&until=1",
    ],
)  # fmt: skip
def test_a_wrong_span_is_refused(query, watch) -> None:
    status, _, content = watch.ask(f"/history{query}")
    assert status == 400
    assert b"expected since and until" in content


@pytest.mark.parametrize(
    "host",
    [
        "evil.example", "evil.example:80", "127.0.0.1.evil.example", "", "[::1]evil.example",
        "localhost:1@evil.example", "localhost:evil.example", "localhost.", "[localhost",
    ],
)  # fmt: skip
def test_a_browser_that_was_told_another_name_is_refused(host, watch) -> None:
    """Or a page of that name could read everything (DNS rebinding)."""
    status, _, content = watch.ask("/spans", Host=host)
    assert status in (400, 421)
    assert b"spans" not in content
    for own in ("localhost", f"127.0.0.1:{watch.port}", "[::1]:1"):
        assert watch.ask("/spans", Host=own)[0] == 200


def test_a_live_page_gets_what_there_is_and_then_what_comes(watch, folder) -> None:
    with watch.live() as got:
        wait_until(lambda: len(got) >= 2, "the snapshot has come")
        (first, site), (second, sky) = got[:2]
        assert (first, second) == ("begin", "snapshot")
        assert (site["station"], site["heading"]) == ("north", 90.0)
        assert site["zones"][0]["name"] == "apron"
        (known,) = sky["tracks"]
        assert (known["track"], len(known["rows"])) == (7, 30)
        assert [e["event"] for e in sky["events"]] == ["sensor", "state", "alarm"]
        appended(folder / "events.jsonl")(*[row(7, t / 10) for t in range(30, 50)], end(7, 16.0))
        wait_until(lambda: any(e["event"] == "end" for e in events(got)), "the end has come")
        stamps = [e["timestamp"] for e in events(got) if e["event"] == "row"]
        assert stamps == [float(stamp(t / 10)) for t in range(30, 50)]
        assert [e["state"] for e in events(got) if e["event"] == "alarm"] == ["ended"]
    begin = float(stamp(0))
    wait_until(lambda: any(s[3] - s[2] > 4.8 for s in stored(watch)), "all is stored")
    told = json.loads(watch.ask(f"/history?since={begin + 1:.3f}&until={begin + 1.45:.3f}")[2])
    assert [r[0] - begin for r in told["tracks"][0]["rows"]] == pytest.approx(
        [1.0, 1.1, 1.2, 1.3, 1.4], abs=1e-3
    )


def events(got: list[tuple[str, dict]]) -> list[dict]:
    return [e for name, batch in got if name == "message" for e in batch["events"]]


def test_returns_come_from_a_file_of_their_own_and_its_successors(tmp_path) -> None:
    """Also from a folder that is made later, whatever the stamps of old events are."""
    (tmp_path / "events.jsonl").write_text(row(7, -1e6) + "\n")
    own = tmp_path / "run/returns.jsonl"
    arguments = (tmp_path / "events.jsonl", "--returns", own)
    with Watch(*arguments) as watch, watch.live() as got:
        wait_until(lambda: len(got) >= 2, "the snapshot has come")
        own.parent.mkdir()
        told = []
        for second in range(3):
            work = own.with_suffix(".new")
            work.write_text(returns("mid360", second, np.ones((3, 3))) + "\n")
            work.replace(own)
            told.append(second)
            wait_until(lambda: shown(got) == told, "these have come, once")
        code, said = watch.end()
    assert (code, said) == (0, "")


def shown(got: list[tuple[str, dict]]) -> list[float]:
    """Seconds of the returns that came."""
    begin_s = BEGIN_NS / 1e9
    return [
        round(e["timestamp"] - begin_s) for name, data in got if name == "returns" for e in data
    ]


def test_a_file_of_returns_that_is_none_is_refused(tmp_path, fails) -> None:
    events = tmp_path / "events.jsonl"
    assert "is no file of events" in fails(4, "watch", events, "--returns", tmp_path)
    broker = "mqtt://127.0.0.1:1"
    assert "--returns is for" in fails(2, "watch", broker, "--returns", tmp_path / "r")


def test_other_addresses_need_a_token_which_leaves_the_address(folder, fails) -> None:
    said = fails(2, "watch", "-", "--address", "0.0.0.0")
    assert "expected --token-file FILE" in said
    token = folder / "token"
    token.write_text("short\n")
    assert "at least 16" in fails(3, "watch", "-", "--address", "0.0.0.0", "--token-file", token)
    token.write_text(SECRET + "\n")
    arguments = ("-", "--address", "0.0.0.0", "--token-file", token)
    with Watch(*arguments) as watch:
        assert watch.url == f"http://0.0.0.0:{watch.port}/"
        for path in PATHS:
            assert watch.ask(path, Host="station.example")[0] == 401
            assert watch.ask(path, Cookie="unlidar=" + SECRET)[0] == 401
        assert watch.ask("/?token=wrong")[0] == 401
        assert watch.ask("/?token=%C3%A4")[0] == 401
        status, headers, _ = watch.ask(f"/?token={SECRET}")
        assert (status, headers["location"]) == (303, "/")
        cookie = headers["set-cookie"]
        assert SECRET not in cookie
        assert "HttpOnly" in cookie
        assert "SameSite=strict" in cookie
        kept = cookie.partition(";")[0]
        assert watch.ask("/spans", Cookie=kept, Host="station.example")[0] == 200
    with Watch(*arguments) as watch:  # who was let in is let in again
        assert watch.ask("/spans", Cookie=kept)[0] == 200


def test_it_is_served_by_tls(folder, fails) -> None:
    if shutil.which("openssl") is None:
        pytest.skip("openssl is not installed")
    key, pem = folder / "key.pem", folder / "cert.pem"
    subprocess.run(
        [
            "openssl",
            "req",
            "-x509",
            "-newkey",
            "ec",
            "-pkeyopt",
            "ec_paramgen_curve:P-256",
            "-nodes",
            "-days",
            "2",
            "-subj",
            "/CN=localhost",
            "-keyout",
            key,
            "-out",
            pem,
            "-addext",
            "subjectAltName=DNS:localhost",
        ],
        check=True,
        capture_output=True,
    )
    with Watch("-", "--certificate", pem, "--key", key) as watch:
        assert watch.url.startswith("https://")
        connection = http.client.HTTPSConnection(
            "localhost", watch.port, context=ssl.create_default_context(cafile=pem), timeout=60
        )
        connection.request("GET", "/")
        assert connection.getresponse().status == 200
        connection.close()
    assert "certificate or key" in fails(3, "watch", "-", "--certificate", folder / "none.pem")


def test_it_ends_at_a_signal_with_pages_open_and_everything_is_stored(tmp_path) -> None:
    events_file = tmp_path / "events.jsonl"
    append = appended(events_file)
    append(row(1, 0))
    with Watch(events_file, "--store", tmp_path / "sky.db") as watch, watch.live() as got:
        wait_until(lambda: len(got) >= 2, "the page is there")
        append(row(1, 1))
        wait_until(lambda: events(got), "the row has come")
        code, said = watch.end()
    assert (code, said) == (0, "")
    from unlidar.history.reader import Reader

    (found,) = Reader(tmp_path / "sky.db").tracks()
    assert len(found.rows) == 2


def test_it_ends_at_a_signal_while_a_pipe_is_full_of_events(tmp_path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    line = row(1, 0).encode() + b"\n"

    def flood() -> None:
        with contextlib.suppress(BrokenPipeError), pipe.open("wb") as file:
            while True:
                file.write(1000 * line)

    writer = threading.Thread(target=flood, daemon=True)
    writer.start()
    with Watch(pipe) as watch:
        time.sleep(1.0)
        code, said = watch.end()
    assert code == 0
    assert "Traceback" not in said
    writer.join(PATIENCE_S)
    assert not writer.is_alive()


def test_an_address_that_is_taken_is_one_line(watch, fails) -> None:
    said = fails(5, "watch", "-", "--port", watch.port)
    assert f"127.0.0.1:{watch.port}: cannot be served" in said


def test_memory_follows_what_flies(tmp_path) -> None:
    """Tails are a minute long, and what has ended is gone."""
    station, sky = Station(Site()), Sky()
    for number in range(200):
        begin = number * 20.0
        for line in (track(number, begin), *[row(number, begin + t / 2) for t in range(40)]):
            for message in station.take(line):
                sky.take(message)
        for message in station.take(end(number, begin + 30)):
            sky.take(message)
    for t in range(3000):
        for message in station.take(row(999, 4100 + t / 20)):
            sky.take(message)
    tracks = json.loads(sky.snapshot())["tracks"]
    assert [t["track"] for t in tracks] == [999]
    rows = tracks[0]["rows"]
    assert rows[-1][0] - rows[0][0] == pytest.approx(TAIL_S, abs=0.2)
    assert len(rows) <= 10 * TAIL_S + 2  # thinned to ten a second


def test_a_page_that_does_not_read_is_sent_away_and_holds_up_nobody(tmp_path) -> None:
    async def check() -> None:
        site = load_site(write_site(tmp_path, [square(50)]))
        station = Station(site, load_zones(site), places=False)
        pages = Pages(Sky())
        lazy, keen = pages.told("{}"), pages.told("{}")
        for page in (lazy, keen):
            assert b"begin" in await anext(page)
        waits = [asyncio.ensure_future(anext(page)) for page in (lazy, keen)]
        await asyncio.sleep(0)
        pages.tell()
        snapshots = [await wait for wait in waits]
        assert snapshots[0] is snapshots[1]  # made once
        read = 0
        for t in range(500):
            for message in station.take(row(1, t / 10)):
                pages.take(message)
            keen_waits = asyncio.ensure_future(anext(keen))
            await asyncio.sleep(0)
            pages.tell()
            read += (await keen_waits).count(b'"row"')
        assert read == 500
        with pytest.raises(StopAsyncIteration):
            await anext(lazy)

    asyncio.run(check())
