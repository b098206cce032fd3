"""The page's own arithmetic: what it is given, and what a browser makes of it."""

from __future__ import annotations

import base64
import io
import json
import re
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Playwright, expect

from acquire.remix import SATURATED_RGB, developed
from acquire.report import write_report
from acquire.report.live import packed
from acquire.report.pictures import UNLIT_RGB
from acquire.result import PixelClass, Result
from acquire.tone import Tone, exposure_of
from tests.acquire.browsers import NO_GRAPHICS, Visit, opened
from tests.acquire.live_results import SHAPE, Picture, expected, live_result
from tests.acquire.result_folders import write_result


def unpacked(data: bytes, n_bytes: int) -> NDArray[np.float32]:
    planes = np.frombuffer(zlib.decompress(data), np.uint8).reshape(n_bytes, -1)
    whole = np.zeros((planes.shape[1], 4), np.uint8)
    whole[:, :n_bytes] = planes.T
    return whole.view(">f4").ravel().astype(np.float32)


@pytest.mark.parametrize(("n_bytes", "bound"), [(4, 0.0), (3, 2.0**-16), (2, 2.0**-8)])
def test_packed_light_keeps_its_bound(n_bytes: int, bound: float) -> None:
    chance = np.random.default_rng(2)
    sizes = 10.0 ** chance.uniform(-8, 2, 5000)
    light = (sizes * chance.choice([-1, 1], 5000)).astype(np.float32)
    light[:3] = 0, 1, 0.9999999
    read = unpacked(packed(light, n_bytes), n_bytes)
    assert np.all(np.abs(read - light) <= bound * np.abs(light))


def test_what_was_not_measured_is_packed_as_zero() -> None:
    assert unpacked(packed(np.array([np.nan, 1.0]), 3), 3).tolist() == [0.0, 1.0]


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return live_result(tmp_path_factory.mktemp("live") / "r")


@pytest.fixture(scope="module")
def visit(result: Result, playwright: Playwright, chromium: str) -> Iterator[Visit]:
    with opened(playwright, chromium, (result.folder / "report.html").as_uri()) as visit:
        yield visit
        assert visit.complaints == []


AS_LOADED = """() => {
  const set = (selector, value) => {
    const control = document.querySelector(selector);
    control.value = value;
    control.dispatchEvent(new Event(control.tagName === "SELECT" ? "change" : "input"));
  };
  for (const side of ["B", "A"]) {
    document.querySelector(`[name=side][value=${side}]`).click();
    document.querySelector("[data-preset=as-captured]").click();
  }
  const defaults = { wipe: 100, exposure: 0, tone: "srgb", overlay: -2, pitch: 0 };
  for (const [name, value] of Object.entries(defaults)) set(`#${name}`, value);
}"""


@pytest.fixture(autouse=True)
def _as_it_was_loaded(request: pytest.FixtureRequest) -> None:
    """Loading it anew for every test would take longer than the tests."""
    if "visit" in request.fixturenames:
        request.getfixturevalue("visit").page.evaluate(AS_LOADED)


def slide(visit: Visit, selector: str, value: float) -> None:
    visit.page.locator(selector).fill(f"{value:g}")


def downloaded(visit: Visit) -> Picture:
    with visit.page.expect_download() as waiting:
        visit.page.click("#download")
    return np.asarray(Image.open(waiting.value.path()).convert("RGB"))


@pytest.mark.browser
@pytest.mark.parametrize(
    ("gains", "stops", "tone"),
    [
        ((1, 1, 1), 0, Tone.SRGB),
        ((0, 0, 0), 0, Tone.SRGB),
        ((1, 0.4, 3.95), 0, Tone.SOFT),
        ((0.05, 0.05, 0), 8, Tone.SRGB),
        ((0, 4, 0.05), -4, Tone.SRGB),
        ((4, 4, 4), 8, Tone.SOFT),
    ],
    ids=["as captured", "nothing", "soft", "dark gains lifted", "dark exposure", "all up"],
)
def test_browser_shows_numpys_mix(
    result: Result, visit: Visit, gains: tuple[float, ...], stops: float, tone: Tone
) -> None:
    for index, gain in enumerate(gains):
        slide(visit, f"[data-gain='{index}']", gain)
    slide(visit, "#exposure", stops)
    visit.page.select_option("#tone", tone.value)
    shown = downloaded(visit)
    assert shown.shape == (*SHAPE, 3)
    assert np.abs(shown - expected(result, gains, stops, tone)).max() <= 1


