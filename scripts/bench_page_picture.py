"""Make docs/bench-page.png anew: the page at the simulated bench, in mid-capture.

    python scripts/bench_page_picture.py

Needs playwright and a Chromium, as the tests do.
"""

from __future__ import annotations

import io
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page, sync_playwright

OUT = Path(__file__).parents[1] / "docs" / "bench-page.png"
PLAN = "[pattern]\npitch_px = [24, 16, 12]\nshifts = [4, 2]\n"
BENCH = """kind = "sim"
[sim]
camera_px = [192, 256]
full_well_e = 20000
read_noise_e = 5
real_time = true
"""
PATIENCE_S = 60.0


def until(page: Page, condition: str) -> None:
    """Wait for a JavaScript condition."""
    deadline_s = time.monotonic() + PATIENCE_S
    while not page.evaluate(condition):
        if time.monotonic() > deadline_s:
            raise TimeoutError(condition)
        time.sleep(0.05)


def main() -> None:
    """Aim, start the plan, and take the picture when some frames were proved."""
    chromium = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)
    with tempfile.TemporaryDirectory() as name, sync_playwright() as playwright:
        folder = Path(name)
        (folder / "plan.toml").write_text(PLAN)
        (folder / "bench.toml").write_text(BENCH)
        words = ["bench", "plan.toml", "--out", "session", "--bench", "bench.toml", "--quiet"]
        bench = subprocess.Popen(  # noqa: S603 - this interpreter and this project
            [sys.executable, "-m", "acquire", *words],
            cwd=folder,
            stdout=subprocess.PIPE,
            text=True,
        )
        out = bench.stdout
        address = out.readline().split()[-1] if out else ""
        browser = playwright.chromium.launch(
            executable_path=chromium, args=["--headless", "--no-sandbox", "--disable-gpu"]
        )
        page = browser.new_page(viewport={"width": 1280, "height": 760})
        page.goto(address)
        until(page, "document.getElementById('camera').dataset.number > 2")
        page.click("#start")
        until(page, "document.getElementById('proof').textContent.includes('judged')")
        time.sleep(1.0)
        picture = Image.open(io.BytesIO(page.screenshot()))
        browser.close()
        bench.terminate()
        bench.wait()
    picture.convert("RGB").quantize(128).save(OUT, optimize=True)
    print(f"{OUT}: {OUT.stat().st_size} bytes")


if __name__ == "__main__":
    main()
