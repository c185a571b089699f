"""`unlidar relay`: what others get, read back by programs that are not ours."""

from __future__ import annotations

import asyncio
import contextlib
import json
import shutil
import signal
import socket
import ssl
import subprocess
import sys
import threading
import time
import xml.etree.ElementTree as Xml
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import pytest
from live_program import PATIENCE_S, wait_until
from station_events import (
    BEGIN_NS,
    appended,
    end,
    free_port,
    returns,
    row,
    sensor,
    square,
    state,
    track,
    write_site,
)
from unlidar.events.source import _File

FLIGHT = [
    sensor("mid360", "ok"),
    state("warming_up"),
    track(7, 1.0),
    *[row(7, t / 10, late=t < 10) for t in range(60)],
    end(7, 16.0),
]
ZONE = square(50, "apron <&>")


UPGRADE = (
    b"GET / HTTP/1.1\r\nHost: a\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n\r\n"
)


class Relay:
    """The command as a process of its own."""

    def __init__(self, *arguments: object, stdin: bool = False) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "unlidar", "relay", "--verbose", *map(str, arguments)],
            stdin=subprocess.PIPE if stdin else subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.said: list[str] = []
        self._reader = threading.Thread(target=lambda: self.said.extend(self.process.stderr))
        self._reader.start()

    def __enter__(self) -> Relay:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait()
        self._reader.join()

    def wait_for(self, text: str) -> None:
        wait_until(lambda: any(text in line for line in self.said), f"'{text}' is said")

    def end(self, number: signal.Signals | None = None) -> tuple[int, str]:
        if number is not None:
            self.process.send_signal(number)
        elif self.process.stdin:
            self.process.stdin.close()
        code = self.process.wait(PATIENCE_S)
        self._reader.join()
        return code, "".join(self.said)

    def feed(self, *lines: str) -> None:
        self.process.stdin.write("".join(line + "\n" for line in lines))
        self.process.stdin.flush()


class Receiver:
    """Takes what comes by TCP, also by TLS; may be closed and opened again at its port."""

    def __init__(self, tls: ssl.SSLContext | None = None, port: int = 0) -> None:
        self._tls = tls
        self.data = bytearray()
        self._listener = socket.create_server(("127.0.0.1", port), reuse_port=True)
        self.port = self._listener.getsockname()[1]
        self._connections: list[socket.socket] = []
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                connection, _ = self._listener.accept()
                with contextlib.suppress(OSError):
                    if self._tls is not None:
                        connection = self._tls.wrap_socket(connection, server_side=True)
                    self._connections.append(connection)
                    while data := connection.recv(65536):
                        self.data += data

    def close(self) -> None:
        self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        for connection in self._connections:
            with contextlib.suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)
            connection.close()

    def events(self) -> list[Xml.Element]:
        pieces = bytes(self.data).split(b"<?xml")[1:]
        return [Xml.fromstring(b"<?xml" + piece) for piece in pieces if b"</event>" in piece]


@pytest.fixture
def site(tmp_path: Path) -> Path:
    return write_site(tmp_path, [ZONE])


@pytest.fixture
def udp() -> Iterator[tuple[int, list[Xml.Element]]]:
    """A port and the Cursor on Target events that came to it, parsed one a datagram."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        listener.settimeout(PATIENCE_S)
        events: list[Xml.Element] = []

        def listen() -> None:
            with contextlib.suppress(OSError):
                while data := listener.recv(65536):
                    assert_tak_reads(data)
                    events.append(Xml.fromstring(data))

        threading.Thread(target=listen, daemon=True).start()
        yield listener.getsockname()[1], events


def assert_tak_reads(xml: bytes) -> None:
    """TAK's own form of an event, made by a parser that is not ours, says the same."""
    import takproto

    event = Xml.fromstring(xml)
    stream = takproto.TAKProtoVer.STREAM
    read = takproto.parse_proto(takproto.xml2proto(xml, stream)).cotEvent
    assert (read.uid, read.type) == (event.get("uid"), event.get("type"))
    point = {key: float(value) for key, value in event.find("point").attrib.items()}
    assert (read.lat, read.lon, read.hae) == (point["lat"], point["lon"], point["hae"])
    assert read.detail.contact.callsign == event.find("detail/contact").get("callsign")


def moments(event: Xml.Element) -> list[float]:
    return [
        datetime.strptime(event.get(key), "%Y-%m-%dT%H:%M:%S.%fZ").replace(tzinfo=UTC).timestamp()
        for key in ("time", "start", "stale")
    ]


