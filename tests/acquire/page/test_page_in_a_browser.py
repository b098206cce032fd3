"""The page as a person has it: a real browser, the simulated bench at its real pace."""

from __future__ import annotations

import os
import signal
import socket
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import numpy as np
import pytest
from numpy.typing import NDArray

from acquire.page.chart import focus_chart
from acquire.session import Session
from acquire.session.verification import problems
from drivers.protocols import CameraSettings
from drivers.raster import raster_digest
from drivers.raw import decode_raw
from drivers.sim.devices import SimulationConfig, build
from processing.patterns import Pattern
from tests.acquire.page.programs import Program, children, descendants, needs_proc
from tests.acquire.page.test_darkroom import srgb

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page, Playwright

pytestmark = pytest.mark.browser
PATIENCE_S = 90.0
CAMERA_PX, PROJECTOR_PX = (24, 32), (72, 96)
PLAN = """[pattern]
pitch_px = [8, 12, 16]
shifts = [4, 2]
[camera]
exposure_s = 0.1
[projector]
settle_s = 0.1
"""
BENCH = f"""kind = "sim"
[sim]
camera_px = {list(CAMERA_PX)}
projector_px = {list(PROJECTOR_PX)}
real_time = true
"""
COMMANDS = "document.getElementById('standing').textContent.startsWith('you command')"
NOTHING_TO_PRESS = """[...document.querySelectorAll("aside button, aside select")]
  .every(control => control.disabled || control.offsetParent === null)"""
WATCH = """() => {
  window.hasLost = false;
  new MutationObserver(() => { window.hasLost ||= document.body.classList.contains("stale"); })
    .observe(document.body, { attributes: true, attributeFilter: ["class"] });
}"""
ANSWER_S = 5.0
ARGUMENTS = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking"]


def shown(what: str) -> str:
    """The condition that the page says so of the projector."""
    return f"document.getElementById('shown').textContent === '{what}'"


@dataclass
class Operator:
    """A person at a browser, and what the browser complained of."""

    playwright: Playwright
    chromium: str
    address: str
    complaints: list[str] = field(default_factory=list)
    requested: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        before = descendants(os.getpid())
        self.browser: Browser = self.playwright.chromium.launch(
            executable_path=self.chromium, args=ARGUMENTS
        )
        self.processes = descendants(os.getpid()) - before
        self.page: Page = self.open()

    def aims(self) -> None:
        """Wait for pictures while aiming, and light the scene."""
        self.activity("aiming")
        self.next_pictures()
        self.orders("w", "white")

    def die(self) -> None:
        """What a crash of the graphics or a lack of memory does to a browser."""
        for process in self.processes:
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)

    def open(self) -> Page:
        page = self.browser.new_page(viewport={"width": 1280, "height": 800})
        page.on("console", lambda message: self.complaints.append(message.text))
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("request", lambda request: self.requested.add(urlsplit(request.url).netloc))
        page.goto(self.address)
        return page

    @property
    def troubles(self) -> list[str]:
        """All complaints but the one about this test's own reading of the canvas."""
        return [text for text in self.complaints if "willReadFrequently" not in text]

    def holds(self, condition: str, page: Page | None = None, patience_s: float = 0.0) -> bool:
        """Whether a JavaScript condition becomes true in time.

        The page's policy forbids Playwright's own way of waiting.
        """
        deadline_s = time.monotonic() + patience_s
        while not (page or self.page).evaluate(condition):
            if time.monotonic() > deadline_s:
                return False
            time.sleep(0.02)
        return True

    def until(self, condition: str, page: Page | None = None) -> None:
        """Wait for it."""
        if not self.holds(condition, page, PATIENCE_S):
            raise AssertionError((condition, (page or self.page).inner_text("body")))

    def activity(self, wanted: str, page: Page | None = None) -> None:
        self.until(f"document.getElementById('activity').dataset.activity === '{wanted}'", page)

    @property
    def raster(self) -> str:
        """Digest of what the page says that the projector shows."""
        return str(self.page.evaluate("document.getElementById('shown').dataset.sha256"))

    def shows(self, what: str) -> None:
        self.until(shown(what))

    def orders(self, key: str, what: str) -> None:
        """Press a key until the projector shows what it stands for, as a person would.

        Where the computer is so busy that the page has lost its connection, a key does nothing.
        """
        deadline_s = time.monotonic() + PATIENCE_S
        self.page.keyboard.press(key)
        while not self.holds(shown(what), patience_s=ANSWER_S):
            assert time.monotonic() < deadline_s, self.page.inner_text("body")
            self.page.keyboard.press(key)

    def foresees_loss(self) -> None:
        """Have the page remember whether it loses its connection from now on, however briefly."""
        self.page.evaluate(WATCH)

    def has_lost(self) -> None:
        """Wait until it has."""
        self.until("window.hasLost")

    def next_pictures(self, count: int = 3) -> None:
        """Wait for pictures that were taken after now."""
        number = "Number(document.getElementById('camera').dataset.number || 0)"
        now = self.page.evaluate(number)
        self.until(f"{number} >= {now + count}")


