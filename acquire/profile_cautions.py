"""What a person must know of how calibration profiles changed the numbers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from acquire.pitches import SeparatedPitches
from acquire.profile_use import Profiles
from acquire.result import PixelClass
from acquire.session.records import Caution
from processing.frames.frame_noise import FrameNoise

# Of superpixels: what is interpolated has another noise and another blur.
SUPERPIXEL_KINDS = frozenset({"noise", "board"})
# Standard deviation of the frames over the profile's.
NOISE_AT_LEAST, NOISE_AT_MOST = 0.8, 1.25
# Pitches that keep more of their contrast than this need no word.
HARDLY_BLURRED = 0.95
UNUSED = Caution(
    what="The noise and board profiles were not used: the frames were demosaiced.",
    meaning="They hold for superpixels; interpolated values have another noise and another blur, "
    "which differ from pixel to pixel. Noise and blur were measured on the frames instead.",
    remedy="Process without `--demosaic bilinear`, and they are used.",
)


def for_photosites(profiles: Profiles) -> tuple[Profiles, tuple[Caution, ...]]:
    """The profiles that hold for demosaiced frames, and a word where others were left out."""
    unused = [use for use in profiles.uses if use.kind in SUPERPIXEL_KINDS]
    if not unused:
        return profiles, ()
    kept = tuple(use for use in profiles.uses if use not in unused)
    return replace(profiles, blur=None, contrast=None, noise=None, uses=kept), (UNUSED,)


def profile_cautions(
    separated: SeparatedPitches, calibrated: FrameNoise | None, measured: FrameNoise | None
) -> Iterator[Caution]:
    """Noise that is not as the profile says, and blur that was divided out.

    Parameters
    ----------
    separated
        The pitches.
    calibrated, measured
        Noise of a frame by a profile, and by the frames themselves, where they tell.
    """
    usable = separated.mask == PixelClass.MEASURED
    if calibrated is not None and measured is not None and usable.any():
        light = np.median(separated.white[usable], axis=0) / 2
        ratio = measured.deviation(light) / np.maximum(calibrated.deviation(light), 1e-12)
        worst = float(ratio[np.argmax(np.abs(np.log(np.maximum(ratio, 1e-6))))])
        if not NOISE_AT_LEAST < worst < NOISE_AT_MOST:
            yield Caution(
                what=f"The frames are {worst:.2g} times as noisy as the noise profile says.",
                meaning="Standard errors are wrong by about that factor, and the bias of max/min "
                "is corrected too little or too much.",
                remedy="Look for flicker, or calibrate the noise again with the session's ISO; "
                "without the profile, the noise is measured on the frames.",
            )
    divided = [p for p in separated.pitches if p.divided_by is not None]
    lowest = {p.pitch_px: min(p.contrast or (1.0,)) for p in divided}
    blurred = {pitch: left for pitch, left in lowest.items() if left < HARDLY_BLURRED}
    if blurred:
        listed = ", ".join(f"{pitch} px {left:.0%}" for pitch, left in sorted(blurred.items()))
        yield Caution(
            what=f"By the board, camera and projector leave of direct light: {listed}.",
            meaning="Direct light at these pitches was divided by it, colour by colour, and its "
            "noise with it. Where the scene is out of the board's focus, it is off by what the "
            "focus differs.",
            remedy="Sharpen the focus and stop down, and there is less to divide by; the profile "
            "must be of the distance and focus of the scene.",
        )
