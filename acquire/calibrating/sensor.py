"""Calibrations of the camera: dark frames and photon transfer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from acquire.calibrating.finding import Finding, Plot, Setting
from acquire.calibrating.light import Viewer
from acquire.calibrating.plots import histogram_plot, noise_plot, points_plot
from acquire.errors import ProfileError
from acquire.plan import Plan, ProfileKind
from acquire.plan_file import BLACK, WHITE
from acquire.profile_file import COLOURS, Curve, Quantity, numbers
from acquire.session import Session, Transfer
from calibration.dark import Dark, DarkFrames
from calibration.photon_transfer import (
    Linearity,
    NoiseLine,
    TransferPairs,
    TransferPoints,
    fit_linearity,
    fit_noise_line,
)
from drivers.raw import counts_in_range
from processing.patterns import Family

RANGE = "fraction of the sensor's range"
SQUARED = RANGE + ", squared"
# A decoded green value is the mean of two photosites.
PHOTOSITES = np.array([1.0, 2.0, 1.0])
ROUNDING = 1 / 12
BLOCK_PX = 8
WARNED_HOT_PIXELS = 0.001
WARNED_CHI_SQUARE = 3.0


@dataclass(frozen=True, slots=True)
class DarkCalibration:
    """Dark frames at the plan's exposure."""

    kind: ProfileKind = "dark"
    purpose: str = (
        "black level, read noise and hot pixels at the plan's exposure; put the cap on the lens"
    )
    frames: int = 16

    def plan(self, setting: Setting, sessions: Sequence[Session]) -> Plan | None:
        """Black frames alone."""
        if sessions:
            return None
        return Plan(
            camera=setting.camera, projector=setting.projector, patterns=(BLACK,) * self.frames
        )

    def fit(self, sessions: Sequence[Session], frame_done: Callable[[], None]) -> Finding:
        """Mean and scatter over time of every pixel."""
        viewer = Viewer(sessions[0], frame_done)
        frames = DarkFrames()
        for _, image in viewer.images(viewer.all_of(Family.BLACK)):
            frames.add(image.values)
        return _dark_finding(frames.fit())


def _dark_finding(found: Dark) -> Finding:
    hot = int(found.hot.sum())
    warnings = []
    if hot > WARNED_HOT_PIXELS * found.hot.size:
        warnings.append(f"{hot} of {found.hot.size} pixels are hot; a cooler sensor has fewer.")
    return Finding(
        quantities={
            "black_level": _quantity(
                "median level without light, after the black level the camera states",
                RANGE,
                found.level,
                found.level_deviation,
            ),
            "read_noise": _quantity(
                "standard deviation of a decoded value without light",
                RANGE,
                found.read_noise,
                found.read_noise_deviation,
            ),
            "hot_pixels": Quantity(meaning="pixels left out", unit="", value=(float(hot),)),
            "unsteadiness": Quantity(
                meaning="standard deviation over the frames of their median level",
                unit=RANGE,
                value=numbers(found.levels.std(axis=0)),
                role="residual",
            ),
        },
        curves={
            "levels": Curve(
                meaning="median level of every frame, the residual over time",
                columns={
                    "frame": numbers(np.arange(len(found.levels), dtype=float)),
                    **dict(zip(COLOURS, map(numbers, found.levels.T), strict=True)),
                },
            )
        },
        maps={"offset": found.offset, "hot": found.hot},
        warnings=tuple(warnings),
        plots=_dark_plots(found),
    )


def _dark_plots(found: Dark) -> tuple[Plot, ...]:
    steps = np.arange(len(found.levels), dtype=float)
    return (
        Plot(
            "Offsets of the pixels",
            histogram_plot(found.offset, "offset, % of the sensor's range"),
            "How far the mean of every pixel lies from the black level; hot pixels stand "
            "alone at the right.",
        ),
        Plot(
            "Black level over the frames",
            points_plot(steps, 100 * (found.levels - found.level), "frame", "% of the range"),
            "Median of every frame less the median of all: warming up would show here.",
        ),
    )


STOPS = (0.125, 0.25, 0.5, 1.0, 2.0)


