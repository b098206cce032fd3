"""Calibrations of the projector: leak and response."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from acquire.calibrating.finding import Finding, Plot, Setting
from acquire.calibrating.light import References, Viewer
from acquire.calibrating.plots import curves_plot, histogram_plot, points_plot
from acquire.errors import ProfileError
from acquire.plan import Plan, ProfileKind
from acquire.plan_file import BLACK, WHITE
from acquire.profile_file import COLOURS, Curve, Quantity, numbers
from acquire.session import Session
from calibration.projector import leak_map, measure_leak, white_excess
from calibration.response import LEVELS, Response, fit_response
from processing.patterns import Family, Pattern

_TWICE = (WHITE, WHITE, BLACK, BLACK)
WARNED_LEAK_SPREAD = 0.02
WARNED_ADDITIVITY = 0.02
WARNED_DRIFT = 0.005
# Of a response: what the curve or a gamma leaves unexplained.
RESIDUALS = {"level_deviation", "power_misfit"}


@dataclass(frozen=True, slots=True)
class LeakCalibration:
    """Light of the projector's dark pixels."""

    kind: ProfileKind = "leak"
    purpose: str = "b, the light of a dark projector pixel over that of a lit one; darken the room"
    repeats: int = 2

    def plan(self, setting: Setting, sessions: Sequence[Session]) -> Plan | None:
        """White and black in turn, each twice, so that what has not settled is seen."""
        if sessions:
            return None
        return Plan(
            camera=setting.camera,
            projector=setting.projector,
            patterns=_TWICE * self.repeats,
        )

    def fit(self, sessions: Sequence[Session], frame_done: Callable[[], None]) -> Finding:
        """B of every pixel and of all."""
        seen = Viewer(sessions[0], frame_done).references()
        leak = measure_leak(seen.white, seen.black, seen.usable)
        each = leak_map(seen.white, seen.black, seen.usable)
        count = 3 * int(seen.usable.sum())
        warnings = []
        if leak.spread > max(WARNED_LEAK_SPREAD, leak.fraction):
            warnings.append(
                f"b differs by ±{leak.spread:.1%} over the picture, and a projector's does not: "
                "light of the room is in it, or the frames are too dark. Darken the room."
            )
        known = each[np.isfinite(each)].reshape(-1, 1)
        return Finding(
            quantities={
                "leak": Quantity(
                    meaning="b, median over pixels and colours; an upper bound, as light of the "
                    "room counts as leak",
                    unit="fraction of white",
                    value=(leak.fraction,),
                    # Of a median of normal values: √(π/2) times that of the mean.
                    uncertainty=(float(np.sqrt(np.pi / 2 / count)) * leak.spread,),
                ),
                "spread": Quantity(
                    meaning="half the distance between the 16th and 84th percentile",
                    unit="fraction of white",
                    value=(leak.spread,),
                    role="residual",
                ),
            },
            maps={"leak": each},
            warnings=tuple(warnings),
            plots=(
                Plot(
                    "Leak of the pixels",
                    histogram_plot(known, "b, %"),
                    "A projector leaks alike everywhere: what is spread out is noise and room "
                    "light.",
                ),
            ),
        )


@dataclass(frozen=True, slots=True)
class ResponseCalibration:
    """Ramps of grey, red, green and blue seen by the linear camera."""

    kind: ProfileKind = "response"
    purpose: str = (
        "light of every level a colour, so that sinusoids come out as sinusoids; a bright, matte, "
        "still scene in a dark room"
    )
    steps: int = 32

    def plan(self, setting: Setting, sessions: Sequence[Session]) -> Plan | None:
        """White and black around each ramp."""
        if sessions:
            return None
        patterns = [*_TWICE]
        for colour in range(-1, 3):
            for level in self._levels():
                levels = (level,) if colour < 0 else tuple(level * (k == colour) for k in range(3))
                patterns.append(Pattern(Family.UNIFORM, levels=levels))
            patterns += _TWICE
        projector = setting.projector.model_copy(update={"light": None})
        return Plan(camera=setting.camera, projector=projector, patterns=tuple(patterns))

    def _levels(self) -> list[int]:
        return [round(k * (LEVELS - 1) / self.steps) for k in range(self.steps + 1)]

    def fit(self, sessions: Sequence[Session], frame_done: Callable[[], None]) -> Finding:
        """A monotone curve for grey and for each colour."""
        viewer = Viewer(sessions[0], frame_done)
        seen = viewer.references()
        ramps, lamp, excess = _ramps(viewer, seen)
        deviation = float(np.std(lamp, ddof=1) / np.sqrt(2)) if len(lamp) > 1 else 0.0
        fitted = {}
        for name, (levels, light, channel) in ramps.items():
            scale = float(seen.white_levels[:, channel].mean())
            fitted[name] = fit_response(levels, light, max(deviation, 1e-6) * scale)
        missed = _additivity(ramps)
        return _response_finding(ramps, fitted, seen, (missed, excess), float(np.ptp(lamp)))


