"""The page of `unlidar watch` in a real browser, with events played live."""

from __future__ import annotations

import base64
import contextlib
import io
import json
import math
import os
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
import station_events
from browser import NARROW, WAIT_S, WIDE, chromium
from hostile import HOSTILE, broken_out
from station_events import end, returns, row, sensor, square, state, track, write_site
from test_watch import Watch

SOON_S = 2.0  # from a row to the page
TRACKS, RATE_HZ = 10, 20
INSIDE, VELOCITY = (5.0, 3.0, 12.0), (3.0, 4.0, -1.0)


class Flight:
    """Ten drones on circles, written to a file of events as an engine would."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.written_s: dict[int, float] = {}  # track -> when its first row was written
        self.rows: dict[int, int] = dict.fromkeys(range(1, TRACKS + 1), 0)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._fly)

    def __enter__(self) -> Flight:
        self.write(sensor("mid360", "ok"), sensor("avia", "silent"), state("running", dropped=3))
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.land()

    def land(self) -> None:
        self._stop.set()
        self._thread.join()

    def write(self, *lines: str) -> None:
        with self._path.open("a") as file:
            file.write("".join(line + "\n" for line in lines))

    def _fly(self) -> None:
        begin, step = time.monotonic(), 0
        while not self._stop.wait(max(0, begin + step / RATE_HZ - time.monotonic())):
            lines = []
            for number in range(1, TRACKS + 1):
                if step < number * 4:
                    continue  # one after the other
                if number not in self.written_s:
                    lines.append(track(number, step / RATE_HZ))
                lines.append(row(number, step / RATE_HZ, *self.course(number, step / RATE_HZ)))
            self.write(*lines)
            for number in range(1, TRACKS + 1):
                if step >= number * 4:
                    self.written_s.setdefault(number, time.monotonic())
                    self.rows[number] += 1
            step += 1

    @staticmethod
    def course(number: int, t: float) -> tuple[tuple, tuple]:
        radius, turn = 15.0 + 5 * number, 0.3 + 0.02 * number
        angle = turn * t + number
        speed = radius * turn
        xyz = radius * math.cos(angle), radius * math.sin(angle), 10.0 + 3 * number
        return xyz, (-speed * math.sin(angle), speed * math.cos(angle), 0.0)


class Page:
    def __init__(self, driver, url: str, size: tuple[int, int]) -> None:
        self.driver, self.size = driver, size
        driver.get("about:blank")
        self.log("browser"), self.log("performance")  # of the page before
        width, height = size
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 800}
        driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        driver.get(url)

    def log(self, name: str) -> list[dict]:
        return self.driver.get_log(name)

    def complaints(self) -> list[str]:
        return [entry["message"] for entry in self.log("browser") if entry["level"] == "SEVERE"]

    def run(self, script: str) -> object:
        return self.driver.execute_script(script)

    def wait(self, condition: str, seconds: float = WAIT_S) -> None:
        until = time.monotonic() + seconds
        while not self.run(f"return Boolean({condition})"):
            assert time.monotonic() < until, f"never came: {condition}"
            time.sleep(0.05)

    def click(self, selector: str) -> None:
        self.run(f"document.querySelector('{selector}').click()")

    def press(self, *keys: str) -> None:
        from selenium.webdriver.common.action_chains import ActionChains

        ActionChains(self.driver).send_keys(*keys).perform()

    def text(self, selector: str) -> str:
        return self.run(f"return document.querySelector('{selector}').innerText")

    def listed(self) -> list[int]:
        """Numbers of the tracks in the table."""
        keys = self.run(
            "return [...document.querySelectorAll('#tracks tr')].map(r => r.dataset.key)"
        )
        return [int(key.partition("/")[2]) for key in keys]

    def picture(self) -> np.ndarray:
        clip = self.run(
            "const b = byId('view').getBoundingClientRect();"
            "return {x: b.x + scrollX, y: b.y + scrollY,"
            "width: b.width, height: b.height, scale: 1}"
        )
        taken = self.driver.execute_cdp_cmd(
            "Page.captureScreenshot", {"clip": clip, "captureBeyondViewport": True}
        )
        png = io.BytesIO(base64.b64decode(taken["data"]))
        return np.round(matplotlib.image.imread(png, format="png")[..., :3] * 255).astype(int)


@pytest.fixture(scope="module")
def driver():
    with chromium() as browser:
        yield browser


@pytest.fixture(autouse=True)
def now() -> Iterator[None]:
    """Stamps of today, as a station has them."""
    before = station_events.BEGIN_NS
    station_events.BEGIN_NS = time.time_ns()
    yield
    station_events.BEGIN_NS = before


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_site(tmp_path, [square(18, "apron")])
    return tmp_path


def watch(folder: Path, **options) -> Watch:
    arguments = (folder / "events.jsonl", "--site", folder / "site.yaml")
    return Watch(*arguments, "--store", folder / "sky.db", **options)


@pytest.fixture(params=[WIDE, NARROW], ids=["1400px", "390px"])
def size(request) -> tuple[int, int]:
    return request.param


def test_tracks_appear_at_once_none_is_missing_and_it_is_smooth(driver, folder, size) -> None:
    with watch(folder) as served:
        page = Page(driver, served.url, size)
        page.wait("byId('link').textContent == 'connected'")
        seen_s: dict[int, float] = {}
        with Flight(folder / "events.jsonl") as flight:
            until = time.monotonic() + WAIT_S
            while len(seen_s) < TRACKS and time.monotonic() < until:
                for number in page.listed():
                    seen_s.setdefault(number, time.monotonic())
                time.sleep(0.02)
            assert sorted(seen_s) == list(range(1, TRACKS + 1))
            waits = [seen_s[n] - flight.written_s[n] for n in seen_s]
            assert max(waits) < (WAIT_S if _is_loaded() else SOON_S), waits
            before, begin = page.run("return frames"), time.monotonic()
            time.sleep(3)
            frames = (page.run("return frames") - before) / (time.monotonic() - begin)
            assert frames >= (1 if _is_loaded() else 20), frames
        rows = sum(flight.rows.values())
        page.wait(f"[...live.tracks.values()].reduce((n, t) => n + t.rows.length, 0) == {rows}")
        # Nothing is wider than the window, nothing asked of another machine, nothing complained of.
        assert page.run("return document.documentElement.scrollWidth <= innerWidth")
        cut = page.run(
            "return [...document.querySelectorAll('body *')].filter((e) => "
            "e.getBoundingClientRect().right > innerWidth + 1).map((e) => e.outerHTML.slice(0, 80))"
        )
        assert cut == []
        assert page.complaints() == []
        log = [json.loads(entry["message"])["message"] for entry in page.log("performance")]
        asked = [e["params"]["request"]["url"] for e in log if e["method"].endswith("BeSent")]
        assert all(url.startswith((served.url, "data:", "about:")) for url in asked), asked


def _is_loaded() -> bool:
    """Others use the machine too: then times say nothing of the page."""
    return float(Path("/proc/loadavg").read_text().split()[0]) > 2 * (os.cpu_count() or 1)


def one_drone(folder: Path, *more: str, inside: bool = True) -> None:
    at = INSIDE if inside else (60.0, 3.0, 12.0)
    with (folder / "events.jsonl").open("a") as file:
        lines = [sensor("mid360", "ok"), sensor("avia", "silent"), sensor("north", "blinded")]
        lines += [state("running", dropped=3)]
        lines += [track(7), *[row(7, t / 10, at, VELOCITY) for t in range(40)], *more]
        file.write("".join(line + "\n" for line in lines))


def ended() -> str:
    """Drone 7 ends now: an event of a time to come would not be believed."""
    return end(7, (time.time_ns() - station_events.BEGIN_NS) * 1e-9)


@contextlib.contextmanager
def telling(folder: Path, interval_s: float, lines: Callable[[float], str]) -> Iterator[None]:
    """Events of now, by their second, are appended at this interval."""
    stop = threading.Event()

    def tell() -> None:
        while not stop.wait(interval_s):
            at = (time.time_ns() - station_events.BEGIN_NS) * 1e-9
            with (folder / "events.jsonl").open("a") as file:
                file.write(lines(at))

    thread = threading.Thread(target=tell)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


@contextlib.contextmanager
def hovering(folder: Path) -> Iterator[None]:
    """Drone 7 is still told of, as far as the tests are slow."""
    one_drone(folder)
    with telling(folder, 0.2, lambda at: row(7, max(at, 4.0), INSIDE, VELOCITY) + "\n"):
        yield


def test_the_table_health_and_alarm_say_what_is(driver, folder, size) -> None:
    with watch(folder) as served:
        page = Page(driver, served.url, size)
        with hovering(folder):
            page.wait("document.querySelectorAll('#tracks tr').length == 1")
            page.wait("!byId('alarm_panel').hidden")
        cells = page.run(
            "return [...document.querySelectorAll('#tracks td')].map(c => c.innerText)"
        )
        assert cells[0].split() == ["7", "alarm"]
        assert cells[1:5] == ["12.0", "5.0", "\u22121.0", "13"]
        assert float(cells[5]) == pytest.approx(math.hypot(0.05, 0.07, 0.09), abs=0.005)
        health = page.text("#health")
        assert "avia\nsilent since" in health
        assert "north\nblinded since" in health
        assert "3 dropped" in health
        assert "Track 7 in apron since" in page.text("#alarms")
        colours = page.picture().reshape(-1, 3)
        blue = [0x37, 0x47, 0x4F]  # of number 7
        assert (np.abs(colours - blue).max(axis=1) < 12).sum() > 30
        with (folder / "events.jsonl").open("a") as file:
            file.write(ended() + "\n")
        page.wait("document.querySelectorAll('#tracks tr').length == 0")
        page.wait("byId('alarm_panel').hidden")
        assert page.text("#nothing") == "Nothing flies."
        assert page.complaints() == []


def test_a_server_that_begins_anew_is_found_again_with_all_it_knew(driver, folder) -> None:
    one_drone(folder, inside=False)
    with watch(folder) as served:
        page = Page(driver, served.url, WIDE)
        page.wait("document.querySelectorAll('#tracks tr').length == 1")
        port = served.port
        assert served.end() == (0, "")
    page.wait("byId('link').textContent == 'no connection'")
    with (folder / "events.jsonl").open("a") as file:  # meanwhile
        file.write(track(8, 5.0) + "\n" + row(8, 5.0) + "\n")
    with watch(folder, port=port):
        page.wait("byId('link').textContent == 'connected'")
        page.wait("document.querySelectorAll('#tracks tr').length == 2")
        assert page.listed() == [7, 8]
        assert page.run("return [...live.tracks.values()].map(t => t.rows.length)") == [40, 1]


def test_the_past_is_shown_played_and_left_again(driver, folder, size) -> None:
    station_events.BEGIN_NS -= 600 * 10**9
    one_drone(folder, end(7, 16.0), state("running", 600.0))
    with watch(folder) as served:
        page = Page(driver, served.url, size)
        page.wait("line.spans.length == 1")
        assert page.listed() == []
        # The slider knows seconds back from now.
        back = (
            f"const b = byId('back'); b.value = {station_events.BEGIN_NS / 1e9} + {{}} - now();"
            "b.dispatchEvent(new Event('input'))"
        )
        page.run(back.format(2))
        page.wait("document.querySelectorAll('#tracks tr').length == 1")
        assert page.text("#mode") == "past"
        assert "UTC" in page.run("return byId('back').getAttribute('aria-valuetext')")
        at = page.run("return past.at")
        rows = page.run("return shown()[0].rows.map(r => r[0])")
        assert max(rows) <= at < max(rows) + 0.2
        page.click("#play")
        page.wait(f"past.at > {at} + 0.3")
        page.click("#play")
        page.run(back.format(300))
        page.wait("document.querySelectorAll('#tracks tr').length == 0")
        page.click("#live")
        page.wait("byId('mode').textContent == 'live'")
        assert page.complaints() == []


def test_it_is_used_by_keys_alone_and_read_aloud(driver, folder) -> None:
    with hovering(folder), watch(folder) as served:
        page = Page(driver, served.url, WIDE)
        page.wait("document.querySelectorAll('#tracks tr').length == 1")
        # Whatever can be pressed is reached by Tab, in the order of the page, and has a name.
        reached = []
        for _ in range(30):
            page.press("\ue004")
            reached.append(page.run("return document.activeElement.id || "
                                    "document.activeElement.dataset.hours || "
                                    "document.activeElement.tagName"))  # fmt: skip
        for name in (
            "sound",
            "hush",
            "top",
            "space",
            "fit",
            "view",
            "1",
            "6",
            "24",
            "live",
            "back",
        ):
            assert name in reached, name
        unnamed = page.run(
            "return [...document.querySelectorAll('button, input, canvas:not([aria-hidden]), "
            "section')].filter((e) => !(e.innerText || '').trim() && !e.getAttribute('aria-label')"
            " && !e.getAttribute('aria-labelledby')).map((e) => e.outerHTML.slice(0, 80))"
        )
        assert unnamed == []
        page.wait("byId('view').getAttribute('aria-label').includes('track 7 6 metres away')")
        assert page.run("return byId('alarms').getAttribute('role')") == "alert"
        page.run("byId('view').focus()")
        page.press("d")
        assert page.run("return view.flat") is False
        azimuth = page.run("return view.azimuth")
        page.press("\ue012")
        assert page.run("return view.azimuth") != azimuth
        page.press("+")
        assert page.run("return view.zoom") > 1
        page.press("f", "t")
        assert page.run("return [view.flat, view.zoom]") == [True, 1]
        page.run("byId('back').focus()")
        page.press("\ue012")
        page.wait("past.at !== null")
        page.press("l")
        page.wait("past.at === null")
        assert page.complaints() == []


CLOUD = np.concatenate([
    np.random.default_rng(1).uniform((-15, -15, 0), (15, 15, 0.1), (1500, 3)),
    np.random.default_rng(2).uniform((-3, 4, 42), (3, 10, 48), (500, 3)),
])  # fmt: skip


@contextlib.contextmanager
def seeing(folder: Path, names: tuple[str, ...], rate_hz: float) -> Iterator[None]:
    """These LiDARs tell of their returns, and of nothing else."""

    def lines(at: float) -> str:
        return "".join(returns(name, at, CLOUD) + "\n" for name in names)

    with telling(folder, 1 / rate_hz, lines):
        yield


def near_to(picture: np.ndarray, colour: tuple[int, int, int]) -> int:
    return int((np.abs(picture.reshape(-1, 3) - colour).max(axis=1) < 40).sum())


ORANGE, GREY = (242, 130, 60), (140, 148, 158)


def test_returns_are_seen_turned_and_fade(driver, folder, size) -> None:
    with watch(folder) as served:
        page = Page(driver, served.url, size)
        page.wait("byId('link').textContent == 'connected'")
        assert page.run("return byId('returns').hidden && byId('no_returns').hidden")
        assert near_to(page.picture(), ORANGE) == 0
        with seeing(folder, ("mid360", "avia", "north"), 10.0):
            page.wait("returns.clouds.length > 5")
            assert not page.run("return byId('returns').hidden")
            picture = page.picture()
            assert near_to(picture, ORANGE) > 100
            assert near_to(picture, GREY) > 300
            page.press("o")
            before = page.run("return [view.flat, view.azimuth]")
            page.wait(f"view.azimuth > {before[1]} + 3")
            assert before[0] is False
            page.press("t")
            assert page.run("return byId('turn').getAttribute('aria-pressed')") == "false"
            page.wait(f"frames > {page.run('return frames')} + 5")  # it goes on being drawn
            assert page.run("return returns.clouds.length") <= 40
            page.press("r")  # not wanted
            page.wait("byId('returns').getAttribute('aria-pressed') == 'false'")
            time.sleep(0.2)
            assert near_to(page.picture(), ORANGE) == 0
            page.press("r")
            time.sleep(0.2)
            assert near_to(page.picture(), ORANGE) > 100
        page.wait("returns.clouds.length == 0")
        time.sleep(0.2)
        assert near_to(page.picture(), ORANGE) == 0
        assert page.complaints() == []


def test_returns_stand_where_the_sky_would_draw_them(driver, folder) -> None:
    with watch(folder) as served:
        page = Page(driver, served.url, WIDE)
        apart = page.run(
            "const apart = [];"
            "for (const flat of [true, false]) for (const zoom of [0.5, 1, 7]) {"
            "  Object.assign(view, {flat, zoom, azimuth: 70, elevation: 40, centre: [1, 2, 3],"
            "    moved: [4, -5], reach: 70});"
            "  const project = projector(800, 500), m = projection(800, 500);"
            "  for (const p of [[1, 2, 3], [-10, 20, 5], [30, -12, 40], [0, 0, 0]]) {"
            "    const [x, y, w] = [0, 1, 3].map("
            "      (i) => m[i] * p[0] + m[4 + i] * p[1] + m[8 + i] * p[2] + m[12 + i]);"
            "    const at = project(...p);"
            "    if (!at) continue;"
            "    apart.push(at[0] - 400 * (1 + x / w), at[1] - 250 * (1 - y / w));"
            "  }"
            "}"
            "return apart"
        )
        assert len(apart) >= 40
        assert max(map(abs, apart)) < 1e-6


def test_without_webgl_the_sky_stays_and_it_is_said(driver, folder) -> None:
    with watch(folder) as served:
        page = Page(driver, served.url, WIDE)
        page.wait("byId('link').textContent == 'connected'")
        page.run(  # as where there never was any
            "byId('cloud').getContext('webgl').getExtension('WEBGL_lose_context').loseContext();"
        )
        page.wait("returns.gl === null")
        one_drone(folder)
        with seeing(folder, ("mid360",), 5.0):
            page.wait("document.querySelectorAll('#tracks tr').length == 1")
            page.wait("!byId('no_returns').hidden")
            assert page.run("return byId('returns').hidden")
            colours = page.picture().reshape(-1, 3)
            assert near_to(colours, ORANGE) == 0
            assert (np.abs(colours - [0x37, 0x47, 0x4F]).max(axis=1) < 12).sum() > 30
        assert page.complaints() == []


def test_an_alarm_is_heard_until_it_is_silenced(driver, folder) -> None:
    with hovering(folder), watch(folder) as served:
        page = Page(driver, served.url, WIDE)
        page.wait("!byId('alarm_panel').hidden")
        assert page.run("return tones") == 0  # nobody has asked for sound
        page.run("byId('sound').focus()")
        page.press(" ")
        assert page.text("#sound") == "Sound on"
        page.wait("tones >= 3")
        page.click("#hush")
        page.wait("byId('hush').hidden")
        time.sleep(0.5)
        told = page.run("return tones")
        time.sleep(2)
        assert page.run("return tones") == told
        assert not page.run("return byId('alarm_panel').hidden")  # it is still said


def silence(page: Page, seconds: float) -> None:
    """The page's own clock goes on by so much, while the server says nothing new."""
    page.run(
        f"const real = performance.now.bind(performance), more = {1000 * seconds};"
        "performance.now = () => real() + more;"
        f"live.now += {seconds}; heard += more"
    )