def test_tak_gets_places_course_sigma_alarm_and_end_by_udp(site, udp) -> None:
    port, got = udp
    with Relay("-", "--site", site, "--to", f"cot+udp://127.0.0.1:{port}", stdin=True) as relay:
        relay.feed(*FLIGHT)
        code, said = relay.end()
        assert code == 0, said
    wait_until(lambda: len(got) >= 8, "all events have come")
    places = [e for e in got if e.get("type") == "a-u-A-M-H-Q"]
    # Rows of 1 to 5.9 s, one a second; those before the confirmation are none of now; the end.
    assert len(places) == 6
    for event in places:
        assert event.get("uid") == "unlidar.north.7"
        point = event.find("point").attrib
        assert float(point["lat"]) == pytest.approx(47.0, abs=1e-8)
        assert float(point["lon"]) == pytest.approx(8.0, abs=1e-8)
        assert float(point["hae"]) == pytest.approx(520.0, abs=0.01)
        assert (point["ce"], point["le"]) == ("0.07", "0.09")
        assert event.find("detail/track").attrib == {"course": "90.0", "speed": "1.00"}
        assert event.find("detail/contact").get("callsign") == "north-7"
    # The stamps are of years ago: the time is that of sending, or TAK would show nothing.
    assert "gets the time of sending" in said
    time_s, start_s, stale_s = moments(places[0])
    assert abs(time_s - time.time()) < PATIENCE_S
    assert (start_s, stale_s) == (time_s, pytest.approx(time_s + 5))
    assert len(set(moments(places[-1]))) == 1  # stale at once
    alarm, over = (e for e in got if e.get("type") != "a-u-A-M-H-Q")
    assert (alarm.get("type"), over.get("type")) == ("b-a-g", "b-a-o-can")
    assert alarm.get("uid") == over.get("uid")
    assert alarm.find("detail/emergency").get("type") == "Geo-fence Breached"
    assert over.find("detail/emergency").get("cancel") == "true"
    assert alarm.find("detail/link").get("uid") == "unlidar.north.7"
    assert "apron <&>" in alarm.find("detail/contact").get("callsign")


def test_stamps_of_now_are_the_times_that_tak_gets(site, udp) -> None:
    port, got = udp
    shift = time.time() - BEGIN_NS * 1e-9
    with Relay("-", "--site", site, "--to", f"cot+udp://127.0.0.1:{port}", stdin=True) as relay:
        relay.feed(row(1, shift))
        relay.end()
    wait_until(lambda: got, "the event has come")
    assert moments(got[0])[0] == pytest.approx(BEGIN_NS * 1e-9 + shift, abs=1e-3)


def certificate(folder: Path) -> tuple[Path, Path]:
    key, pem = folder / "key.pem", folder / "cert.pem"
    if shutil.which("openssl") is None:
        pytest.skip("openssl is not installed")
    subprocess.run(
        [
            *("openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256"),
            *("-nodes", "-days", "2", "-subj", "/CN=localhost", "-keyout", key, "-out", pem),
            *("-addext", "subjectAltName=DNS:localhost"),
        ],
        check=True,
        capture_output=True,
    )
    return pem, key


@pytest.mark.parametrize("tls", [False, True])
def test_a_tak_server_that_goes_and_comes_back_gets_the_rest(tls, tmp_path) -> None:
    context, output = None, {"to": ""}
    if tls:
        pem, key = certificate(tmp_path)
        context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
        context.load_cert_chain(pem, key)
        output["ca_file"] = "cert.pem"
    server = Receiver(context)
    output |= {"to": f"cot+{'tls' if tls else 'tcp'}://localhost:{server.port}", "every_s": 0.0}
    with Relay("-", "--site", write_site(tmp_path, outputs=[output]), stdin=True) as relay:
        relay.feed(*[row(1, t / 10) for t in range(20)])
        wait_until(lambda: len(server.events()) == 20, "the first rows have come")
        server.close()
        relay.wait_for("it is tried again")
        relay.feed(*[row(1, t / 10, (0.0, 0.0, t)) for t in range(20, 40)])
        again = Receiver(context, server.port)
        wait_until(lambda: len(again.events()) == 20, "the rest has come")
        relay.wait_for("is there again")
        code, said = relay.end()
    again.close()
    assert code == 0
    assert "40 messages sent" in said
    heights = [float(e.find("point").get("hae")) - 500 for e in again.events()]
    assert heights == pytest.approx(range(20, 40), abs=0.01)


