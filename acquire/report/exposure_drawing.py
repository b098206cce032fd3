"""Gain of every frame of an imported stack, and the tone curve of its camera."""

from __future__ import annotations

import numpy as np

from acquire.exposure_record import ExposureRecord, ToneCurveRecord
from acquire.report.figures import FAINT, RGB_LINES, Drawing, drawn, svg

SMALLEST_PERCENT = 0.5


def gains_drawing(record: ExposureRecord) -> Drawing | None:
    """Gain of each frame that has a complement, with its standard error; None without any."""
    frames = sorted(
        ((one, pair.corrected) for pair in record.pairs for one in pair.frames),
        key=lambda told: told[0].step,
    )
    if not frames:
        return None
    steps = np.array([one.step for one, _ in frames])
    percent = 100 * np.array([one.gain for one, _ in frames]) - 100
    error = 100 * np.array([one.error for one, _ in frames])
    corrected = np.array([taken for _, taken in frames])
    with drawn(5.7, 2.7) as (figure, axes):
        axes.axhline(0, color=FAINT, linewidth=0.8)
        for line, bar, colour in zip(percent.T, error.T, RGB_LINES, strict=True):
            for taken, face in ((True, colour), (False, "none")):
                at = corrected == taken
                axes.errorbar(
                    steps[at], line[at], bar[at], fmt="o", c=colour, mfc=face, ms=3.2, lw=0.9
                )
        largest = max(float(np.abs(percent).max()), SMALLEST_PERCENT)
        axes.set_ylim(-1.15 * largest, 1.15 * largest)
        axes.set_xlabel("frame of the table")
        axes.set_ylabel("gain − white's, %")
        axes.grid(axis="y")
    said = f"Gain of {len(frames)} frames against the white one, "
    return Drawing(svg(figure), f"{said}{percent.min():+.1f} % to {percent.max():+.1f} %.")


def curve_drawing(curve: ToneCurveRecord) -> Drawing:
    """What linearised numbers are multiplied by, against their code."""
    codes, factors, errors = (np.array(one) for one in (curve.codes, curve.factors, curve.errors))
    with drawn(5.7, 2.7) as (figure, axes):
        axes.axhline(1, color=FAINT, linewidth=0.8)
        for line, bar, colour in zip(factors, errors, RGB_LINES, strict=True):
            axes.errorbar(100 * codes, line, bar, fmt="o-", c=colour, ms=3.2, lw=1.2)
        axes.set_ylim(0, 1.1 * float((factors + errors).max()))
        axes.set_xlabel("code, % of the largest")
        axes.set_ylabel("light by number")
        axes.grid(axis="y")
    return Drawing(
        svg(figure),
        f"Factor between linearised numbers and light, {factors.min():.2f} to {factors.max():.2f}.",
    )
