"""The report page in a real browser: what a reader sees and can do."""

import base64
import io
import json
import time
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from browser import NARROW, WAIT_S, WIDE, chromium
from hostile import ALL, HOSTILE, broken_out
from report_run import make_run
from unlidar.cli import main
from unlidar.report import sample

LONG_FRAMES, LONG_STEP = 300, 5  # half a second apart: 150 s
# A marker is some thirty corners, and the processor draws them. The page of hostile names has all
# of its 30,000 returns.
MOST_OVERALL = 4_000


def is_coloured(image: np.ndarray, colour: str) -> bool:
    """True if enough pixels have about the hue: markers are shaded at their edges."""
    red, green, blue = (image[..., i].astype(int) for i in range(3))
    found = {
        "red": (red > green + 90) & (red > blue + 90),
        "green": (green > red + 50) & (green > blue + 50),
        "blue": (blue > red + 90) & (blue > green + 60),
        "grey": (abs(red - green) < 8) & (abs(green - blue) < 8) & (red > 60) & (red < 190),
    }[colour]
    return int(found.sum()) > 30


class Page:
    """A report that is open in a browser."""

    def __init__(self, driver, path: Path, size: tuple[int, int]):
        self.driver = driver
        width, height = size
        driver.get("about:blank")
        self.log("browser"), self.log("performance")  # of the page before
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 800}
        driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        driver.get(path.as_uri())
        self.wait("document.querySelector('#scene canvas') && document.readyState == 'complete'")

    def log(self, name: str) -> list[dict]:
        return self.driver.get_log(name)

    def run(self, script: str) -> object:
        return self.driver.execute_script(script)

    def wait(self, condition: str) -> None:
        end = time.monotonic() + WAIT_S
        while not self.run(f"return Boolean({condition})"):
            assert time.monotonic() < end, f"never came: {condition}"
            time.sleep(0.1)

    def picture(self, selector: str) -> np.ndarray:
        """(H, W, 3) bytes of an element, as drawn after the next two frames."""
        self.driver.execute_async_script(
            "const done = arguments[0]; requestAnimationFrame(() => requestAnimationFrame(done))"
        )
        x, y, width, height = self.run(
            f"const b = document.querySelector('{selector}').getBoundingClientRect();"
            "return [b.x + scrollX, b.y + scrollY, b.width, b.height]"
        )
        clip = {"x": x, "y": y, "width": width, "height": height, "scale": 1}
        taken = self.driver.execute_cdp_cmd(
            "Page.captureScreenshot", {"clip": clip, "captureBeyondViewport": True}
        )
        png = io.BytesIO(base64.b64decode(taken["data"]))
        image = matplotlib.image.imread(png, format="png")
        return np.round(image[..., :3] * 255).astype(np.uint8)

    def moment(self) -> list[list[list[float]]]:
        """x, y and z of the four traces that follow the slider."""
        return self.run(
            "return page.traces.moment.map((i) => ['x', 'y', 'z'].map("
            "(a) => Array.from(byId('scene').data[i][a])))"
        )

    def slide_to(self, step: int) -> None:
        self.run(f"const s = byId('time'); s.value = {step}; s.dispatchEvent(new Event('input'))")
        self.wait(f"byId('now').textContent == page.moments.time[{step}].toFixed(2) + ' s'")


@pytest.fixture(scope="module")
def driver():
    with chromium() as browser:
        yield browser


@pytest.fixture(scope="module")
def reports(tmp_path_factory) -> dict[str, Path]:
    """The pages of a run with a drone, of one with neither drone nor truth, and of a long one."""
    root = tmp_path_factory.mktemp("browser")
    runs = {
        "flight": make_run(root / "flight"),
        "nothing": make_run(root / "nothing", tracked=False, truth=False),
        "long": make_run(root / "long", LONG_FRAMES, stretch=LONG_STEP, track_ids=(2, 5)),
    }
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sample, "MOST_OVERALL", MOST_OVERALL)
        assert [main(["report", str(run)]) for run in runs.values()] == [0, 0, 0]
    return {name: run / "report.html" for name, run in runs.items()}


@pytest.fixture(scope="module", params=[WIDE, NARROW], ids=["1400px", "390px"])
def page(request, driver, reports) -> Page:
    """The report of a flight, at two widths."""
    return Page(driver, reports["flight"], request.param)


def complaints(page: Page) -> list[str]:
    return [entry["message"] for entry in page.log("browser") if entry["level"] == "SEVERE"]