def test_a_tls_server_that_nobody_vouches_for_gets_nothing(tmp_path) -> None:
    pem, key = certificate(tmp_path)
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    context.load_cert_chain(pem, key)
    server = Receiver(context)
    url = f"cot+tls://localhost:{server.port}"
    with Relay("-", "--site", write_site(tmp_path), "--to", url, stdin=True) as relay:
        relay.feed(row(1, 0))
        relay.wait_for("certificate verify failed")
        code, said = relay.end(signal.SIGTERM)
    server.close()
    assert code == 0
    assert "0 messages sent, 1 not" in said
    assert server.data == b""


@pytest.fixture
def broker(tmp_path: Path) -> Iterator[Broker]:
    with Broker(tmp_path) as broker:
        yield broker


class Broker:
    """Debian's mosquitto, at a port of its own."""

    def __init__(self, folder: Path) -> None:
        self.program = shutil.which("mosquitto", path="/usr/sbin:/usr/bin:/usr/local/sbin")
        if self.program is None or shutil.which("mosquitto_sub") is None:
            pytest.skip("the packages mosquitto and mosquitto-clients are not installed")
        self.port = free_port()
        self.config = folder / "mosquitto.conf"
        self.config.write_text(f"listener {self.port} 127.0.0.1\nallow_anonymous true\n")
        self.start()

    def __enter__(self) -> Broker:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def start(self) -> None:
        self.process = subprocess.Popen(
            [self.program, "-c", self.config], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )

        def answers() -> bool:
            with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", self.port)):
                return True
            return False

        wait_until(answers, "the broker answers")

    def stop(self) -> None:
        self.process.kill()
        self.process.wait()

    @contextlib.contextmanager
    def subscribed(self, topic: str) -> Iterator[list[tuple[str, str]]]:
        """Output of mosquitto_sub: topics with texts."""
        process = subprocess.Popen(
            [
                *("mosquitto_sub", "-h", "127.0.0.1", "-p", str(self.port), "-q", "1"),
                *("-t", topic, "-t", "ready", "-F", "%t %p"),
            ],
            stdout=subprocess.PIPE,
            text=True,
        )
        got: list[tuple[str, str]] = []

        def read() -> None:
            for line in process.stdout:
                got.append(tuple(line.rstrip("\n").split(" ", 1)))

        reader = threading.Thread(target=read)
        reader.start()
        address = ["-h", "127.0.0.1", "-p", str(self.port)]
        wait_until(
            lambda: (
                subprocess.run(["mosquitto_pub", *address, "-t", "ready", "-m", "1"], check=True),
                any(t == "ready" for t, _ in got),
            )[1],
            "mosquitto_sub listens",
        )
        try:
            yield got
        finally:
            process.kill()
            process.wait()
            reader.join()


def test_mqtt_gets_every_event_in_order_and_keeps_the_states(site, broker) -> None:
    with broker.subscribed("unlidar/#") as got:
        url = f"mqtt://127.0.0.1:{broker.port}"
        with Relay("-", "--site", site, "--to", url, stdin=True) as relay:
            relay.feed(*FLIGHT, returns("mid360", 12.0, [[1.0, 2.0, 3.0]]))  # which stay here
            code, said = relay.end()
            assert code == 0, said
        wait_until(lambda: ("unlidar/north/relay", "offline") in got, "it has said goodbye")
        told = [
            (topic, json.loads(text))
            for topic, text in got
            if text.startswith("{") and topic != "unlidar/north/site"
        ]
    assert [text for topic, text in got if topic == "unlidar/north/relay"] == ["online", "offline"]
    assert [t["event"] for _, t in told if t["event"] != "alarm"] == [
        json.loads(line)["event"] for line in FLIGHT
    ]
    stamps = [t["timestamp"] for topic, t in told if topic == "unlidar/north/row"]
    assert len(stamps) == 60
    assert stamps == sorted(stamps)
    assert [t["state"] for topic, t in told if topic == "unlidar/north/alarm"] == [
        "raised",
        "ended",
    ]
    with broker.subscribed("unlidar/#") as kept:  # who comes later
        wait_until(lambda: sum(t != "ready" for t, _ in kept) >= 4, "what is kept has come")
    assert {topic for topic, _ in kept if topic != "ready"} == {
        "unlidar/north/relay",
        "unlidar/north/sensor/mid360",
        "unlidar/north/site",
        "unlidar/north/state",
    }