@dataclass(frozen=True, slots=True)
class NoiseCalibration:
    """Photon transfer from pairs of white and black frames at five exposure times."""

    kind: ProfileKind = "noise"
    purpose: str = (
        "electrons a count, read noise, full well and linear range, from pairs of equal frames at "
        "an eighth to twice the exposure; any bright, still scene will do"
    )

    def plan(self, setting: Setting, sessions: Sequence[Session]) -> Plan | None:
        """Two blacks and four whites at each exposure time."""
        if sessions:
            return None
        at_each = (BLACK, BLACK, WHITE, WHITE, WHITE, WHITE)
        times = [stop * setting.camera.exposure_s for stop in STOPS]
        return Plan(
            camera=setting.camera,
            projector=setting.projector,
            patterns=at_each * len(times),
            exposures_s=tuple(time for time in times for _ in at_each),
        )

    def fit(self, sessions: Sequence[Session], frame_done: Callable[[], None]) -> Finding:
        """Noise line of every colour and the linear range."""
        session = sessions[0]
        viewer = Viewer(session, frame_done)
        pairs, series = TransferPairs(), _Series()
        waiting: tuple[object, NDArray[np.float32], NDArray[np.bool_]] | None = None
        for frame, image in viewer.images(session.frames):
            exposure_s = session.plan.step(frame.step).settings.exposure_s
            series.add(exposure_s, frame.pattern.family, image.values, image.saturated)
            kind = (frame.pattern, exposure_s)
            if waiting is not None and waiting[0] == kind:
                pairs.add(waiting[1], image.values, ~(waiting[2] | image.saturated))
                waiting = None
            else:
                waiting = (kind, image.values, image.saturated)
        points = pairs.points()
        lines = [fit_noise_line(colour) for colour in points]
        linear = series.linearity()
        return Finding(
            quantities=_noise_quantities(lines, linear, _counts(session)),
            curves=_noise_curves(points, lines, linear),
            warnings=tuple(_noise_warnings(lines, linear)),
            plots=_noise_plots(points, lines, linear),
        )


def _noise_curves(
    points: Sequence[TransferPoints], lines: Sequence[NoiseLine], linear: Linearity
) -> dict[str, Curve]:
    transfer = {
        name: Curve(
            meaning=f"variance against signal, {name}",
            columns={
                "signal": numbers(colour.signal),
                "variance": numbers(colour.variance),
                "residual": numbers(line.residuals),
            },
        )
        for name, colour, line in zip(COLOURS, points, lines, strict=True)
    }
    linearity = Curve(
        meaning="relative departure from proportionality to the exposure time",
        columns={"signal": numbers(linear.signal), "departure": numbers(linear.deviation)},
    )
    return transfer | {"linearity": linearity}


def _noise_plots(
    points: Sequence[TransferPoints], lines: Sequence[NoiseLine], linear: Linearity
) -> tuple[Plot, ...]:
    departure = 100 * linear.deviation[:, np.newaxis]
    return (
        Plot(
            "Photon transfer",
            noise_plot(points, lines),
            "Variance of a value against its signal; the slope is one over the electrons "
            "that fill the range, halved for green, whose values are means of two "
            "photosites.",
        ),
        Plot(
            "Linearity",
            points_plot(linear.signal, departure, "signal, fraction of the range", "departure, %"),
            "How far the signal is from proportional to the exposure time.",
        ),
    )


