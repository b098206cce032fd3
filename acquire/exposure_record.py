"""What was found of the exposures of an imported stack, as a result keeps it."""

from __future__ import annotations

from acquire.validation import StrictModel


class FrameGainRecord(StrictModel):
    """Gain of a frame in each colour against the first white frame, and its standard error."""

    step: int
    pattern: str
    gain: tuple[float, ...]
    error: tuple[float, ...]


class PairRecord(StrictModel):
    """A pattern and its complement; see `processing.frames.exposure_gains.PairGains`.

    `corrected` tells whether both were divided by their gains.
    """

    frames: tuple[FrameGainRecord, FrameGainRecord]
    missed: float
    left: float
    by_level: float
    by_place: float
    outlying: float
    corrected: bool


class ToneCurveRecord(StrictModel):
    """A curve of the camera's own; see `processing.frames.tone_curve.Evidence`.

    Parameters
    ----------
    codes
        The knots, parts of the largest code of sRGB.
    factors, errors
        Of each colour at each.
    without, with_curve
        What pairs miss white by, their gains taken off, without it and with one that was found
        from others.
    corrected
        Whether it was undone.
    """

    codes: tuple[float, ...]
    factors: tuple[tuple[float, ...], ...]
    errors: tuple[tuple[float, ...], ...]
    without: float
    with_curve: float
    corrected: bool


class ExposureRecord(StrictModel):
    """Gains of the frames of an imported stack.

    Parameters
    ----------
    obstacle
        Why they could not be looked for; empty if they were.
    differs
        Whether any of them differs from that of the first white frame by more than noise makes.
    corrected
        Whether frames were divided by their gains.
    pairs
        Of complementary frames, in the order of the pitches.
    white
        Frames after the first.
    black
        Of the black frames together; None where they are too dark to tell.
    unpaired
        How many frames have no complement, or one that was too dark.
    curve
        None where none could be looked for.
    """

    obstacle: str = ""
    differs: bool = False
    corrected: bool = False
    pairs: tuple[PairRecord, ...] = ()
    white: tuple[FrameGainRecord, ...] = ()
    black: FrameGainRecord | None = None
    unpaired: int = 0
    curve: ToneCurveRecord | None = None