@pytest.fixture
def lab(tmp_path: Path) -> Iterator[Program]:
    lab = Program(tmp_path, PLAN, BENCH, "bench")
    yield lab
    lab.kill()


@pytest.fixture
def operator(lab: Program, playwright: Playwright, chromium: str) -> Iterator[Operator]:
    operator = Operator(playwright, chromium, lab.address)
    yield operator
    operator.browser.close()


PIXELS = """() => {
  const canvas = document.getElementById("CANVAS");
  const {left, top, scale} = canvas.dataset;
  const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  const pixels = [];
  for (let y = 0; y < HEIGHT; y++) for (let x = 0; x < WIDTH; x++) {
    const column = Math.floor(Number(left) + (x + 0.5) * scale);
    const row = Math.floor(Number(top) + (y + 0.5) * scale);
    const at = 4 * (row * canvas.width + column);
    pixels.push(...data.data.slice(at, at + 3));
  }
  return pixels;
}"""


def on_screen(page: Page, canvas: str = "camera") -> NDArray[np.int64]:
    """The middle of every camera pixel as the canvas has it."""
    height, width = CAMERA_PX
    script = PIXELS.replace("HEIGHT", str(height)).replace("WIDTH", str(width))
    script = script.replace("CANVAS", canvas)
    return np.array(page.evaluate(script)).reshape(height, width, 3)


def simulated(
    what: str, settings: CameraSettings
) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """What the page should show: the bench has no noise, so every frame is the same."""
    bench = build(SimulationConfig("corner", 0, CAMERA_PX, PROJECTOR_PX))
    bench.projector.show(Pattern.parse(what).raster(PROJECTOR_PX))
    return srgb(decode_raw(bench.camera.capture(settings).data).values)


def test_aiming_capturing_and_a_browser_that_dies(lab: Program, operator: Operator) -> None:
    look_and_aim(operator)
    second_viewer_only_watches(operator)
    start_rest_and_go_on(operator, lab)
    # A browser may lament its own death.
    assert operator.troubles == []
    assert operator.requested == {urlsplit(lab.address).netloc}
    operator.die()
    come_back(lab, operator)
    session = Session.open(lab.session)
    assert session.complete
    assert [run.outcome for run in session.record.runs] == ["stopped", "complete"]
    assert [problem for problem in problems(session) if problem] == []
    lab.end(signal.SIGINT)
    assert lab.process.returncode == 0
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.1", int(urlsplit(lab.address).port or 0)), 5)


def look_and_aim(operator: Operator) -> None:
    page = operator.page
    operator.aims()
    for key, what in (("w", "white"), ("b", "black")):
        operator.orders(key, what)
        assert operator.raster == raster_digest(Pattern.parse(what).raster(PROJECTOR_PX))
    operator.next_pictures()
    assert on_screen(page).max() <= 1
    operator.orders("w", "white")
    operator.next_pictures()
    as_planned = CameraSettings(0.1, 8.0, 200)
    # One code for rounding in the page's table and in the browser.
    assert np.abs(on_screen(page) - simulated("white", as_planned)).max() <= 1
    operator.orders("f", "chart")
    assert operator.raster == raster_digest(focus_chart(PROJECTOR_PX))
    page.select_option("#pattern", "checker:8:4,0")
    operator.shows("checker:8:4,0")
    assert operator.raster == raster_digest(Pattern.parse("checker:8:4,0").raster(PROJECTOR_PX))
    page.fill("#exposure", "1/20")
    page.press("#exposure", "Enter")
    operator.until("document.getElementById('read-back').textContent.startsWith('1/20 s')")
    operator.next_pictures()
    expected = simulated("checker:8:4,0", CameraSettings(0.05, 8.0, 200))
    assert np.abs(on_screen(page) - expected).max() <= 1
    page.click("#exposures")
    operator.until("document.getElementById('exposures').ariaPressed === 'true'")
    operator.next_pictures()
    assert np.abs(on_screen(page) - expected).max() <= 1


def second_viewer_only_watches(operator: Operator) -> None:
    watcher = operator.open()
    operator.activity("aiming", watcher)
    operator.until(NOTHING_TO_PRESS, watcher)
    before = operator.raster
    watcher.keyboard.press("w")
    operator.until("document.getElementById('standing').textContent.includes('watch')", watcher)
    operator.next_pictures()
    assert operator.raster == before
    watcher.click("#ask")
    operator.until("!document.getElementById('hand-over').hidden")
    operator.page.click("#hand-over")
    operator.until(
        "document.getElementById('standing').textContent.startsWith('you command')", watcher
    )
    watcher.keyboard.press("w")
    operator.shows("white")
    watcher.close()
    operator.until("!document.getElementById('take').hidden")
    operator.page.click("#take")
    operator.until(COMMANDS)


