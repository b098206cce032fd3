"""Direct light at every pitch freed from the bias of noise, and its standard error, as files.

The noise is that of a calibration, or measured on complementary frames of the session itself. That
needs the whole session, so the single pitches are corrected after the last of them was separated,
from their files.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from acquire.blanking import Unusable
from acquire.pitches import SeparatedPitches
from acquire.result import FrameNoiseRecord, PitchRecord, PixelClass, read_tiff, write_tiff
from processing.frames.frame_noise import FrameNoise, FrameSample, lattice, noise_of
from processing.frames.noise_bias import Correction, extrema_correction, measured_kinds
from processing.frames.optical_contrast import OpticalContrast
from processing.frames.single_pitch import Estimate, amplitude_estimate, extrema_estimate
from processing.numerics.elementary import hypot
from processing.patterns import balanced


class Observer(Protocol):
    """Hears of the pitches as they are corrected."""

    def stage(self, name: str, total: int) -> None:
        """A stage of `total` pitches begins."""

    def advance(self) -> None:
        """One is done."""


def correct(
    folder: Path,
    separated: SeparatedPitches,
    leak: float,
    observer: Observer,
    calibrated: FrameNoise | None = None,
    contrast: OpticalContrast | None = None,
) -> tuple[SeparatedPitches, FrameNoiseRecord | None]:
    """Write ``pitches/corrected-*.tiff`` and ``pitches/deviation-*.tiff``.

    Parameters
    ----------
    folder
        The result folder, with the pitches in it.
    separated
        The pitches.
    leak
        b, as they were separated with.
    observer
        Told of every pitch.
    calibrated
        Noise of a frame, if a calibration tells; it takes the place of what is measured.
    contrast
        What direct light was divided by, if it was.

    Returns
    -------
    The pitches with the new files, and the noise; as they were, and None, where it is not
    calibrated and no pitch holds two complementary pairs of frames, so that it is unknown.
    """
    noise = calibrated or frame_noise(separated)
    if noise is None:
        return separated, None
    observer.stage("correcting", len(separated.pitches))
    unusable = Unusable.of(separated.mask)
    pitches = []
    # What the samples tell of a pitch is found beside the correction of the one before.
    ahead = ThreadPoolExecutor(1, thread_name_prefix="bias")
    try:
        told = ahead.map(lambda one: _bias(separated, one, noise), separated.samples)
        for pitch, sample, bias in zip(separated.pitches, separated.samples, told, strict=True):
            estimate = _estimate(folder, pitch, separated, sample, noise, bias, leak)
            if contrast is not None:
                with_white = separated.references.white is not None
                error = contrast.relative_error(sample.patterns, with_white=with_white)
                estimate = _freed(estimate, pitch, error)
            pitches.append(_written(folder, pitch, estimate, unusable))
            observer.advance()
    finally:
        ahead.shutdown(cancel_futures=True)
    record = FrameNoiseRecord(
        constant=tuple(noise.constant.tolist()), slope=tuple(noise.slope.tolist())
    )
    return replace(separated, pitches=tuple(pitches)), record


def frame_noise(separated: SeparatedPitches) -> FrameNoise | None:
    """Noise of a frame, from the complementary frames of all pitches; None where it is unknown."""
    measured = [one.noise_variance for one in separated.samples]
    known = [one for one in measured if one is not None]
    usable = separated.mask == PixelClass.MEASURED
    if not known or not usable[lattice(usable.shape)].any():
        return None
    return noise_of(known, separated.white, usable)


@dataclass(frozen=True, slots=True)
class _Bias:
    """What noise does to the extrema of a pitch, and the kinds of its pixels where they tell."""

    correction: Correction
    kinds: NDArray[np.int64] | None


def _bias(separated: SeparatedPitches, sample: FrameSample, noise: FrameNoise) -> _Bias | None:
    """None for sinusoids."""
    patterns = sample.patterns
    if not patterns[0].family.is_binary:
        return None
    at = lattice(separated.mask.shape)
    usable = separated.mask[at] == PixelClass.MEASURED
    white_reference = separated.references.white
    if white_reference is not None and not balanced(patterns):
        white_deviation = _white_deviation(separated, noise, white_reference.frames)
        correction = extrema_correction(len(patterns), white_deviation)
        white = separated.white[at].astype(np.float64)
        return _Bias(correction, measured_kinds(sample, noise, usable, correction, white))
    correction = extrema_correction(len(patterns))
    return _Bias(correction, measured_kinds(sample, noise, usable, correction))


def _estimate(
    folder: Path,
    pitch: PitchRecord,
    separated: SeparatedPitches,
    sample: FrameSample,
    noise: FrameNoise,
    bias: _Bias | None,
    leak: float,
) -> Estimate:
    white = separated.white
    direct = read_tiff(folder / pitch.direct, white.shape, np.float32)
    if pitch.divided_by is not None:
        direct *= pitch.divided_by
    if bias is None:
        phases = [pattern.phase for pattern in sample.patterns]
        return amplitude_estimate(direct, white, noise, phases, leak)
    return extrema_estimate(direct, white, noise, bias.correction, kinds=bias.kinds, leak=leak)


def _freed(estimate: Estimate, pitch: PitchRecord, error: NDArray[np.float64]) -> Estimate:
    """Divided by what the optics leave, whose own error is added to the noise's."""
    left = pitch.divided_by
    if left is None:
        return estimate
    direct = estimate.direct_light / left
    own = np.abs(direct) * error.astype(np.float32)
    return Estimate(direct, hypot(estimate.deviation / left, own))


def _white_deviation(separated: SeparatedPitches, noise: FrameNoise, frames: int) -> float:
    """Typical noise of the white reference in units of a pattern frame's."""
    at = lattice(separated.mask.shape)
    white = separated.white[at][separated.mask[at] == PixelClass.MEASURED]
    ratio = noise.deviation(white) / np.maximum(noise.deviation(white / 2), 1e-30)
    return round(float(np.median(ratio) / np.sqrt(frames)), 1)


def _written(
    folder: Path, pitch: PitchRecord, estimate: Estimate, unusable: Unusable
) -> PitchRecord:
    names = {
        "corrected": pitch.direct.replace("/direct-", "/corrected-"),
        "deviation": pitch.direct.replace("/direct-", "/deviation-"),
    }
    for image in (estimate.direct_light, estimate.deviation):
        unusable.blank(image)
    write_tiff(folder / names["corrected"], estimate.direct_light)
    write_tiff(folder / names["deviation"], estimate.deviation)
    return pitch.model_copy(update=names)