Ramp = tuple[NDArray[np.int64], NDArray[np.float64], int]


def _ramps(viewer: Viewer, seen: References) -> tuple[dict[str, Ramp], NDArray[np.float64], float]:
    """Light of each ramp in the channel that sees it best, freed from the lamp's drift.

    With it the lamp, relative, and `calibration.projector.white_excess`.
    """
    lamp_at, lamp, black_at, black = [], [], [], []
    found: dict[str, dict[int, tuple[int, NDArray[np.float64]]]] = {}
    for frame, image in viewer.images(viewer.session.frames):
        level = image.values[seen.usable].mean(axis=0, dtype=np.float64)
        pattern = frame.pattern
        if pattern.family is Family.WHITE:
            lamp_at.append(frame.step)
            lamp.append(level)
        elif pattern.family is Family.BLACK:
            black_at.append(frame.step)
            black.append(level)
        elif pattern.family is Family.UNIFORM:
            for name, told in _ramps_of(pattern):
                found.setdefault(name, {})[told] = (frame.step, level)
    dark = np.mean(black, axis=0)
    relative = np.array(lamp).sum(axis=1) - dark.sum()
    relative /= relative.mean()
    ramps: dict[str, Ramp] = {}
    brightest = {}
    for name in ("grey", *COLOURS):
        if name not in found or not {0, LEVELS - 1} <= found[name].keys():
            raise ProfileError(
                f"{viewer.session.folder} holds no ramp of {name} from 0 to 255; it was captured "
                "for something else."
            )
        levels = np.array(sorted(found[name]))
        steps = np.array([found[name][level][0] for level in levels])
        light = np.array([found[name][level][1] for level in levels]) - dark
        light /= np.interp(steps, lamp_at, relative)[:, np.newaxis]
        brightest[name] = light[-1]
        channel = int(np.argmax(light[-1]))
        ramps[name] = (levels, light[:, channel], channel)
    primaries = np.array([brightest[name] for name in COLOURS])
    return ramps, relative, white_excess(brightest["grey"], primaries)


def _ramps_of(pattern: Pattern) -> list[tuple[str, int]]:
    """The ramps that a uniform level is part of: a grey level, or one colour on black."""
    levels = pattern.levels
    if len(levels) == 1:
        return [("grey", levels[0])]
    lit = [k for k in range(3) if levels[k]]
    if not lit:
        return [(name, 0) for name in COLOURS]
    return [(COLOURS[lit[0]], levels[lit[0]])] if len(lit) == 1 else []


def _additivity(ramps: dict[str, Ramp]) -> float:
    """Largest relative miss of the curves of colours from grey's, seen in the grey's channel.

    A white segment of a colour wheel adds light to grey that no colour has: grey then follows
    another curve than its colours.
    """
    grey = ramps["grey"][1] / ramps["grey"][1][-1]
    shared = [ramps[name][1] / ramps[name][1][-1] for name in COLOURS]
    own = COLOURS[ramps["grey"][2]]
    own_curve = shared[COLOURS.index(own)]
    return float(np.abs(grey - own_curve).max()) if grey.shape == own_curve.shape else np.nan