def test_a_lidar_whose_clock_is_adrift_is_said(driver, folder, size) -> None:
    one_drone(folder, sensor("avia", "ok", 4.1, clock="lost"), sensor("roof", "ok", 4.1))
    with watch(folder) as served:
        page = Page(driver, served.url, size)
        page.wait("byId('troubles').innerText.includes('synchronisation')")
        assert "LiDAR avia has lost its time synchronisation, told" in page.text("#troubles")
        assert "ok, time not synchronised" in page.text("#health")
        assert "No LiDAR sees anything" not in page.text("#troubles")


def test_a_station_that_says_nothing_more_is_shown_as_that(driver, folder, size) -> None:
    lines = [sensor("avia", "silent", 4.2), sensor("north", "silent", 4.3)]
    one_drone(folder, sensor("mid360", "silent", 4.1), *lines)
    with watch(folder) as served:
        page = Page(driver, served.url, size)
        page.wait("document.querySelectorAll('#tracks tr').length == 1")
        silence(page, 240)
        page.wait("document.querySelectorAll('#tracks tr.unheard').length == 1")
        troubles = page.text("#troubles")
        assert "No LiDAR sees anything" in troubles
        assert "LiDAR mid360 silent since" in troubles
        assert "4 min ago" in troubles
        assert "Tracking unknown: nothing was heard of it for 4 min" in troubles
        # It is the first and the largest thing said; the alarm is no more one of now.
        sizes = page.run(
            "return ['troubles', 'alarms', 'health'].map((id) => "
            "parseFloat(getComputedStyle(byId(id)).fontSize))"
        )
        assert sizes[0] > max(sizes[1:])
        tops = page.run(
            "return ['trouble', 'alarm_panel', 'view'].map("
            "(id) => byId(id).getBoundingClientRect().top)"
        )
        assert tops == sorted(tops)
        assert "the track is no longer heard, last 4 min ago" in page.text("#alarms")
        assert page.run("return byId('alarm_panel').className") == "lost"
        background = page.run("return getComputedStyle(byId('alarm_panel')).backgroundColor")
        assert background != "rgb(179, 38, 30)"
        assert "Tracking\nunknown, was running\n4 min ago" in page.text("#health")
        assert "3 dropped\n4 min ago" in page.text("#health")
        assert page.text("#count") == "0, and 1 no longer heard"
        assert page.run("return document.title").startswith("Trouble")
        assert page.run("return document.documentElement.scrollWidth <= innerWidth")
        with (folder / "events.jsonl").open("a") as file:
            file.write(ended() + "\n")
        page.wait("document.querySelectorAll('#tracks tr').length == 0")
        assert page.text("#nothing") == "No track, and nothing can be seen."
        assert page.complaints() == []