class _Series:
    """Means over blocks of pixels at each exposure time; white and black apart."""

    def __init__(self) -> None:
        self._sums: dict[tuple[float, Family], tuple[NDArray[np.float64], int]] = {}
        self._whole: dict[float, NDArray[np.bool_]] = {}

    def add(
        self,
        exposure_s: float,
        family: Family,
        values: NDArray[np.float32],
        saturated: NDArray[np.bool_],
    ) -> None:
        height, width = (side // BLOCK_PX * BLOCK_PX for side in saturated.shape)
        shape = (height // BLOCK_PX, BLOCK_PX, width // BLOCK_PX, BLOCK_PX)
        means = values[:height, :width].reshape(*shape, 3).mean(axis=(1, 3), dtype=np.float64)
        reached = saturated[:height, :width].reshape(shape)
        whole = np.logical_not(np.any(reached, axis=(1, 3)))
        total, count = self._sums.get((exposure_s, family), (np.zeros_like(means), 0))
        self._sums[exposure_s, family] = (total + means, count + 1)
        self._whole[exposure_s] = self._whole.get(exposure_s, whole) & whole

    def linearity(self) -> Linearity:
        times = sorted(self._whole)
        if any((time, family) not in self._sums for time in times for family in REFERENCES):
            raise ProfileError(
                "The session lacks white or black frames at some exposure time; it was captured "
                "for something else."
            )
        signals, usable = [], []
        for time in times:
            white, black = (self._sums[time, family] for family in REFERENCES)
            signals.append((white[0] / white[1] - black[0] / black[1]).ravel())
            usable.append(np.repeat(self._whole[time].ravel(), 3))
        return fit_linearity(times, np.array(signals), np.array(usable))


REFERENCES = (Family.WHITE, Family.BLACK)


def _counts(session: Session) -> float | None:
    """Counts between black and white level; None for pictures, whose counts mean nothing."""
    if session.record.source is not None and session.record.source.transfer is not Transfer.RAW:
        return None
    return counts_in_range(session.read(session.frames[0]))


def _noise_quantities(
    lines: Sequence[NoiseLine], linear: Linearity, counts: float | None
) -> dict[str, Quantity]:
    constant = np.array([line.constant for line in lines])
    rise = np.array([line.rise for line in lines])
    constant_error, rise_error = np.sqrt([np.diag(line.covariance) for line in lines]).T
    electrons = 1 / (rise * PHOTOSITES)
    relative = rise_error / rise
    rounding = 0.0 if counts is None else ROUNDING / counts**2
    read_e = np.sqrt(np.maximum(constant * PHOTOSITES - rounding, 0)) * electrons
    # σ = N √v: its error is N² δv / (2σ).
    read_error = electrons**2 * constant_error * PHOTOSITES / (2 * np.maximum(read_e, 1e-9))
    found = {
        "constant": _quantity("variance of a decoded value without light", SQUARED, constant),
        "rise": _quantity("rise of that variance with the signal", RANGE, rise, rise_error),
        "electrons_in_range": _quantity(
            "full well: electrons of a photosite from black to white level",
            "e",
            electrons,
            relative * electrons,
        ),
        "read_noise_e": _quantity(
            "read noise of a photosite", "e", read_e, np.where(read_e > 0, read_error, np.nan)
        ),
        "reduced_chi_square": Quantity(
            meaning="misfit of the line per degree of freedom, about 1 where it holds",
            unit="",
            value=numbers([line.reduced_chi_square for line in lines]),
            role="residual",
        ),
        "linear_to": _quantity(
            f"signal up to which the camera is linear within {linear.tolerance:.0%}",
            RANGE,
            np.array([linear.linear_to]),
        ),
        "reached": _quantity(
            "brightest signal that was measured unsaturated", RANGE, np.array([linear.reached])
        ),
    }
    if counts is not None:
        found["electrons_per_count"] = _quantity(
            "gain of the camera", "e a count", electrons / counts, relative * electrons / counts
        )
    return found


def _quantity(
    meaning: str,
    unit: str,
    value: NDArray[np.float64],
    error: NDArray[np.float64] | None = None,
) -> Quantity:
    uncertainty = None if error is None else numbers(error)
    return Quantity(meaning=meaning, unit=unit, value=numbers(value), uncertainty=uncertainty)


def _noise_warnings(lines: Sequence[NoiseLine], linear: Linearity) -> list[str]:
    warnings = []
    worst = max(line.reduced_chi_square for line in lines)
    if worst > WARNED_CHI_SQUARE:
        warnings.append(
            f"The variance does not follow a line (χ² of {worst:.1f} a degree of freedom): the "
            "lamp flickers, something moved, or the camera processes its raw files."
        )
    if linear.linear_to < linear.reached:
        warnings.append(
            f"The camera is linear within {linear.tolerance:.0%} only up to "
            f"{linear.linear_to:.0%} of its range: keep white below."
        )
    return warnings
