"""Calibration of the whole optical path on a flat matte board: contrast against pitch.

Frames that were captured by its own plan are correlated with the checker. Others, of an imported
stack or of the scene's plan, tell the contrast by complementary pairs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from acquire.calibrating.finding import Finding, Plot, Setting
from acquire.calibrating.light import References, Viewer
from acquire.calibrating.pairs import STRIPES, Paired, paired
from acquire.calibrating.plots import curves_plot, points_plot
from acquire.plan import Plan, ProfileKind
from acquire.plan_file import BLACK, WHITE
from acquire.profile_file import COLOURS, Curve, Quantity, numbers
from acquire.session import FrameRecord, Session
from calibration.contrast import USABLE, CheckerContrast, Contrast, fit_contrast
from processing.patterns import Family, Pattern, shift_grid

PITCHES_PX = (4, 8, 12, 16, 24, 32, 48)
DOWN, RIGHT = 8, 4
BLOCKS = 4
WARNED_UNEVEN = 0.1
WARNED_GAIN = 0.02
WARNED_MISFIT = 0.05


@dataclass(frozen=True, slots=True)
class BoardCalibration:
    """Checkers at every eighth of a period on a flat matte board."""

    kind: ProfileKind = "board"
    purpose: str = (
        "modulation against pitch, which separation is freed from; a flat matte board that fills "
        "the picture, at the distance and focus of the scene"
    )

    def plan(self, setting: Setting, sessions: Sequence[Session]) -> Plan | None:
        """White and black around each pitch, whose shifts divide it evenly."""
        if sessions:
            return None
        patterns = [WHITE, WHITE, BLACK, BLACK]
        for pitch_px in PITCHES_PX:
            if pitch_px > min(setting.resolution) // 2:
                continue
            shifts = shift_grid(pitch_px, (DOWN, RIGHT))
            patterns += [Pattern(Family.CHECKER, pitch_px, *shift) for shift in shifts]
            patterns += [WHITE, BLACK]
        return Plan(camera=setting.camera, projector=setting.projector, patterns=tuple(patterns))

    def fit(self, sessions: Sequence[Session], frame_done: Callable[[], None]) -> Finding:
        """Harmonics of every pitch, one pitch held at a time."""
        viewer = Viewer(sessions[0], frame_done)
        seen = viewer.references()
        if not _is_own_plan(sessions[0].frames):
            return _of_pairs(paired(viewer, seen, BLOCKS), _lamp(seen))
        pitches = sorted({f.pattern.pitch_px for f in viewer.all_of(Family.CHECKER)})
        modulation, extremes, blocks = [], [], []
        for pitch_px in pitches:
            contrast = _contrast(viewer, pitch_px, seen)
            modulation.append(contrast.modulation(seen.light, seen.usable))
            extremes.append(contrast.extremes(seen.light, seen.usable))
            blocks.append(contrast.blocks(seen.light, seen.usable, BLOCKS))
        found = fit_contrast(
            np.array(pitches, np.float64), np.array(modulation), np.array(extremes)
        )
        return _finding(found, np.array(blocks), _lamp(seen), ())


def _is_own_plan(frames: Sequence[FrameRecord]) -> bool:
    """Whether every pitch of checkers has the shifts of `BoardCalibration.plan`, each once."""
    shifts: dict[int, list[tuple[int, int]]] = {}
    for pattern in (frame.pattern for frame in frames):
        if pattern.family is Family.CHECKER:
            shift = pattern.shift_y_px, pattern.shift_x_px
            shifts.setdefault(pattern.pitch_px, []).append(shift)
    return bool(shifts) and all(
        sorted(found) == sorted(shift_grid(pitch_px, (DOWN, RIGHT)))
        for pitch_px, found in shifts.items()
    )


def _lamp(seen: References) -> float:
    """Range of white over the capture, part of its mean."""
    levels = seen.white_levels.sum(axis=1)
    return float(np.ptp(levels) / levels.mean())


def _of_pairs(told: Paired, lamp: float) -> Finding:
    found = fit_contrast(told.pitch_px, told.modulation, told.extremes)
    warnings = []
    if max(abs(gain - 1) for gain in told.gains) > WARNED_GAIN:
        low, high = (100 * (gain - 1) for gain in told.gains)
        warnings.append(
            f"Pairs of complements miss white by {low:+.1f} to {high:+.1f} %: exposure, gain or "
            "lamp changed. Each pair's contrast is taken in its own light; fractions of light "
            "that was captured like that are off by as much."
        )
    if told.ways in {(way,) for way in STRIPES}:
        warnings.append(
            f"Only {told.ways[0]} tell of two pitches: blur in the other direction is taken to be "
            "the same."
        )
    elif told.ways == STRIPES:
        found = replace(found, skew_px2=np.zeros_like(found.skew_px2))
    return _finding(found, told.blocks, lamp, warnings)


def _contrast(viewer: Viewer, pitch_px: int, seen: References) -> CheckerContrast:
    frames = [f for f in viewer.all_of(Family.CHECKER) if f.pattern.pitch_px == pitch_px]
    height, width, colours = seen.white.shape
    contrast = CheckerContrast(pitch_px, (height, width, colours))
    for frame, image in viewer.images(frames):
        shift = frame.pattern.shift_y_px, frame.pattern.shift_x_px
        contrast.add(image.values - seen.black, shift)
    return contrast


def _finding(
    found: Contrast, blocks: NDArray[np.float64], lamp: float, warnings: Sequence[str]
) -> Finding:
    columns = {"pitch_px": numbers(found.pitch_px)}
    for k, name in enumerate(COLOURS):
        columns |= {
            f"modulation_{name}": numbers(found.modulation.mean(axis=1)[:, k]),
            f"extremes_{name}": numbers(found.extremes[:, k]),
            f"misfit_{name}": numbers(found.misfit[:, k]),
        }
    contrast = Curve(
        meaning="modulation of the checker's fundamental, direct fraction by max/min, and "
        "what the Gaussian misses the modulation by",
        columns=columns,
    )
    return Finding(
        quantities=_quantities(found),
        curves={"contrast": contrast},
        maps={"modulation_blocks": blocks},
        warnings=(*warnings, *_warnings(found, blocks, lamp)),
        plots=_plots(found),
    )


def _warnings(found: Contrast, blocks: NDArray[np.float64], lamp: float) -> Iterator[str]:
    telling = int(np.argmin(np.abs(np.nanmean(blocks, axis=(1, 2)) - 0.5)))
    uneven = float(np.nanmax(blocks[telling]) - np.nanmin(blocks[telling]))
    if uneven > WARNED_UNEVEN:
        yield (
            f"At pitch {found.pitch_px[telling]:g} px the modulation differs by {uneven:.0%} over "
            "the picture: the board is tilted or the focus uneven. One curve is used for all of it."
        )
    missed = np.abs(found.misfit)
    if missed.max() > WARNED_MISFIT:
        worst, colour = np.unravel_index(missed.argmax(), missed.shape)
        yield (
            f"At pitch {found.pitch_px[worst]:g} px the modulation in {COLOURS[colour]} is off "
            f"what blur alone would leave by {found.misfit[worst, colour]:+.0%} of white: the "
            "board scatters light below its surface, is not flat, or is lit by what stands around "
            "it. Use a matte opaque board, or take the curve as that of this object."
        )
    if lamp > 0.01:
        yield f"White changed by {lamp:.1%} during the capture; contrast is off by as much."


def _quantities(found: Contrast) -> dict[str, Quantity]:
    return {
        "side_px2": Quantity(
            meaning="variance a side of the Gaussian blur that comes nearest, each colour",
            unit="projector px²",
            value=numbers(found.side_px2),
            uncertainty=numbers(found.side_deviation_px2),
        ),
        "skew_px2": Quantity(
            meaning="covariance between rows and columns of the same blur",
            unit="projector px²",
            value=numbers(found.skew_px2),
        ),
        "finest_px": Quantity(
            meaning=f"finest pitch that keeps {USABLE:.0%} of its modulation in every colour",
            unit="projector px",
            value=(found.finest_px,),
        ),
        "misfit": Quantity(
            meaning="modulation that the Gaussian misses, root mean square over the pitches",
            unit="",
            value=numbers(np.sqrt(np.mean(found.misfit**2, axis=0))),
            role="residual",
        ),
    }


def _plots(found: Contrast) -> tuple[Plot, ...]:
    mean = found.modulation.mean(axis=1)
    fine = np.geomspace(found.pitch_px.min(), found.pitch_px.max(), 100)
    fitted = np.exp(-((np.pi / fine[:, np.newaxis]) ** 2) * found.side_px2)
    return (
        Plot(
            "Modulation against pitch",
            curves_plot(found.pitch_px, mean, fine, fitted, "pitch in projector px", "modulation"),
            f"Points: measured; lines: the Gaussian blur that comes nearest. Below 30 %, finer "
            f"than {found.finest_px:.1f} px here, contrast is mostly noise.",
        ),
        Plot(
            "What the Gaussian misses",
            points_plot(found.pitch_px, 100 * found.misfit, "pitch in projector px", "%"),
            "Measured less fitted modulation.",
        ),
    )