def test_a_time_of_another_day_has_its_date(driver, folder) -> None:
    station_events.BEGIN_NS -= 3 * 86_400 * 10**9
    one_drone(folder)
    with watch(folder) as served:
        page = Page(driver, served.url, WIDE)
        page.wait("byId('health').innerText.includes('silent since')")
        day = time.strftime("%Y-%m-%d", time.gmtime(station_events.BEGIN_NS / 1e9))
        assert f"silent since {day} " in page.text("#health")
        assert "3 days ago" in page.text("#health")


def test_a_probability_is_named(driver, folder) -> None:
    with watch(folder) as served:
        page = Page(driver, served.url, WIDE)
        with hovering(folder), (folder / "events.jsonl").open("a") as file:
            page.wait("document.querySelectorAll('#tracks tr').length == 1")
            file.write(row(8, 4.0, drone=0.87) + "\n")
            file.flush()
            page.wait("document.querySelectorAll('#tracks tr').length == 2")
        column = page.run(
            "return [...document.querySelectorAll('th')].findIndex("
            "(th) => th.getAttribute('aria-label') == 'Probability that it is a drone')"
        )
        cells = f"return [...document.querySelectorAll('#tracks tr')].map(r => r.cells[{column}]"
        assert page.run(cells + ".innerText)") == ["", "87 %"]