def test_it_loads_without_an_error_and_asks_no_other_machine(page):
    assert complaints(page) == []
    events = [json.loads(entry["message"])["message"] for entry in page.log("performance")]
    asked = [e["params"]["request"]["url"] for e in events if e["method"].endswith("BeSent")]
    assert any(url.startswith("file:") for url in asked)
    assert all(url.startswith(("file:", "data:", "blob:", "about:")) for url in asked), asked


def test_nothing_is_wider_than_the_window(page):
    inner, whole = page.run("return [innerWidth, document.documentElement.scrollWidth]")
    assert whole <= inner
    # Nor is anything cut off at the right, but what scrolls by itself.
    cut = page.run(
        "return [...document.querySelectorAll('body *')].filter((e) => !e.closest('.scroll, svg')"
        " && e.getBoundingClientRect().right > innerWidth + 1).map((e) => e.outerHTML.slice(0, 80))"
    )
    assert cut == []


def test_the_space_shows_returns_targets_truth_and_estimate(page):
    image = page.picture("#scene canvas")
    for colour in ("grey", "green", "red", "blue"):
        assert is_coloured(image, colour), colour


def test_the_slider_moves_the_points_and_the_time_lines(page):
    truth = page.run("return page.moments.truth")
    estimate = page.run("return page.moments.estimate")
    seen, pictures = [], []
    for step in (3, 20):
        page.slide_to(step)
        returns, targets, true_at, found_at = page.moment()
        assert np.allclose(np.transpose(true_at), truth[step], atol=1e-3)
        assert np.allclose(np.transpose(found_at), estimate[step], atol=1e-3)
        # The target's returns of this moment lie about where it is.
        assert np.linalg.norm(np.mean(targets, axis=1) - truth[step][0]) < 0.3
        lines = page.run("return byId('over_time').layout.shapes.map((s) => s.x0)")
        assert lines == [page.run(f"return page.moments.time[{step}]")]
        seen.append(returns)
        pictures.append(page.picture("#scene canvas").astype(int))
    assert len(seen[0][0]) > 500
    assert seen[0] != seen[1]
    changed = np.abs(pictures[0] - pictures[1]).max(axis=2) > 40
    assert changed.sum() > 200


def test_playing_goes_through_the_time_steps_and_pauses(page):
    page.slide_to(5)
    page.run("byId('play').click()")
    page.wait("Number(byId('time').value) >= 8")
    page.run("byId('play').click()")
    stopped = page.run("return byId('time').value")
    time.sleep(0.5)
    assert page.run("return byId('time').value") == stopped
    assert page.run("return byId('play').textContent") == "Play"


def test_the_view_can_be_widened_and_brought_back(page):
    spans = []
    for button in ("wide", "near"):
        page.run(f"byId('{button}').click()")
        page.wait(
            "JSON.stringify(byId('scene').layout.scene.xaxis.range) == JSON.stringify("
            f"[page.boxes.{button}.low[0], page.boxes.{button}.high[0]])"
        )
        low, high = page.run("return byId('scene').layout.scene.xaxis.range")
        spans.append(high - low)
    assert spans[0] > spans[1]


def test_every_plot_is_drawn_in_its_place(page):
    for plot in ("over_time", "error_over_time", "error_histogram"):
        assert page.run(f"return byId('{plot}').querySelectorAll('.trace, .bars').length") > 0
        width, inner = page.run(f"return [byId('{plot}').clientWidth, innerWidth]")
        assert width > 0.25 * inner


def test_clusters_are_sorted_by_a_click_and_what_is_no_number_stays_last(page):
    page.run("document.querySelector('#cluster_rows').closest('details').open = true")
    cells = (
        "return [...document.querySelectorAll('#cluster_rows tr')].map((r) => "
        "r.cells[{}].textContent)"
    )
    heads = page.run(
        "return [...document.querySelectorAll('th[data-column]')].map((h) => h.innerText)"
    )
    column = next(i for i, head in enumerate(heads) if "von Neumann" in head)
    assert page.run(cells.format(0)) == [str(rank) for rank in range(1, 26)]
    every = sorted(rank * 7 % 40 / 10 for rank in range(1, 41) if rank != 2)
    for expected in (every, every[::-1]):
        page.run(f"document.querySelectorAll('th[data-column]')[{column}].click()")
        assert [float(v) for v in page.run(cells.format(column))] == expected[:25]
    page.run("document.querySelectorAll('th[data-column]')[0].click()")
    assert page.run(cells.format(0))[:2] == ["1", "2"]


