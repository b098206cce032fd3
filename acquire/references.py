"""What the white and black frames of a session say: full light, darkness, and their drift."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from acquire.exposure_record import ExposureRecord
from acquire.exposures import Exposures
from acquire.result import DriftRecord
from acquire.session import Session
from acquire.stack import Reference, Stack
from processing.frames.drift import Course, Drift, measure_drift
from processing.frames.frame_noise import lattice
from processing.patterns import Family

Image = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Levels:
    """What every pattern frame is held against.

    Parameters
    ----------
    dark
        Mean of the black frames, float32, (height, width, 3), as at the first of them.
    lit
        White less black light, as at the first white frame.
    drift
        What is taken off every frame; None where nothing is.
    gains
        What some frames are divided by, by their place among all exposures; None where none is.
    """

    dark: Image | None
    lit: Image | None
    drift: Drift | None = None
    gains: dict[int, tuple[float, ...]] | None = None

    def of(self, order: int, width: int) -> FrameLevels:
        """What is taken off one frame.

        Parameters
        ----------
        order
            Its place among all exposures.
        width
            Of the picture, in pixels.
        """
        gains = None if self.gains is None else self.gains.get(order)
        if gains is not None:
            return FrameLevels(self.dark, None, None, _line(1 / np.array(gains), width))
        if self.drift is None:
            return FrameLevels(self.dark, None, None)
        at = np.array([order], np.float64)
        offset, gain = (trace.at(at)[0] for trace in (self.drift.offset, self.drift.gain))
        return FrameLevels(self.dark, _line(offset, width), _line(gain, width))


@dataclass(frozen=True, slots=True)
class FrameLevels:
    """What is taken off a frame, so that it is as it would have been at the first references.

    Parameters
    ----------
    dark
        As in `Levels`.
    offset, gain
        float32, (3 width,), by how much it is too high less black and too bright then, the three
        colours over and over; None where nothing drifted.
    exposure
        As these, what the frame is multiplied by before anything is taken off, dark light and all.
    """

    dark: Image | None
    offset: Image | None
    gain: Image | None
    exposure: Image | None = None

    def even(self, values: Image, at: tuple[slice, slice], out: Image) -> None:
        """Take it off some of the frame's pixels.

        Parameters
        ----------
        values
            float32, (lines, columns, 3), as decoded.
        at
            Which they are.
        out
            As `values`, in one piece of memory; written.
        """
        if self.exposure is not None:
            lines = out.reshape(len(out), -1)
            np.multiply(values.reshape(lines.shape), self.exposure[: lines.shape[1]], out=lines)
            values = out
        if self.dark is None:
            out[...] = values
        else:
            np.subtract(values, self.dark[at], out=out)
        if self.offset is not None and self.gain is not None:
            lines = out.reshape(len(out), -1)
            lines -= self.offset[: lines.shape[1]]
            lines /= self.gain[: lines.shape[1]]


@dataclass(frozen=True, slots=True)
class References:
    """The reference frames and what follows from them.

    Parameters
    ----------
    white, black
        As captured; None where the session has none.
    levels
        As the pattern frames are held against.
    record
        The drift, where there is more than one reference.
    exposures
        Of an imported stack.
    """

    white: Reference | None
    black: Reference | None
    levels: Levels
    record: DriftRecord | None
    exposures: ExposureRecord | None = None


def read_references(
    session: Session,
    stack: Stack,
    frame_done: Callable[[], None],
    exposures: Exposures | None = None,
    *,
    correct_drift: bool,
) -> References:
    """Decode the references of a session.

    Drift is corrected where it is smooth and the order of the exposures is known.

    Parameters
    ----------
    session, stack
        The frames, which lie in the session.
    frame_done
        Called after each decoded frame.
    exposures
        What is undone in the frames of an imported stack; its gains take the place of a drift.
    correct_drift
        Whether to correct at all.
    """
    black = stack.reference(Family.BLACK, frame_done)
    white = stack.reference(Family.WHITE, frame_done)
    if exposures is not None and exposures.gains is not None:
        levels = _evened(white, black, exposures)
        return References(white, black, levels, None, exposures.record)
    about = None if exposures is None else exposures.record
    drift = _drift(session, stack, white, black)
    if drift is None or white is None:
        return References(white, black, _levels(white, black, None), None, about)
    smooth = drift.course is Course.SMOOTH
    corrected = smooth and correct_drift and session.record.source is None
    record = DriftRecord(
        course=drift.course,
        corrected=corrected,
        white_order=tuple(int(order) for order in drift.gain.order),
        gain=tuple(tuple(row) for row in drift.gain.values.tolist()),
        black_order=tuple(int(order) for order in drift.offset.order),
        offset=tuple(tuple(row) for row in drift.offset.values.tolist()),
        bend=drift.bend,
        range=max(drift.gain.range, drift.offset.range / drift.light),
    )
    levels = _levels(white, black, drift.seen() if corrected else None)
    return References(white, black, levels, record, about)


def _drift(
    session: Session, stack: Stack, white: Reference | None, black: Reference | None
) -> Drift | None:
    """None where there is only one moment, or where exposures differ by intention."""
    if white is None or stack.saturated is None or session.plan.exposures_s is not None:
        return None
    if max(white.frames, black.frames if black else 0) < 2:
        return None
    usable = ~stack.saturated[lattice(stack.saturated.shape)]
    return measure_drift(white.levels, black.levels if black else (), usable)


def _levels(white: Reference | None, black: Reference | None, drift: Drift | None) -> Levels:
    """Means of the references, freed from their drift.

    With W = dark + offset + gain·light for each white frame, light is (ΣW − n·dark − Σoffset) over
    Σgain.
    """
    dark = None if black is None else black.image
    if dark is not None and black is not None and drift is not None:
        dark = dark - _mean(drift.offset.at(_orders(black)))
    if white is None:
        return Levels(dark, None, drift)
    lit = white.image - (0 if dark is None else dark)
    if drift is not None:
        lit = (lit - _mean(drift.offset.at(_orders(white)))) / _mean(drift.gain.at(_orders(white)))
    return Levels(dark, lit, drift)


def _evened(white: Reference | None, black: Reference | None, exposures: Exposures) -> Levels:
    """Means of the references at the gain of the first white frame."""
    dark = None if black is None else _divided(black.image, exposures.black)
    lit = None if white is None else _divided(white.image, exposures.white)
    if lit is not None and dark is not None:
        np.subtract(lit, dark, out=lit)
    return Levels(dark, lit, gains=exposures.gains)


def _divided(image: Image, gain: NDArray[np.float64] | None) -> Image:
    """A new image."""
    colours = np.ones(image.shape[-1]) if gain is None else gain
    return np.divide(image, colours.astype(np.float32))


def _orders(reference: Reference) -> NDArray[np.float64]:
    return np.array([level.order for level in reference.levels], np.float64)


def _mean(values: NDArray[np.float64]) -> NDArray[np.float32]:
    return np.asarray(values.mean(axis=0), np.float32)


def _line(colours: NDArray[np.float64], width: int) -> Image:
    """A number a colour as often as a line has pixels: in arithmetic with it nothing is short."""
    return np.tile(colours.astype(np.float32), width)