@pytest.mark.browser
def test_wipe_shows_two_mixes(result: Result, visit: Visit) -> None:
    visit.page.click("[data-preset=direct-only]")
    visit.page.check("[name=side][value=B]")
    visit.page.click("[data-preset=scattering-x2]")
    slide(visit, "#wipe", 25)
    shown = downloaded(visit)
    border = int(np.ceil(0.25 * SHAPE[1] - 0.5))
    both = expected(result, (1, 0, 0)), expected(result, (1, 2, 1))
    columns = np.arange(SHAPE[1])[:, np.newaxis] < 0.25 * SHAPE[1]
    assert np.abs(shown - np.where(columns, *both)).max() <= 1
    assert np.abs(both[0] - both[1])[:, border:].max() > 50


@pytest.mark.browser
@pytest.mark.parametrize("name", ["as-captured", "direct-only", "no-interreflection"])
def test_preset_is_the_commands(result: Result, visit: Visit, name: str) -> None:
    gains = {"as-captured": (1, 1, 1), "direct-only": (1, 0, 0), "no-interreflection": (1, 1, 0)}
    visit.page.click(f"[data-preset={name}]")
    assert visit.page.get_attribute(f"[data-preset={name}]", "aria-pressed") == "true"
    assert np.abs(downloaded(visit) - expected(result, gains[name])).max() <= 1


@pytest.mark.browser
def test_overlays(result: Result, visit: Visit) -> None:
    visit.page.select_option("#overlay", label="saturated and unlit")
    shown = downloaded(visit)
    assert (shown[result.mask == PixelClass.SATURATED] == SATURATED_RGB).all()
    assert (shown[result.mask == PixelClass.UNLIT] == UNLIT_RGB).all()
    visit.page.select_option("#overlay", label="uncertainty of subsurface")
    expect(visit.page.locator(".ramp")).to_be_visible()
    shown = downloaded(visit)
    lowest, highest = shown[-15, 0].astype(int), shown[-15, -1].astype(int)
    # The ends of viridis (Smith and van der Walt, 2015).
    assert np.abs(lowest - (68, 1, 84)).max() <= 2
    assert np.abs(highest - (253, 231, 37)).max() <= 2


@pytest.mark.browser
def test_canvas_on_the_screen_is_what_is_downloaded(result: Result, visit: Visit) -> None:
    """Not only the file: the picture that a person sees."""
    page = visit.page
    page.click("[data-preset=direct-only]")
    page.evaluate(
        "document.querySelector('#live canvas').style.cssText ="
        "'position:fixed;left:0;top:0;width:83px;height:60px;z-index:9'"
    )
    page.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    clip = {"x": 0, "y": 0, "width": SHAPE[1], "height": SHAPE[0]}
    photo = page.screenshot(clip=clip)  # type: ignore[arg-type] # a plain dict is a FloatRect
    seen = np.asarray(Image.open(io.BytesIO(photo)).convert("RGB"))
    assert seen.shape == (*SHAPE, 3)
    assert np.abs(seen - expected(result, (1, 0, 0))).max() <= 1


@pytest.mark.browser
def test_probe_reads_the_pixel_under_the_click_and_the_keys(result: Result, visit: Visit) -> None:
    page = visit.page
    canvas = page.locator("#live canvas")
    box = canvas.bounding_box()
    assert box is not None
    at = {"x": box["width"] * 50.5 / SHAPE[1], "y": box["height"] * 40.5 / SHAPE[0]}
    canvas.click(position=at)  # type: ignore[arg-type] # a plain dict is a Position
    said = page.locator("#probe .place")
    expect(said).to_have_text("Pixel in row 40, column 50: measured.")
    canvas.press("ArrowUp")
    canvas.press("Shift+ArrowRight")
    assert said.inner_text() == "Pixel in row 39, column 60: measured."
    cells = page.locator("#probe tbody tr").first.locator("td").all_inner_texts()
    values = [float(cell.replace("−", "-")) for cell in cells[:3]]
    direct = result.component("direct")[39, 60]
    assert np.abs(values - direct).max() < 6e-5
    share = float(cells[3].partition(" ±")[0].replace("−", "-"))
    assert share == pytest.approx(100 * direct.sum() / result.white[39, 60].sum(), abs=0.06)
    error = float(re.findall(r"± ([\d.]+) %", cells[3])[0])
    stated = np.sqrt(3) * result.deviation("direct")[39, 60, 0] / result.white[39, 60].sum()
    assert error == pytest.approx(100 * stated, abs=0.06 + 100 * stated / 256)
    assert page.locator("#probe .plot circle").count() == 9
    said_plot = page.get_attribute("#probe .plot", "aria-label") or ""
    red = np.array(
        [
            [float(v) for v in re.findall(r"[\d.e-]+", each)]
            for each in re.findall(
                r"red ([\d.e-]+ ± [\d.e-]+) to ([\d.e-]+ ± [\d.e-]+),", said_plot
            )[0]
        ]
    )
    finest, coarsest = (
        [result.pitch_image(path)[39, 60, 0] for path in (pitch.corrected, pitch.deviation) if path]
        for pitch in (result.record.pitches[0], result.record.pitches[-1])
    )
    # Three digits of the value, two of its error, which is also rounded to 2⁻⁸ of itself.
    assert np.all(np.abs(red - (finest, coarsest)) <= np.multiply(red, (0.006, 0.056)))
    assert page.locator("#probe .plot .error").count() == 9
    for _ in range(5):
        canvas.press("Shift+ArrowUp")
        canvas.press("Shift+ArrowLeft")
    assert "saturated, not measured" in said.inner_text()


