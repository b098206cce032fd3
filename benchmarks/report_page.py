"""The page of a 16-megapixel result: its size, what making it takes, and how fast it opens.

    python -m benchmarks.report_page [FOLDER]

Writes a result of 3280 × 4928 pixels, 3 components with standard errors and 23 pitches into FOLDER
(or a temporary one; 2 GB, images of all pitches are one file under many names). Its light has
texture and 1 % noise, so that it is as hard to pack as a real one. Needs Chromium.
"""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from playwright.sync_api import sync_playwright

from acquire.proof.portraits import MOST
from acquire.remix import write_mix
from acquire.report import write_report
from acquire.result import PortraitRecord, ProofRecord, Result, write_record, write_tiff
from acquire.tone import Tone
from tests.acquire.browsers import ARGUMENTS, SOFTWARE_GRAPHICS
from tests.acquire.result_folders import write_result

SHAPE = 3280, 4928
PITCHES_PX = range(8, 100, 4)
OPENINGS = 5


def make(folder: Path) -> None:
    small = write_result(folder, shape=(24, 32), pitches_px=PITCHES_PX)
    chance = np.random.default_rng(0)
    height, width = SHAPE
    y, x = np.ogrid[:height, :width]
    scene = 0.4 + 0.2 * np.sin(x / 90) * np.cos(y / 70) + 0.1 * chance.random(SHAPE)
    for k, name in enumerate(("white", *small.record.components)):
        stem = "white" if k == 0 else f"components/{name}"
        image = 0.01 * chance.standard_normal((*SHAPE, 3), np.float32)
        image += (scene * (1.0, 0.6, 0.1, 0.3)[k])[..., np.newaxis]
        np.maximum(image, 0, out=image)
        write_tiff(folder / f"{stem}.tiff", image)
        if k:
            (folder / "deviations").mkdir(exist_ok=True)
            write_tiff(folder / f"deviations/{name}.tiff", 0.01 + 0.02 * image)
    pitches = [
        pitch.model_copy(
            update={
                kind: pitch.direct.replace("/direct-", f"/{kind}-")
                for kind in ("corrected", "deviation")
            }
        )
        for pitch in small.record.pitches
    ]
    for pitch in pitches:
        for path, source in (
            (pitch.direct, "components/direct"),
            (pitch.global_, "components/interreflection"),
            (pitch.corrected, "components/direct"),
            (pitch.deviation, "deviations/direct"),
        ):
            (folder / str(path)).unlink(missing_ok=True)
            os.link(folder / f"{source}.tiff", folder / str(path))
    write_tiff(folder / "mask.tiff", np.zeros(SHAPE, np.uint8))
    changes = {"shape": SHAPE, "deviations": True, "pitches": tuple(pitches)}
    changes["proof"] = proof(folder, chance)
    write_record(folder, small.record.model_copy(update=changes))


def proof(folder: Path, chance: np.random.Generator) -> ProofRecord:
    """Six frames beside their predictions, all of noise, which packs worst."""
    (folder / "proof").mkdir()
    worst = []
    for step in range(MOST):
        paths = [f"proof/{kind}-{step:06d}-0.tiff" for kind in ("measured", "predicted")]
        for path in paths:
            write_tiff(folder / path, chance.random((170, 256, 3), np.float32))
        worst.append(
            PortraitRecord(
                step=step, attempt=0, pattern="checker:8:0,0", verdict="is noise", is_right=True,
                how="noise", holds=1.0, miss=0.5, white=1.0, light=1.0, residual=0.0,
                additivity=0.0, measured=paths[0], predicted=paths[1], shape=(170, 256),
            )
        )  # fmt: skip
    light = tuple(chance.normal(1, 0.01, 830).tolist())
    return ProofRecord(
        judged=830, wrong=0, unseen=0, retaken=0, light=light, additivity=light, worst=tuple(worst)
    )


def measured(folder: Path, job: str) -> str:
    """Seconds and peak memory of a job in a process of its own."""
    began_s = time.monotonic()
    words = [sys.executable, "-m", "benchmarks.report_page", str(folder), job]
    subprocess.run(words, check=True)  # noqa: S603 - this very program
    return f"{time.monotonic() - began_s:.1f} s"


def do(folder: Path, job: str) -> None:
    result = Result.open(folder)
    if job == "report":
        write_report(result)
    else:
        write_mix(result, (1, 0.4, 2), folder.with_suffix(f".{job}"), 0, Tone.SRGB)
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{job}: peak {peak_mb:.0f} MB")


def openings_s(page: Path) -> list[tuple[float, float]]:
    """From the start of the navigation to the load event and to the first mix drawn."""
    executable = shutil.which("chromium") or shutil.which("google-chrome")
    seconds = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=executable, args=[*ARGUMENTS, *SOFTWARE_GRAPHICS]
        )
        for _ in range(OPENINGS):
            tab = browser.new_page(viewport={"width": 1280, "height": 800})
            tab.goto(page.as_uri())
            tab.wait_for_function("document.documentElement.dataset.live === 'ready'")
            load_ms, mix_ms = tab.evaluate(
                "[performance.getEntriesByType('navigation')[0].loadEventEnd,"
                " performance.getEntriesByName('first mix drawn')[0].startTime]"
            )
            seconds.append((load_ms / 1000, mix_ms / 1000))
            tab.close()
        browser.close()
    return seconds


def main() -> None:
    if len(sys.argv) == 3:
        do(Path(sys.argv[1]), sys.argv[2])
        return
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(temporary) / "result"
        if not folder.exists():
            make(folder)
        for job in ("report", "tiff", "png"):
            print(f"{job}: {measured(folder, job)}")
        page = folder / "report.html"
        print(f"page: {page.stat().st_size / 1e6:.1f} MB")
        for load_s, mix_s in openings_s(page):
            print(f"loaded after {load_s:.2f} s, first mix drawn after {mix_s:.2f} s")


if __name__ == "__main__":
    main()
