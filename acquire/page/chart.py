"""Rasters that are shown for aiming: the focus chart, and patterns by their text."""

from __future__ import annotations

import numpy as np

from acquire.plan import ProjectorPlan
from drivers.protocols import Raster
from processing.patterns import Pattern

CHART = "chart"
SPOKES = 36
MAX_PITCH_PX = 100_000


def shown_raster(what: str, resolution: tuple[int, int], projector: ProjectorPlan) -> Raster:
    """The raster of ``chart`` or of a pattern's text.

    Parameters
    ----------
    what
        ``chart``, ``white``, ``checker:8:0,2`` and the like.
    resolution
        (height, width) of the projector in pixels.
    projector
        As the plan has it: with its response.

    Raises
    ------
    ValueError
        There is no such pattern.
    """
    if what == CHART:
        return focus_chart(resolution)
    pattern = Pattern.parse(what)
    if max(pattern.pitch_px, pattern.shift_y_px, pattern.shift_x_px) > MAX_PITCH_PX:
        raise ValueError(f"{what}: pitch and shifts are at most {MAX_PITCH_PX} px")
    return projector.raster(pattern, resolution)


def focus_chart(resolution: tuple[int, int]) -> Raster:
    """Five Siemens stars, fields of lines 1 and 2 px wide, and the outermost pixels as a frame.

    A star blurs from its centre outwards; where it turns grey tells how far out of focus the
    projector is there. A side of the frame that cannot be
    seen falls beside the scene.

    Parameters
    ----------
    resolution
        (height, width) of the projector in pixels.

    Returns
    -------
    uint8, (height, width), 0 or 255.
    """
    height, width = resolution
    chart = np.zeros(resolution, np.uint8)
    radius = min(height, width) / 6
    margin = radius * 1.2
    for y, x in (
        (height / 2, width / 2),
        (margin, margin),
        (margin, width - margin),
        (height - margin, margin),
        (height - margin, width - margin),
    ):
        _star(chart, y, x, radius)
    half = round(radius * 0.4)
    for y, x, line_px in (
        (margin, width / 2, 1),
        (height - margin, width / 2, 2),
        (height / 2, margin, 1),
        (height / 2, width - margin, 2),
    ):
        field = chart[round(y) - half : round(y) + half, round(x) - half : round(x) + half]
        _lines(field, line_px)
    chart[[0, -1], :] = 255
    chart[:, [0, -1]] = 255
    return chart


def _star(chart: Raster, y: float, x: float, radius: float) -> None:
    down = np.arange(chart.shape[0])[:, np.newaxis] + 0.5 - y
    right = np.arange(chart.shape[1])[np.newaxis, :] + 0.5 - x
    sector = np.floor(np.arctan2(down, right) / (2 * np.pi) * SPOKES)
    inside = np.hypot(down, right) < radius
    chart[inside & (sector % 2 == 0)] = 255


def _lines(field: Raster, width_px: int) -> None:
    """Columns on the left of the field, rows on the right."""
    half = field.shape[1] // 2
    columns = np.arange(half) // width_px % 2 * 255
    rows = np.arange(field.shape[0]) // width_px % 2 * 255
    field[:, :half] = columns
    field[:, half:] = rows[:, np.newaxis]
