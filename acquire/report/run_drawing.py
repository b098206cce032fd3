"""What the frames themselves say about the run: the lamp, and whether complements add up."""

from __future__ import annotations

import math
from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from acquire.report.figures import FAINT, PALETTE, RGB_LINES, STYLE, Drawing, drawn, svg
from acquire.result import DriftRecord, ProofRecord

SMALLEST_PERCENT = 0.5


def run_drawing(proof: ProofRecord) -> Drawing | None:
    """Light and additivity of every frame in the order of the run; None without any figure."""
    light = _percent(proof.light) - 100
    sums = _percent(proof.additivity)
    if not (np.isfinite(light).any() or np.isfinite(sums).any()):
        return None
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(5.7, 3.6), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True)
        _draw(above, light, PALETTE[0], "light, % of first")
        _draw(below, sums, PALETTE[4], "sum − white, %")
        below.set_xlabel("frame, in the order of the run")
    return Drawing(
        svg(figure),
        f"Light of {np.isfinite(light).sum()} frames in the order of the run, {_span(light)}; "
        f"patterns and complements miss white by {_span(sums)}.",
    )


def drift_drawing(drift: DriftRecord) -> Drawing | None:
    """Light of the white frames against their place among the exposures; None for a single one."""
    if len(drift.white_order) < 2:
        return None
    percent = 100 * np.array(drift.gain) - 100
    with drawn(5.7, 2.5) as (figure, axes):
        axes.axhline(0, color=FAINT, linewidth=0.8)
        for colour, line in zip(RGB_LINES, percent.T, strict=True):
            axes.plot(drift.white_order, line, "o-", c=colour, ms=4, lw=1.4)
        largest = max(float(np.abs(percent).max()), SMALLEST_PERCENT)
        axes.set_ylim(-1.15 * largest, 1.15 * largest)
        axes.set_xlabel("place among all exposures")
        axes.set_ylabel("white − first, %")
        axes.grid(axis="y")
    return Drawing(
        svg(figure),
        f"Light of {len(percent)} white frames against the first, {_span(percent)}.",
    )


def _percent(values: Sequence[float | None]) -> NDArray[np.float64]:
    return 100 * np.array([math.nan if value is None else value for value in values], float)


def _draw(axes: Axes, percent: NDArray[np.float64], colour: str, label: str) -> None:
    axes.axhline(0, color=FAINT, linewidth=0.8)
    axes.plot(np.arange(percent.size), percent, ".", c=colour, ms=3)
    largest = np.max(np.abs(percent), where=np.isfinite(percent), initial=SMALLEST_PERCENT)
    axes.set_ylim(-1.15 * largest, 1.15 * largest)
    axes.set_ylabel(label)
    axes.grid(axis="y")


def _span(percent: NDArray[np.float64]) -> str:
    known = percent[np.isfinite(percent)]
    return f"{known.min():+.2f} % to {known.max():+.2f} %" if known.size else "not known"