def test_a_broker_that_dies_gets_all_the_rest_in_order(site, broker) -> None:
    url = f"mqtt://127.0.0.1:{broker.port}"
    with Relay("-", "--site", site, "--to", url, stdin=True) as relay:
        with broker.subscribed("unlidar/+/row") as before:
            relay.feed(*[row(1, t / 10) for t in range(100)])
            wait_until(lambda: len([t for t, _ in before if t != "ready"]) >= 100, "100 rows")
        broker.stop()
        relay.wait_for("it is tried again")
        broker.start()
        with broker.subscribed("unlidar/+/row") as got:
            relay.feed(*[row(1, t / 10) for t in range(100, 300)])
            wait_until(lambda: len({x for t, x in got if t != "ready"}) == 200, "200 rows")
            code, _ = relay.end()
    assert code == 0
    texts = [text for topic, text in got if topic != "ready"]
    stamps = [json.loads(text)["timestamp"] for text in dict.fromkeys(texts)]
    assert stamps == sorted(stamps)


def test_web_sockets_get_every_event_and_other_sites_pages_nothing(site, tmp_path) -> None:
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect

    port = free_port()
    events = tmp_path / "events.jsonl"
    append = appended(events)
    append(track(1), row(1, 0))  # of before
    url = f"ws://127.0.0.1:{port}"
    with Relay(events, "--site", site, "--to", url) as relay:
        relay.wait_for("is open")
        with connect(url) as one, connect(url) as two:
            time.sleep(0.5)  # what there was has been read
            append(*FLIGHT)
            for client in (one, two):
                got = [json.loads(client.recv(timeout=PATIENCE_S)) for _ in range(len(FLIGHT) + 2)]
                told = [e["event"] for e in got]
                # The engine has begun anew: the track of before has ended.
                assert told[:4] == ["sensor", "end", "state", "track"]
                assert told.count("row") == 60
        with pytest.raises(InvalidStatus):
            connect(url, origin="https://elsewhere.example")
        for junk in (b"junk\r\n\r\n", UPGRADE.replace(b"/", b"//[", 1)):
            with socket.create_connection(("127.0.0.1", port), PATIENCE_S) as other:
                other.sendall(junk)
                answer = other.recv(100)
        assert answer.startswith(b"HTTP/1.1 101")
        code, said = relay.end(signal.SIGINT)
    assert code == 0
    assert "Traceback" not in said
    assert "failed" not in said


def test_a_file_is_followed_across_rotation_and_what_it_held_is_not_sent(tmp_path, broker) -> None:
    events = tmp_path / "events.jsonl"
    append = appended(events)
    append(track(1), row(1, 0))
    with broker.subscribed("unlidar/+/row") as got:
        relay = Relay(events, "--to", f"mqtt://127.0.0.1:{broker.port}")
        with relay:
            wait_until(
                lambda: relay.process.poll() is not None or _reads(relay, events), "it reads"
            )
            time.sleep(0.5)
            append(row(1, 1))
            wait_until(lambda: len(_rows(got)) == 1, "the first new row has come")
            with events.open("a") as file:  # half a line
                file.write(row(1, 2)[:50])
                file.flush()
                time.sleep(0.3)
                file.write(row(1, 2)[50:] + "\n")
            wait_until(lambda: len(_rows(got)) == 2, "the line that was whole later has come")
            append(row(1, 3))
            events.rename(tmp_path / "events.jsonl.1")
            with (tmp_path / "events.jsonl.1").open("a") as file:  # until SIGHUP
                file.write(row(1, 4) + "\n")
            append(row(1, 5))
            wait_until(lambda: len(_rows(got)) == 5, "all rows have come")
            code, _ = relay.end(signal.SIGTERM)
    assert code == 0
    begin = BEGIN_NS * 1e-9
    assert [round(e["timestamp"] - begin) for e in _rows(got)] == [1, 2, 3, 4, 5]


def test_what_came_while_the_file_was_opened_is_new(tmp_path) -> None:
    path = tmp_path / "events.jsonl"
    old, new = row(1, 0) + "\n", row(1, 1) + "\n"
    path.write_text(old + new)

    async def flags() -> list[bool]:
        with path.open("rb") as file:
            pieces = _File(str(path), path, whole=False)._of(file, len(old))
            return [line.old for _ in range(2) for line in await anext(pieces)]

    assert asyncio.run(flags()) == [True, False]


def _rows(got: list) -> list[dict]:
    return [json.loads(text) for topic, text in got if topic != "ready"]


def _reads(relay: Relay, path: Path) -> bool:
    descriptors = Path(f"/proc/{relay.process.pid}/fd")
    with contextlib.suppress(OSError):
        return any(fd.resolve() == path for fd in descriptors.iterdir())
    return False


