"""A result whose report has everything that a browser computes with."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from acquire.remix import developed, mix
from acquire.report import write_report
from acquire.result import PixelClass, Result, write_record, write_tiff
from acquire.tone import Tone, exposure_of
from tests.acquire.result_folders import write_result

SHAPE = (60, 83)
Picture = NDArray[np.uint8]


def live_result(folder: Path) -> Result:
    """Components of both signs over five decades, deviations, pixels of every class; a report."""
    made = write_result(folder, shape=SHAPE, pixel_class=PixelClass.SATURATED)
    mask = made.mask.copy()
    mask[-10:, -10:] = PixelClass.UNLIT
    write_tiff(folder / "mask.tiff", mask)
    (folder / "deviations").mkdir()
    chance = np.random.default_rng(9)
    for name in made.record.components:
        light = 10 ** chance.uniform(-5, 0, (*SHAPE, 3)) * chance.choice([1, 1, -1], (*SHAPE, 3))
        light[mask == PixelClass.SATURATED] = np.nan
        write_tiff(folder / f"components/{name}.tiff", light.astype(np.float32))
        error = np.broadcast_to(np.linspace(0, 0.02, SHAPE[1])[:, np.newaxis], (*SHAPE, 3))
        write_tiff(folder / f"deviations/{name}.tiff", error.astype(np.float32))
    pitches = []
    for k, pitch in enumerate(made.record.pitches):
        names = {
            "corrected": f"pitches/corrected-{k}.tiff",
            "deviation": f"pitches/deviation-{k}.tiff",
        }
        corrected = result_light(made, mask, 0.5 - 0.1 * k)
        write_tiff(folder / names["corrected"], corrected)
        write_tiff(folder / names["deviation"], (0.01 + 0.1 * corrected).astype(np.float32))
        pitches.append(pitch.model_copy(update=names))
    changes = {"deviations": True, "pitches": tuple(pitches)}
    write_record(folder, made.record.model_copy(update=changes))
    write_report(Result.open(folder))
    return Result.open(folder)


def result_light(result: Result, mask: Picture, share: float) -> NDArray[np.float32]:
    """A share of the white light, 0 where nothing is lit."""
    lit = (mask != PixelClass.UNLIT)[..., np.newaxis]
    return np.where(lit, share * result.white, np.float32(0)).astype(np.float32)


def expected(
    result: Result, gains: tuple[float, ...], stops: float = 0, tone: Tone = Tone.SRGB
) -> NDArray[np.int64]:
    light = mix([result.component(name) for name in result.record.components], gains)
    return developed(light, exposure_of(result.white) * 2**stops, tone).astype(int)
