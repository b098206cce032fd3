"""Frames of one family and pitch, as they are judged together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.proof.parts import Parts
from processing.proof.phases import Phases
from processing.proof.prediction import Array, Samples
from processing.proof.sample_noise import SampleNoise

# Level of a frame relative to the mean of white and black below which it shows no light.
DARK_AT = 0.1


@dataclass(frozen=True, slots=True)
class Kind:
    """Frames of one family and pitch, as samples of n places.

    Parameters
    ----------
    frames
        float32, (frames, n), linear light, that of black taken off where it was captured.
    before
        float32, (frames, n): the picture that was taken before each of them; NaN where none was
        or where it was wrong.
    before_index
        int, (frames,): which of `frames` has the pattern that was shown before; −1 where none
        has.
    covariance
        (frames, frames), of the codes (see `processing.proof.prediction`).
    phases
        Codes over the period.
    change
        (frames,): mean square of 2(c − c') with c' the code of the picture before.
    partitions
        The whole picture, blocks of it, and strips across it, which pictures are drawn in.
    white
        (n,), white less black; None where they were not captured.
    noise
        Of a sample, for kinds without three complementary pairs.
    repeated
        bool, (frames,): the file is that of the exposure before, byte for byte.
    slopes
        (4, n): light of the mean picture above, below, left and right of a place, less its own.
    replaced
        float32, (frames, n): the exposure of the same pattern that each replaces; NaN where none.
    void
        bool, (frames,): taken with other settings or known to show something else; predicts
        nothing.
    is_fine
        Whether every pattern has about half of the light, because its cells are many.
    """

    frames: Samples
    before: Samples
    before_index: NDArray[np.int64]
    covariance: Array
    phases: Phases
    change: Array
    partitions: tuple[Parts, ...]
    white: Array | None
    noise: SampleNoise
    repeated: NDArray[np.bool_]
    slopes: Array
    replaced: Samples
    void: NDArray[np.bool_]
    is_fine: bool

    @property
    def dark(self) -> NDArray[np.bool_]:
        """Frames of patterns that light half of the scene, and that have no light, (frames,)."""
        light = self.frames.sum(axis=1, dtype=np.float64)
        usual = float(np.median(light)) if self.white is None else float(self.white.sum()) / 2
        return np.asarray((light < DARK_AT * usual) & self.is_fine, bool)