def test_events_come_by_tcp_and_the_server_may_leave(tmp_path, broker) -> None:
    with (
        broker.subscribed("unlidar/+/row") as got,
        socket.create_server(("127.0.0.1", 0)) as server,
        Relay(
            f"tcp://127.0.0.1:{server.getsockname()[1]}",
            *("--to", f"mqtt://127.0.0.1:{broker.port}"),
        ) as relay,
    ):
        for turn in range(2):
            server.settimeout(PATIENCE_S)
            connection, _ = server.accept()
            with connection:
                connection.sendall((row(1, turn) + "\n").encode())
            wait_until(lambda turn=turn: len(_rows(got)) == turn + 1, "the row has come")
        assert relay.end(signal.SIGTERM)[0] == 0


def test_a_sensor_of_any_name_has_a_topic_that_brokers_take(site, broker) -> None:
    names = ["a/+/#", "x" * 120, "mast süd", "mid360"]
    with broker.subscribed("unlidar/#") as got:
        url = f"mqtt://127.0.0.1:{broker.port}"
        with Relay("-", "--site", site, "--to", url, stdin=True) as relay:
            relay.feed(*[sensor(name, "ok") for name in names], row(1, 0))
            code, said = relay.end()
        assert (code, "it is tried again" in said) == (0, False), said
        wait_until(lambda: "unlidar/north/row" in dict(got), "what is behind them has come")
    topics = [topic for topic, _ in got if "/sensor/" in topic]
    assert len(set(topics)) == len(topics)
    assert "unlidar/north/sensor/mid360" in topics
    assert all(topic.count("/") == 3 and topic.isascii() for topic in topics)


def test_each_run_of_a_relay_identifies_itself(site, broker) -> None:
    with broker.subscribed("unlidar/north/+") as got:
        for _ in range(2):
            with Relay(
                "-", "--site", site, "--to", f"mqtt://127.0.0.1:{broker.port}", stdin=True
            ) as relay:
                relay.feed(row(1, 0))
                assert relay.end()[0] == 0
        wait_until(lambda: sum(text == "offline" for _, text in got) == 2, "both have told")
    told = [json.loads(text) for topic, text in got if text.startswith("{")]
    assert [t["event"] for t in told] == 2 * ["site", "row"]
    first, second = (t["instance"] for t in told if t["event"] == "site")
    assert [t["instance"] for t in told] == [first, first, second, second] and first != second
    assert {t["origin"]["latitude_deg"] for t in told if t["event"] == "site"} == {47.0}


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["x.jsonl"], 2, "nobody to tell"),
        (["-", "--to", "http://a:1"], 2, "'http://a:1', expected HOST:PORT after one of cot+udp"),
        (["-", "--to", "cot+udp://a"], 2, "'cot+udp://a', expected HOST:PORT"),
        (["-", "--to", "cot+udp://a:99999"], 2, "expected HOST:PORT"),
        (["-", "--to", "cot+udp://a:1"], 3, "needs the site's 'origin'"),
        (["-", "--to", "ws://0.0.0.0:1"], 2, "needs a token"),
        (["udp://a:1", "--to", "mqtt://a"], 2, "expected a file, -, tcp://HOST:PORT"),
        (["/nowhere/x", "--to", "mqtt://a"], 4, "/nowhere/x: is no file of events"),
        (["-", "--to", "mqtt://a", "--site", "/nowhere/site.yaml"], 3, "/nowhere/site.yaml"),
    ],
)
def test_what_cannot_work_is_one_line(arguments, code, said, fails) -> None:
    assert said in fails(code, "relay", *arguments)


def test_nobody_is_waited_for_at_the_end_and_secrets_are_not_said() -> None:
    url = f"mqtt://user:hush@127.0.0.1:{free_port()}"
    with Relay("-", "--to", url, stdin=True) as relay:
        relay.feed(row(1, 0))
        relay.wait_for("it is tried again")
        code, said = relay.end(signal.SIGTERM)
    assert code == 0
    assert "0 messages sent, 1 not" in said
    assert "hush" not in said


@pytest.mark.parametrize("command", ["relay", "watch"])
def test_packages_that_are_missing_are_named(command, fails, monkeypatch) -> None:
    monkeypatch.setattr("unlidar.extras.find_spec", lambda name: None)
    said = fails(2, command, "-")
    assert "not installed: paho-mqtt, " in said
    assert "pip install 'unlidar-track[station]'" in said