def start_rest_and_go_on(operator: Operator, lab: Program) -> None:
    page = operator.page
    page.click("#start")
    operator.activity("capturing")
    lab.until_frames(3)
    page.click("#pause")
    operator.activity("paused")
    at_rest = lab.frames
    page.keyboard.press("Space")
    assert page.is_visible("#darkness")
    page.keyboard.press("Space")
    assert not page.is_visible("#darkness")
    time.sleep(0.5)
    assert lab.frames == at_rest
    page.click("#go-on")
    lab.until_frames(at_rest + 2)
    operator.until("document.getElementById('camera').dataset.step !== ''")
    compare_with_prediction(operator)
    page.click("#stop")
    operator.activity("aiming")
    operator.shows("black")
    assert page.get_attribute("#live", "aria-pressed") == "false"
    assert page.get_attribute("#exposures", "aria-pressed") == "false"
    assert page.inner_text("#start") == f"go on from frame {lab.frames}"
    assert lab.frames < 26
    page.click("#start")
    operator.activity("capturing")


def compare_with_prediction(operator: Operator) -> None:
    """At rest after a frame whose complement is there, the page shows it as it must be."""
    page = operator.page
    exact = "document.getElementById('how').textContent.includes('complement')"
    together = """document.getElementById('camera').dataset.number
      === document.getElementById('prediction').dataset.number"""
    for _ in range(5):
        operator.until(exact)
        page.click("#pause")
        operator.activity("paused")
        last = page.evaluate("document.getElementById('done').value") - 1
        operator.until(f"document.getElementById('camera').dataset.step === '{last}'")
        operator.until(together)
        if page.evaluate(exact):
            break
        page.click("#go-on")
        operator.activity("capturing")
    assert page.evaluate(exact)
    # The bench has no noise: two roundings to codes of the screen and three of the camera's.
    assert np.abs(on_screen(page) - on_screen(page, "prediction")).max() <= 2
    assert on_screen(page, "difference").max() < 40
    page.click("#go-on")
    operator.activity("capturing")


def come_back(lab: Program, dead: Operator) -> None:
    """The browser was killed in mid-capture; a new one sees what is true, and commands."""
    before = lab.frames
    lab.until_frames(before + 2)
    operator = Operator(dead.playwright, dead.chromium, lab.address)
    operator.until(COMMANDS)
    operator.until("document.getElementById('done').value > 0")
    done = operator.page.evaluate("document.getElementById('done').value")
    assert before + 2 <= done <= lab.frames
    lab.until_frames(26)
    operator.activity("aiming")
    assert operator.page.inner_text("#count") == "26 of 26"
    assert operator.page.is_visible("#start-new")
    assert not operator.page.is_visible("#start")
    operator.browser.close()


@needs_proc
def test_a_page_that_hears_nothing_says_so_and_takes_no_orders(
    lab: Program, operator: Operator
) -> None:
    page = operator.page
    operator.aims()
    page.click("#pixels")
    operator.until("document.getElementById('camera').dataset.scale === '1'")
    (process,) = children(lab.process.pid)
    os.kill(process, signal.SIGSTOP)
    operator.until("document.body.classList.contains('stale')")
    assert "no connection since" in page.inner_text("#stale")
    assert page.evaluate("document.querySelector('main').inert")
    page.keyboard.press("b")
    os.kill(process, signal.SIGCONT)
    operator.until("!document.body.classList.contains('stale')")
    operator.next_pictures()
    assert page.inner_text("#shown") == "white"
    operator.foresees_loss()
    os.kill(process, signal.SIGKILL)
    operator.has_lost()
    operator.until("!document.body.classList.contains('stale')")
    operator.activity("aiming")
    operator.until(COMMANDS)
    operator.next_pictures()
    operator.orders("b", "black")
    assert not any("Uncaught" in text for text in operator.complaints)
    lab.end(signal.SIGTERM)
    assert lab.process.returncode == 0


def test_a_picture_is_seen_pixel_for_pixel(lab: Program, operator: Operator) -> None:
    page = operator.page
    operator.aims()
    page.fill("#exposure", "1/2")
    page.press("#exposure", "Enter")
    operator.until("document.getElementById('read-back').textContent.startsWith('0.5 s')")
    operator.next_pictures()
    share = page.inner_text("#clipped-share")
    assert float(share.split()[0]) > 10
    clipped = (on_screen(page) == (213, 94, 0)).all(axis=2)
    settings = CameraSettings(0.5, 8.0, 200)
    bench = build(SimulationConfig("corner", 0, CAMERA_PX, PROJECTOR_PX))
    bench.projector.show(Pattern.parse("white").raster(PROJECTOR_PX))
    saturated = decode_raw(bench.camera.capture(settings).data).saturated
    np.testing.assert_array_equal(clipped, saturated)
    page.keyboard.press("c")
    assert np.abs(on_screen(page) - simulated("white", settings)).max() <= 1
    page.keyboard.press("z")
    operator.until("document.getElementById('camera').dataset.scale === '1'")
    page.keyboard.press("z")
    page.keyboard.press("r")
    assert page.evaluate("document.documentElement.classList.contains('red')")
    operator.next_pictures()
    assert operator.troubles == []
    lab.end(signal.SIGTERM)
    assert lab.process.returncode == 0
    operator.activity("ended")