@pytest.fixture(scope="module", params=[WIDE, NARROW], ids=["1400px", "390px"])
def long_page(request, driver, reports) -> Page:
    """The report of two and a half minutes with two tracks."""
    return Page(driver, reports["long"], request.param)


def shown(page: Page) -> tuple[float, float]:
    return tuple(page.run("return [shown.begin, shown.end]"))


def drawn_times(page: Page) -> dict[str, tuple[float, float]]:
    """First and last second of what is drawn of each line in space, by where its points lie."""
    found = {}
    lines = page.run(
        "return lines.map((line) => [line.name, Array.from(line.time), Array.from(line.points),"
        "['x', 'y', 'z'].map((a) => Array.from(byId('scene').data[line.trace][a]))])"
    )
    for name, times, points, columns in lines:
        drawn = {tuple(np.round(p, 4)) for p in zip(*columns, strict=True) if None not in p}
        points = np.round(np.reshape(np.array(points, dtype=float), (-1, 3)), 4)
        own = [t for t, p in zip(times, points, strict=True) if tuple(p) in drawn]
        if own:
            found[name] = (min(own), max(own))
    return found


def test_a_long_recording_is_first_shown_for_a_minute(long_page):
    assert complaints(long_page) == []
    begin, end = shown(long_page)
    assert end - begin == pytest.approx(60)
    now = long_page.run("return moments.time[Number(byId('time').value)]")
    assert begin <= now <= end
    assert "of 149.5 s" in long_page.run("return byId('span').textContent")


def test_the_window_is_what_space_and_curves_show(long_page):
    for window in ((20.0, 50.0), (60.0, 100.0)):
        long_page.run(f"showWindow({window[0]}, {window[1]})")
        for name, (begin, end) in drawn_times(long_page).items():
            own = {"truth": (0, 149.5), "track 2": (0, 74.5), "track 5": (75, 149.5)}[name]
            expected = max(window[0], own[0]), min(window[1], own[1])
            assert (begin, end) == pytest.approx(expected, abs=0.51), name
        for plot in ("over_time", "error_over_time"):
            axis = long_page.run(f"return byId('{plot}').layout.xaxis.range")
            assert axis == pytest.approx(window)
        ends = long_page.run("return [Number(byId('from').value), Number(byId('to').value)]")
        assert ends == pytest.approx(window, abs=0.1)
    # The heights are those of the curves in the window, not of all.
    low, high = long_page.run("return byId('over_time').layout.yaxis.range")
    xs = long_page.run(
        "return lines.filter((l) => l.name == 'truth').flatMap((l) => Array.from(l.time)"
        ".flatMap((t, i) => isShown(t) ? [l.points[3 * i]] : []))"
    )
    assert low < min(xs) < max(xs) < high
    assert high - low < 1.5 * (max(xs) - min(xs)) + 2


def test_the_window_moves_with_strip_handles_moment_buttons_and_zoom(long_page):
    page = long_page
    page.run("document.querySelector('[data-window=all]').click()")
    assert shown(page) == pytest.approx((0, 149.5))
    assert set(drawn_times(page)) == {"truth", "track 2", "track 5"}
    page.run("const f = byId('from'); f.value = 30; f.dispatchEvent(new Event('input'))")
    page.wait("shown.begin == 30")
    page.run("const t = byId('to'); t.value = 50; t.dispatchEvent(new Event('input'))")
    page.wait("shown.end == 50")
    # The moment takes the window along.
    last = page.run("return moments.time.length - 1")
    page.slide_to(last)
    begin, end = shown(page)
    assert (begin, end) == pytest.approx((129.5, 149.5), abs=0.5)
    # Pressed elsewhere, the strip brings the window there.
    page.run(
        "const s = byId('strip'), b = s.getBoundingClientRect();"
        "s.setPointerCapture = () => {};"
        "const at = (x, type) => s.dispatchEvent(new PointerEvent(type, "
        "{clientX: b.left + x * b.width, clientY: b.top + 3, pointerId: 1}));"
        "at(0.5, 'pointerdown'); at(0.6, 'pointermove'); at(0.6, 'pointerup')"
    )
    page.wait("Math.abs((shown.begin + shown.end) / 2 - 0.6 * page.duration) < 1")
    assert np.diff(shown(page)) == pytest.approx(20, abs=0.5)
    page.run("document.querySelector('[data-window=\"10\"]').click()")
    assert np.diff(shown(page)) == pytest.approx(10)
    page.run("Plotly.relayout('over_time', {'xaxis.range[0]': 5, 'xaxis.range[1]': 9})")
    page.wait("shown.begin == 5 && shown.end == 9")
    page.run("Plotly.relayout('over_time', {'xaxis.autorange': true})")
    page.wait("shown.begin == 0 && shown.end == page.duration")
    assert complaints(page) == []


