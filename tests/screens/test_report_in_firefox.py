"""The report in the other browser: with software OpenGL on an X server, and without any."""

from __future__ import annotations

import base64
import io
import json
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from acquire.result import Result
from acquire.tone import Tone
from tests.acquire.firefox import FirefoxPage, opened, without_display
from tests.acquire.live_results import SHAPE, Picture, expected, live_result
from tests.screens.desk import Desk

pytestmark = pytest.mark.browser

# The page draws in the next frame; a frame's own callbacks run in the order they were asked for.
SHOWN = """new Promise((done) => {
  const wanted = %s;
  const set = (selector, value) => {
    const control = document.querySelector(selector);
    control.value = value;
    control.dispatchEvent(new Event(control.tagName === "SELECT" ? "change" : "input"));
  };
  wanted.gains.forEach((gain, k) => set(`[data-gain="${k}"]`, gain));
  set("#exposure", wanted.stops);
  set("#tone", wanted.tone);
  requestAnimationFrame(() => done(document.querySelector("#live canvas").toDataURL()));
})"""


@pytest.fixture(scope="module")
def firefox() -> str:
    """The browser's executable, or skip; CI must have one."""
    for name in ("firefox-esr", "firefox"):
        path = shutil.which(name)
        if path is not None:
            return path
    if os.environ.get("CI") == "true":
        pytest.fail("CI must have a Firefox (Debian: firefox-esr)")
    pytest.skip("no Firefox on this machine")


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return live_result(tmp_path_factory.mktemp("firefox") / "r")


@pytest.fixture(scope="module")
def page(
    result: Result, firefox: str, running_desk: Desk, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[FirefoxPage]:
    profile = tmp_path_factory.mktemp("firefox") / "profile"
    uri = (result.folder / "report.html").as_uri()
    with opened(firefox, uri, profile, running_desk.environment) as page:
        yield page
        assert page.complaints == []
        assert all(asked.startswith(("file:", "data:", "blob:")) for asked in page.requested)


def shown(page: FirefoxPage, gains: tuple[float, ...], stops: float, tone: Tone) -> Picture:
    wanted = {"gains": gains, "stops": stops, "tone": tone.value}
    uri = str(page.evaluate(SHOWN % json.dumps(wanted)))
    data = base64.b64decode(uri.partition(",")[2])
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))


@pytest.mark.parametrize(
    ("gains", "stops", "tone"),
    [
        ((1, 1, 1), 0, Tone.SRGB),
        ((1, 0.4, 3.95), 0, Tone.SOFT),
        ((0.05, 0.05, 0), 8, Tone.SRGB),
        ((0, 4, 0.05), -4, Tone.SRGB),
    ],
    ids=["as captured", "soft", "dark gains lifted", "dark exposure"],
)
def test_firefox_shows_numpys_mix(
    result: Result, page: FirefoxPage, gains: tuple[float, ...], stops: float, tone: Tone
) -> None:
    picture = shown(page, gains, stops, tone)
    assert picture.shape == (*SHAPE, 3)
    assert np.abs(picture - expected(result, gains, stops, tone)).max() <= 1


def test_the_screen_shows_the_mix(result: Result, page: FirefoxPage) -> None:
    shown(page, (1, 0, 0), 0, Tone.SRGB)
    page.evaluate(
        "document.querySelector('#live canvas').style.cssText ="
        "'position:fixed;left:0;top:0;width:83px;height:60px;z-index:9;image-rendering:pixelated'"
    )
    page.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    seen = page.photograph(SHAPE[1], SHAPE[0])
    page.evaluate("document.querySelector('#live canvas').style.cssText = ''")
    assert seen.shape == (*SHAPE, 3)
    assert np.abs(seen - expected(result, (1, 0, 0))).max() <= 1


def test_probe_and_scrubber_work(page: FirefoxPage) -> None:
    page.evaluate("document.querySelector('#probe').scrollIntoView()")
    wait = (
        "new Promise(done => {{ const look = () => {} ? done() : setTimeout(look, 20); look() }})"
    )
    page.evaluate(wait.format("document.querySelector('#probe .place').textContent"))
    said = page.evaluate("document.querySelector('#probe .place').textContent")
    assert said == "Pixel in row 30, column 41: measured."
    assert page.evaluate("document.querySelectorAll('#probe .plot circle').length") == 9
    page.evaluate("document.querySelector('#scrubber').scrollIntoView()")
    page.evaluate(wait.format("'filled' in document.querySelector('#scrubber').dataset"))


def test_without_a_display_the_page_says_what_is_missing(
    result: Result, firefox: str, tmp_path: Path
) -> None:
    """Firefox has no OpenGL then, unlike on anybody's desk."""
    uri = (result.folder / "report.html").as_uri()
    with opened(firefox, uri, tmp_path / "profile", without_display()) as page:
        assert page.evaluate("document.documentElement.dataset.live") == "partly"
        problem = page.evaluate("document.querySelector('#live-problem').textContent")
        assert "WebGL2" in problem
        assert "lumisplit remix" in problem
        assert page.evaluate("getComputedStyle(document.querySelector('.stage')).display") == "none"
        assert page.evaluate("document.querySelector('#direct-canvas').width") > 0
        assert page.complaints == []