def _response_finding(
    ramps: dict[str, Ramp],
    fitted: dict[str, Response],
    seen: References,
    misses: tuple[float, float],
    drift: float,
) -> Finding:
    missed, excess = misses
    colours = [fitted[name] for name in COLOURS]
    white, black = (image[seen.usable].mean(dtype=np.float64) for image in (seen.white, seen.black))
    separable = missed <= WARNED_ADDITIVITY
    used = colours if separable else [fitted["grey"]] * 3
    warnings = []
    if abs(excess) > WARNED_ADDITIVITY:
        warnings.append(
            f"White is {abs(excess):.1%} {'more' if excess > 0 else 'less'} light than red, green "
            "and blue together: the projector adds a white segment or alters colours (brilliant "
            "colour, dynamic modes). Turn that off; coloured patterns do not add up otherwise."
        )
    if not separable:
        warnings.append(
            f"Grey does not follow its colours (off by {missed:.1%} of white): the projector adds "
            "white light of its own. Sinusoids, which are grey, use the curve of grey; switch "
            "'brilliant colour' and the like off."
        )
    if drift > WARNED_DRIFT:
        warnings.append(f"The lamp changed by {drift:.1%} during the ramps; it was corrected for.")
    for name, one in zip(COLOURS, used, strict=True):
        if one.saturated_from < LEVELS - 8:
            warnings.append(
                f"{name} gets no brighter above level {one.saturated_from}: lower the projector's "
                "contrast setting."
            )
    told = np.arange(LEVELS)
    columns = {"level": numbers(told)} | {
        name: numbers(one.light) for name, one in zip(COLOURS, used, strict=True)
    }
    measured = {
        name: Curve(
            meaning=f"ramp of {name}, light of level 0 taken off, over that of level 255",
            columns={
                "level": numbers(ramps[name][0]),
                "light": numbers(one.light[ramps[name][0]] + one.residuals),
                "residual": numbers(one.residuals),
            },
        )
        for name, one in fitted.items()
    }
    return Finding(
        quantities=_response_quantities(used, float(black / white)),
        curves={"light": Curve(meaning="light of every level", columns=columns), **measured},
        warnings=tuple(warnings),
        plots=_response_plots(ramps, fitted),
    )


def _response_quantities(used: Sequence[Response], offset: float) -> dict[str, Quantity]:
    fields: dict[str, tuple[str, str, list[float], list[float] | None]] = {
        "gamma": (
            "exponent of the power that comes nearest", "",
            [one.gamma for one in used], [one.gamma_deviation for one in used],
        ),
        "offset": ("light of level 0, room light included", "fraction of white", [offset], None),
        "cut": ("level at which that power begins", "level", [one.cut for one in used], None),
        "saturation": (
            "lowest level with 99.8 % of all light", "level",
            [float(one.saturated_from) for one in used], None,
        ),
        "level_deviation": (
            "standard error of a level's light", "fraction of white",
            [one.deviation for one in used], None,
        ),
        "power_misfit": (
            "what a gamma would miss", "fraction of white",
            [one.power_misfit for one in used], None,
        ),
    }  # fmt: skip
    return {
        name: Quantity(
            meaning=meaning,
            unit=unit,
            value=numbers(value),
            uncertainty=None if error is None else numbers(error),
            role="residual" if name in RESIDUALS else "found",
        )
        for name, (meaning, unit, value, error) in fields.items()
    }


def _response_plots(ramps: dict[str, Ramp], fitted: dict[str, Response]) -> tuple[Plot, ...]:
    levels = ramps["red"][0].astype(float)
    light = np.stack([fitted[name].light for name in COLOURS], axis=1)
    residuals = np.stack([fitted[name].residuals for name in COLOURS], axis=1)
    shown = light[ramps["red"][0]] + residuals
    return (
        Plot(
            "Response",
            curves_plot(
                levels, shown, np.arange(LEVELS, dtype=float), light, "level", "light over white"
            ),
            "Points: measured; lines: the monotone curves that sinusoids are inverted with.",
        ),
        Plot(
            "Residuals",
            points_plot(levels, 100 * residuals, "level", "% of white"),
            "Measured less fitted: what had to be bent to make the curve rise everywhere.",
        ),
    )
