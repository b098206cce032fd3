"""Make docs/bench-page.png anew: the page at the simulated bench, in mid-capture.

    python -m scripts.bench_page_picture

Needs playwright and a Chromium, as the tests do.
"""

from __future__ import annotations

import io
import shutil
import tempfile
import time
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page, sync_playwright

from benchmarks.paged import start

OUT = Path(__file__).parents[1] / "docs" / "bench-page.png"
PLAN = "[pattern]\npitch_px = [24, 16, 12]\nshifts = [6, 4]\n"
PATIENCE_S = 60.0


def until(page: Page, condition: str) -> None:
    """Wait for a JavaScript condition."""
    deadline_s = time.monotonic() + PATIENCE_S
    while not page.evaluate(condition):
        if time.monotonic() > deadline_s:
            raise TimeoutError(condition)
        time.sleep(0.05)


def main() -> None:
    """Aim, start the plan, and take the picture when a frame stands beside its prediction."""
    chromium = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)
    with tempfile.TemporaryDirectory() as name, sync_playwright() as playwright:
        bench, address = start(Path(name), PLAN, "bench", "--quiet")
        browser = playwright.chromium.launch(
            executable_path=chromium, args=["--headless", "--no-sandbox", "--disable-gpu"]
        )
        page = browser.new_page(viewport={"width": 1280, "height": 760})
        page.goto(address)
        until(page, "document.getElementById('camera').dataset.number > 2")
        page.click("#start")
        until(page, "Number(document.getElementById('camera').dataset.step) > 25")
        until(page, "document.getElementById('how').textContent.includes('complement')")
        time.sleep(1.0)
        picture = Image.open(io.BytesIO(page.screenshot()))
        browser.close()
        bench.terminate()
        bench.wait()
    picture.convert("RGB").quantize(128).save(OUT, optimize=True)
    print(f"{OUT}: {OUT.stat().st_size} bytes")


if __name__ == "__main__":
    main()
