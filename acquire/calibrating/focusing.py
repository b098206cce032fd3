"""Figures while somebody turns the lenses: sharpness, clipping and coverage, shot after shot."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from acquire.calibrating.finding import Setting
from acquire.calibrating.light import LIT_FRACTION
from acquire.plan import Plan
from acquire.plan_file import BLACK, WHITE
from acquire.rig import Bench, Resumption
from calibration.focus import focus_figure
from drivers.image import LinearImage
from drivers.media import PICTURE_TYPES
from drivers.picture import decode_picture
from drivers.protocols import Devices
from drivers.raw import decode_raw
from processing.patterns import Family, Pattern

CHART = Pattern(Family.FOCUS, 4)
GREEN = 1
BRIGHT_PERCENTILE = 99.5


@dataclass(frozen=True, slots=True)
class Shot:
    """What one look says; a figure is None where there is too little light for it.

    Parameters
    ----------
    number
        From 1.
    chart
        `calibration.focus.focus_figure` of the projected chart over white: grows as the projector,
        and the camera, come into focus.
    camera
        The same of the scene under white: grows as the camera does.
    clipped
        Part of the pixels that are saturated under white.
    lit
        Part of the pixels that the projector lights.
    """

    number: int
    chart: float | None
    camera: float | None
    clipped: float
    lit: float


def look(
    bench: Bench, setting: Setting, shots: int | None, stop: threading.Event
) -> Iterator[Shot]:
    """Look until enough shots are taken or `stop` is set; the projector is blanked at the end."""
    plan = Plan(camera=setting.camera, projector=setting.projector, patterns=(WHITE,))
    with bench.aim(Resumption(plan)) as devices:
        black = _taken(devices, plan, BLACK).values[..., GREEN]
        for number in itertools.count(1) if shots is None else range(1, shots + 1):
            if stop.is_set():
                return
            white, chart = (_taken(devices, plan, pattern) for pattern in (WHITE, CHART))
            yield shot(number, white, chart, black)


def shot(number: int, white: LinearImage, chart: LinearImage, black: NDArray[np.float32]) -> Shot:
    """The figures of a white frame and one of the chart; `black` is (height, width), green."""
    light = white.values[..., GREEN] - black
    usable = ~white.saturated & ~chart.saturated
    bright = float(np.percentile(light, BRIGHT_PERCENTILE))
    lit = light > max(LIT_FRACTION * bright, 1e-3)
    known = usable & lit
    # Over white the scene's own pattern falls out of the chart's.
    ratio = (chart.values[..., GREEN] - black) / np.where(known, light, 1)
    return Shot(
        number,
        _figure(np.where(known, ratio, 0.5), known),
        _figure(light, known),
        float(white.saturated.mean()),
        float((lit | white.saturated).mean()),
    )


def _figure(light: NDArray[np.floating], usable: NDArray[np.bool_]) -> float | None:
    figure = focus_figure(light, usable)
    return figure if np.isfinite(figure) else None


def _taken(devices: Devices, plan: Plan, pattern: Pattern) -> LinearImage:
    devices.projector.show(plan.projector.raster(pattern, devices.projector.resolution))
    frame = devices.camera.capture(plan.camera.settings)
    if frame.media_type in PICTURE_TYPES:
        return decode_picture(frame.data, "srgb" if frame.media_type == "image/jpeg" else "linear")
    return decode_raw(frame.data)
