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

SMALLEST_PERCENT, SMALLEST_PX, SMALLEST_PART_PERCENT = 0.5, 0.1, 0.1


def run_drawing(proof: ProofRecord) -> Drawing | None:
    """What was measured in every frame, in the order of the run; None without any.

    Light, additivity and movement; what is saturated or dark where there is anything to be seen.
    """
    light = _percent(proof.light) - 100
    sums = _percent(proof.additivity)
    moved = _percent(proof.moved_px) / 100
    rows = [("light − first, %", light, PALETTE[0], SMALLEST_PERCENT)]
    rows += [("sum − white, %", sums, PALETTE[4], SMALLEST_PERCENT)]
    rows += [("moved, camera px", moved, PALETTE[2], SMALLEST_PX)]
    for label, parts, colour in (
        ("saturated, %", _percent(proof.saturated), PALETTE[1]),
        ("dark, %", _percent(proof.shaded), PALETTE[3]),
    ):
        if np.max(parts, where=np.isfinite(parts), initial=0) > SMALLEST_PART_PERCENT:
            rows.append((label, parts, colour, SMALLEST_PERCENT))
    shown = [row for row in rows if np.isfinite(row[1]).any()]
    if not shown:
        return None
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(8.6, 0.6 + 1.3 * len(shown)), layout="constrained")
        axes = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
        for place, (label, values, colour, least) in zip(axes, shown, strict=True):
            _draw(place, values, colour, label, least)
        axes[-1].set_xlabel("frame, in the order of the run")
        figure.align_ylabels(axes)
    said = f"Light of {np.isfinite(light).sum()} frames in the order of the run, {_span(light)}; "
    said += f"patterns and complements miss white by {_span(sums)}"
    if np.isfinite(moved).any():
        said += f"; the picture moved by up to {np.nanmax(moved):.2f} camera pixels"
    return Drawing(svg(figure), f"{said}.")


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


def _draw(axes: Axes, values: NDArray[np.float64], colour: str, label: str, least: float) -> None:
    """Points around 0 or, of what is never negative, above it; at least `least` is shown."""
    axes.axhline(0, color=FAINT, linewidth=0.8)
    axes.plot(np.arange(values.size), values, ".", c=colour, ms=3)
    largest = np.max(np.abs(values), where=np.isfinite(values), initial=least)
    negative = bool(np.any(values < 0)) or "−" in label
    axes.set_ylim(-1.15 * largest if negative else -0.1 * largest, 1.15 * largest)
    axes.set_ylabel(label)
    axes.grid(axis="y")


def _span(percent: NDArray[np.float64]) -> str:
    known = percent[np.isfinite(percent)]
    return f"{known.min():+.2f} % to {known.max():+.2f} %" if known.size else "not known"