@pytest.mark.browser
@pytest.mark.parametrize(
    ("stops", "tone", "overlay"),
    [(0, Tone.SRGB, "none"), (-2, Tone.SOFT, "saturated and unlit")],
    ids=["as captured", "exposed and marked like the mix"],
)
def test_scrubber_shows_the_pitch(
    result: Result, visit: Visit, stops: float, tone: Tone, overlay: str
) -> None:
    page = visit.page
    page.locator("#scrubber").scroll_into_view_if_needed()
    page.locator("#scrubber[data-filled]").wait_for()
    slide(visit, "#pitch", 2)
    slide(visit, "#exposure", stops)
    page.select_option("#tone", tone.value)
    page.select_option("#overlay", label=overlay)
    assert page.locator("#pitch-said").inner_text() == "32 px"
    for name, share in (("direct", 0.3), ("global", 0.4)):
        uri = page.evaluate(f"document.querySelector('#{name}-canvas').toDataURL()")
        shown = np.asarray(Image.open(io.BytesIO(base64.b64decode(uri.partition(",")[2]))))[..., :3]
        known = result.mask == PixelClass.MEASURED
        light = share * result.white[known].astype(np.float64)
        gain = exposure_of(result.white) * 2**stops
        right = developed(light[np.newaxis], gain, tone)[0].astype(int)
        assert np.abs(shown[known] - right).max() <= 1
        assert (shown[result.mask == PixelClass.SATURATED] == SATURATED_RGB).all()
        unlit = (shown == UNLIT_RGB).all(axis=2)
        assert (unlit == ((result.mask == PixelClass.UNLIT) & (overlay != "none"))).all()


@pytest.mark.browser
def test_every_control_has_a_name_and_takes_the_keyboard(visit: Visit) -> None:
    page = visit.page
    names = page.evaluate(
        "[...document.querySelectorAll('input, select, button, canvas')].map(one =>"
        " (one.labels?.[0]?.textContent ?? one.textContent ?? '').trim()"
        " || one.getAttribute('aria-label') || '')"
    )
    assert len(names) >= 15
    assert all(names)
    page.locator("[data-gain='1']").focus()
    page.keyboard.press("ArrowRight")
    assert page.locator("[data-gain='1'] + output").inner_text() == "×1.05"
    outline = "getComputedStyle(document.activeElement).outlineStyle"
    assert page.evaluate(outline) == "solid"


@pytest.mark.browser
def test_without_webgl_the_page_says_so_and_the_rest_works(
    result: Result, playwright: Playwright, chromium: str
) -> None:
    uri = (result.folder / "report.html").as_uri()
    with opened(playwright, chromium, uri, NO_GRAPHICS) as visit:
        assert "lumisplit remix" in visit.page.locator("#live-problem").inner_text()
        assert not visit.page.locator("#live .stage").is_visible()
        assert visit.page.locator("#direct-canvas").is_visible()
        visit.page.locator("#probe").scroll_into_view_if_needed()
        expect(visit.page.locator("#probe .place")).to_contain_text("row 30, column 41")


def test_facts_cannot_end_their_element(tmp_path: Path) -> None:
    text = write_report(write_result(tmp_path / "r")).read_text("utf-8")
    facts = re.findall(r'id="facts">(.*?)</script>', text)[0]
    assert "<" not in facts
    assert json.loads(facts)["components"][0]["name"] == "direct"


@pytest.mark.parametrize(
    ("shape", "said"),
    [((24, 32), False), ((24, 2000), True)],
    ids=["every pixel", "reduced"],
)
def test_reduction_is_said(tmp_path: Path, shape: tuple[int, int], said: bool) -> None:
    text = write_report(write_result(tmp_path / "r", shape=shape)).read_text("utf-8")
    assert ("Reduced for this page: blocks of\n3 × 3 camera pixels" in text) is said
