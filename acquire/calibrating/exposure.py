"""Calibration of the exposure: few shots, each at a time that the one before suggested."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from acquire.calibrating.finding import Finding, Plot, Setting
from acquire.calibrating.light import Viewer
from acquire.calibrating.plots import points_plot
from acquire.errors import ProfileError
from acquire.plan import Plan, ProfileKind
from acquire.plan_file import BLACK, WHITE
from acquire.profile_file import COLOURS, Quantity, numbers
from acquire.session import Session
from calibration.errors import UnsupportedError
from calibration.exposure import BRIGHT_PERCENTILE, Exposure, advise, signal_rate
from processing.patterns import Family, Pattern

Array = NDArray[np.float64]
MAX_TRIALS = 6
TRIAL_FRAMES = 4
REPEATS = 8
SATURATED_FRACTION = 1e-3
LONGER, SHORTER = 8.0, 0.2
WARNED_FLICKER = 0.005


@dataclass(frozen=True, slots=True)
class ExposureCalibration:
    """Trials of white and black, then a series at the time advised to see flicker."""

    kind: ProfileKind = "exposure"
    purpose: str = (
        "the exposure time that puts the brightest lit pixels at a fraction of saturation, and "
        "how much the light flickers at it; the scene itself"
    )
    fraction: float = 0.8
    refresh_hz: float = 60.0

    def plan(self, setting: Setting, sessions: Sequence[Session]) -> Plan | None:
        """Another trial until one is neither saturated nor dark, then the series."""
        if not sessions:
            return self._at(setting, setting.camera.exposure_s, (WHITE, WHITE, BLACK, BLACK))
        last = sessions[-1]
        if len(last.plan) > TRIAL_FRAMES:
            return None
        trial = _Trial.of(last)
        if trial.saturated and len(sessions) < MAX_TRIALS:
            return self._at(setting, trial.exposure_s * SHORTER, (WHITE, WHITE, BLACK, BLACK))
        rise = float(np.max(trial.bright - trial.dark))
        if not trial.saturated and rise < 0.05 and len(sessions) < MAX_TRIALS:
            return self._at(setting, trial.exposure_s * LONGER, (WHITE, WHITE, BLACK, BLACK))
        advice = self._advice(trial, 0.0)
        return self._at(setting, advice.exposure_s, (*(WHITE,) * REPEATS, BLACK, BLACK))

    def _at(self, setting: Setting, exposure_s: float, patterns: tuple[Pattern, ...]) -> Plan:
        camera = setting.camera.model_copy(update={"exposure_s": exposure_s})
        return Plan(camera=camera, projector=setting.projector, patterns=patterns)

    def _advice(self, trial: _Trial, flicker: float) -> Exposure:
        if trial.saturated:
            raise UnsupportedError(
                f"the scene saturates even at {trial.exposure_s:g} s: stop the lens down or lower "
                "the ISO"
            )
        rate = signal_rate(trial.bright, trial.dark, trial.exposure_s)
        dark = np.minimum(trial.dark, 0.5 * self.fraction)
        return advise(rate, dark, self.fraction, self.refresh_hz, flicker)

    def fit(self, sessions: Sequence[Session], frame_done: Callable[[], None]) -> Finding:
        """Advice from the series, the flicker from its scatter."""
        trial = _Trial.of(sessions[-1], frame_done)
        levels = trial.levels
        if len(levels) < 2:
            raise ProfileError(
                f"{sessions[-1].folder} holds no series of white frames; it was captured for "
                "something else."
            )
        whole = levels.sum(axis=1) - trial.dark_level.sum()
        flicker = float(whole.std(ddof=1) / whole.mean())
        found = self._advice(trial, flicker)
        steps = np.arange(len(levels), dtype=float)
        return Finding(
            quantities=_quantities(found, self.fraction),
            warnings=tuple(_warnings(found, self.fraction)),
            plots=(
                Plot(
                    "Light of equal frames",
                    points_plot(
                        steps, 100 * (levels / levels.mean(axis=0) - 1), "frame", "% of the mean"
                    ),
                    "Frames of the same white at the same exposure: what differs is flicker, of "
                    "the lamp or of a colour wheel that the exposure does not see whole.",
                ),
            ),
        )


@dataclass(frozen=True, slots=True)
class _Trial:
    """Brightest pixels and mean level of white, of one short session; (colours,) each."""

    exposure_s: float
    bright: Array
    dark: Array
    saturated: bool
    levels: Array
    dark_level: Array

    @classmethod
    def of(cls, session: Session, frame_done: Callable[[], None] = lambda: None) -> _Trial:
        # The first of equal frames may still hold the light before it.
        viewer = Viewer(session, frame_done, steady=False)
        black, _ = viewer.mean(viewer.all_of(Family.BLACK)[1:])
        bright, levels, saturated = [], [], 0.0
        for _, image in viewer.images(viewer.all_of(Family.WHITE)[1:]):
            bright.append(np.percentile(image.values, BRIGHT_PERCENTILE, axis=(0, 1)))
            levels.append(image.values.mean(axis=(0, 1), dtype=np.float64))
            saturated = max(saturated, float(image.saturated.mean()))
        return cls(
            exposure_s=session.plan.camera.exposure_s,
            bright=np.mean(bright, axis=0),
            dark=np.asarray(np.percentile(black, BRIGHT_PERCENTILE, axis=(0, 1)), np.float64),
            saturated=saturated > SATURATED_FRACTION,
            levels=np.array(levels),
            dark_level=black.mean(axis=(0, 1), dtype=np.float64),
        )


def _quantities(found: Exposure, fraction: float) -> dict[str, Quantity]:
    error = found.colours_s * found.flicker
    return {
        "exposure_s": Quantity(
            meaning=f"puts the brightest pixels at {fraction:.0%} of saturation or just below",
            unit="s",
            value=(found.exposure_s,),
            uncertainty=(float(error.min()),),
        ),
        "refreshes": Quantity(
            meaning="refreshes of the projector in it", unit="", value=(float(found.refreshes),)
        ),
        "colours_s": Quantity(
            meaning="what would bring each colour there by itself",
            unit="s",
            value=numbers(found.colours_s),
            uncertainty=numbers(error),
        ),
        "expected_signal": Quantity(
            meaning="brightest pixels at that exposure",
            unit="fraction of the sensor's range",
            value=numbers(found.expected_signal),
        ),
        "flicker": Quantity(
            meaning="relative scatter of equal frames",
            unit="",
            value=(found.flicker,),
            role="residual",
        ),
    }


def _warnings(found: Exposure, fraction: float) -> list[str]:
    warnings = []
    if found.flicker > WARNED_FLICKER:
        warnings.append(
            f"Equal frames differ by {found.flicker:.1%}: the light flickers within the exposure. "
            "Give the projector's true refresh with --refresh, or stop the lens down and expose "
            "longer, so that more refreshes are averaged."
        )
    brightest = found.expected_signal.max()
    warnings += [
        f"{name} reaches only {signal:.0%} of the range when another colour is at "
        f"{brightest:.0%}: its noise is larger."
        for name, signal in zip(COLOURS, found.expected_signal, strict=True)
        if signal < 0.5 * brightest
    ]
    if found.expected_signal.max() < 0.75 * fraction:
        warnings.append(
            f"Whole refreshes are coarse here: {found.refreshes} of them reach "
            f"{found.expected_signal.max():.0%}. Stop the lens down for a finer choice."
        )
    return warnings