def test_tracks_have_their_colours_in_space_curves_strip_and_table(long_page):
    page = long_page
    page.run("document.querySelector('[data-window=all]').click()")
    for name in ("track 2", "track 5"):
        line = page.run(f"return lines.find((l) => l.name == '{name}').colour")
        for plot in ("scene", "over_time"):
            drawn = page.run(
                f"return [...new Set(byId('{plot}').data.filter((t) => t.name == '{name}')"
                ".map((t) => t.line.color))]"
            )
            assert drawn == [line]
        bars = page.run(
            f"return [...document.querySelectorAll('#strip rect[fill=\"{line}\"] title')]"
            ".map((t) => t.textContent)"
        )
        assert len(bars) == 1
        assert bars[0].startswith(name)
        mark = page.run(
            "return [...new Set([...document.querySelectorAll('.mark')].filter((m) => "
            f"m.parentNode.textContent == '{name[-1]}').map((m) => m.style.background))]"
        )
        red, green, blue = (int(line[i : i + 2], 16) for i in (1, 3, 5))
        assert mark == [f"rgb({red}, {green}, {blue})"]
    inner, whole = page.run("return [innerWidth, document.documentElement.scrollWidth]")
    assert whole <= inner


def test_no_button_sends_the_recording_anywhere(page):
    titles = page.run(
        "return [...document.querySelectorAll('.modebar-btn')].map((b) => b.dataset.title || '')"
    )
    assert any("png" in title.lower() for title in titles)
    assert not any(word in t.lower() for t in titles for word in ("cloud", "link", "share", "edit"))


@pytest.mark.parametrize("size", [WIDE, NARROW], ids=["1400px", "390px"])
def test_a_run_without_a_drone_and_without_truth_is_shown_too(driver, reports, size):
    page = Page(driver, reports["nothing"], size)
    assert complaints(page) == []
    assert "No drone was found" in page.run("return document.body.innerText")
    assert is_coloured(page.picture("#scene canvas"), "grey")
    page.slide_to(20)
    assert page.moment()[2:] == [[[], [], []]] * 2
    inner, whole = page.run("return [innerWidth, document.documentElement.scrollWidth]")
    assert whole <= inner


def poisoned(value: object) -> object:
    """Every text of a summary with names that would run a script, as keys and as values."""
    if isinstance(value, dict):
        return {key: poisoned(v) for key, v in value.items()} | {ALL: ALL, HOSTILE[0]: [ALL]}
    return value


def test_no_name_of_a_run_runs_a_script_or_puts_an_element_in(driver, tmp_path):
    folder = HOSTILE[0].replace("/", "")
    run = make_run(tmp_path / folder, title=ALL, track_ids=(2, 5))
    (run / "frames" / "mid360").rename(run / "frames" / folder)
    record = json.loads((run / "run.json").read_text())
    record |= {
        "frames": {ALL: f"frames/{folder}"},
        "options": ["--set", ALL],
        "preset": ALL,
        "notes": list(HOSTILE),
        "messages": list(HOSTILE),
    }
    (run / "run.json").write_text(json.dumps(record))
    summary = json.loads((run / "summary.json").read_text())
    summary["version"] = ALL
    summary["inputs"] = [dict(each, name=ALL, directory=ALL) for each in summary["inputs"]]
    summary["config"] = poisoned(summary["config"])
    summary["config"]["sensors"] = {ALL: summary["config"]["sensors"].get("mid360", {})}
    summary["counts"][ALL] = 3
    summary["times_s"][ALL] = 0.5
    (run / "summary.json").write_text(json.dumps(summary))
    clusters = (run / "clusters.csv").read_text().splitlines()
    clusters[0] += ",<img src=x onerror=pwned=1 evil>"
    clusters[1:] = [f"{line},</script><script>pwned=1</script>" for line in clusters[1:]]
    (run / "clusters.csv").write_text("\n".join(clusters) + "\n")
    assert main(["report", str(run)]) == 0
    page = Page(driver, run / "report.html", WIDE)
    for details in ("true", "false", "true"):
        page.run(f"document.querySelectorAll('details').forEach((d) => d.open = {details})")
    page.run("document.querySelectorAll('th[data-column]').forEach((th) => th.click())")
    page.slide_to(5)
    assert "img src=x" in page.run("return document.body.innerText")  # as text
    assert broken_out(page) == []