def test_a_track_is_shown_where_it_is_now(driver, folder) -> None:
    height = "document.querySelector('#tracks tr')?.cells[1].innerText"
    with watch(folder) as served, (folder / "events.jsonl").open("a") as file:
        page = Page(driver, served.url, WIDE)
        for line, shown in (
            (row(8, 4.0, (9.0, 0.0, 20.0)), "20.0"),
            (station_events.now(8, 5.0, (9.0, 0.0, 31.0)), "31.0"),
            (row(8, 4.1, (9.0, 0.0, 21.0)), "31.0"),
            (station_events.now(8, 5.1, (9.0, 0.0, 32.0)), "32.0"),
            (row(8, 5.2, (9.0, 0.0, 33.0)), "33.0"),
        ):
            file.write(line + "\n")
            file.flush()
            page.wait(f"{height} == '{shown}'")
        assert page.complaints() == []


def test_no_name_runs_a_script_or_puts_an_element_in(driver, tmp_path) -> None:
    names = [name for name in HOSTILE if name.isprintable()]  # others are refused at the door
    zones = [square(18 + i, name) for i, name in enumerate(names)]
    write_site(tmp_path, zones, station="__proto__")
    lines = []
    for i, name in enumerate(names):
        extra = json.dumps({name: name, "load": name, "kind": name, "station": name, "zone": name})
        told = track(i), row(i, 0.0, INSIDE), row(i, 4.0, INSIDE), state(name[:40])
        lines += [f"{line[:-1]},{extra[1:]}" for line in (*told, sensor(name[:110], name[:40]))]
    with (tmp_path / "events.jsonl").open("a") as file:
        file.write("".join(line + "\n" for line in lines))
    with watch(tmp_path) as served:
        page = Page(driver, served.url, WIDE)
        count = len(names)
        page.wait(f"document.querySelectorAll('#tracks tr').length == {count}")
        page.wait("line.alarms.length > 0")
        page.wait("!byId('alarm_panel').hidden && !byId('trouble').hidden")
        for key in ("d", "t"):
            page.press(key)
        page.run("const b = byId('back'); b.value = -2; b.dispatchEvent(new Event('input'))")
        page.wait("past.tracks.length > 0")
        time.sleep(0.5)  # all is drawn again
        assert "img src=x" in page.text("#alarms")  # as text
        assert broken_out(page) == []
