"""Calibration of the whole optical path on a flat matte board: contrast against pitch."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from acquire.calibrating.finding import Finding, Plot, Setting
from acquire.calibrating.light import References, Viewer
from acquire.calibrating.plots import curves_plot, points_plot
from acquire.errors import ProfileError
from acquire.plan import Plan, ProfileKind
from acquire.plan_file import BLACK, WHITE
from acquire.profile_file import COLOURS, Curve, Quantity, numbers
from acquire.session import Session
from calibration.contrast import USABLE, CheckerContrast, Contrast, fit_contrast
from processing.patterns import Family, Pattern

PITCHES_PX = (4, 8, 12, 16, 24, 32, 48)
DOWN, RIGHT = 8, 4
BLOCKS = 4
WARNED_UNEVEN = 0.1


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
            for down in range(DOWN):
                for right in range(RIGHT):
                    shift = (2 * pitch_px * down // DOWN, pitch_px * right // RIGHT)
                    patterns.append(Pattern(Family.CHECKER, pitch_px, *shift))
            patterns += [WHITE, BLACK]
        return Plan(camera=setting.camera, projector=setting.projector, patterns=tuple(patterns))

    def fit(self, sessions: Sequence[Session], frame_done: Callable[[], None]) -> Finding:
        """Harmonics of every pitch, one pitch held at a time."""
        viewer = Viewer(sessions[0], frame_done)
        seen = viewer.references()
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
        lamp = float(np.ptp(seen.white_levels.sum(axis=1)) / seen.white_levels.sum(axis=1).mean())
        return _finding(found, np.array(blocks), lamp)


def _contrast(viewer: Viewer, pitch_px: int, seen: References) -> CheckerContrast:
    frames = [f for f in viewer.all_of(Family.CHECKER) if f.pattern.pitch_px == pitch_px]
    shifts = {(f.pattern.shift_y_px, f.pattern.shift_x_px) for f in frames}
    if len(shifts) != DOWN * RIGHT or len(frames) != len(shifts):
        raise ProfileError(
            f"{viewer.session.folder}: pitch {pitch_px} has {len(frames)} frames, not the "
            f"{DOWN} × {RIGHT} shifts of `lumisplit calibrate board`."
        )
    height, width, colours = seen.white.shape
    contrast = CheckerContrast(pitch_px, (height, width, colours))
    for frame, image in viewer.images(frames):
        shift = frame.pattern.shift_y_px, frame.pattern.shift_x_px
        contrast.add(image.values - seen.black, shift)
    return contrast


def _finding(found: Contrast, blocks: NDArray[np.float64], lamp: float) -> Finding:
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
        warnings=tuple(_warnings(found, blocks, lamp)),
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
    fine = np.linspace(found.pitch_px.min(), found.pitch_px.max(), 100)
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
