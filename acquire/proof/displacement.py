"""What is said of pitches that stand elsewhere on the scene than they should."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from acquire.proof.records import FrameProof, displaced
from acquire.session import Session
from processing.patterns import Family
from processing.proof.finding import Finding

# Findings of frames that may show their pattern elsewhere.
ELSEWHERE = {Finding.MISPLACED, Finding.PARTIAL, Finding.PREVIOUS, Finding.OTHER}
# Part of a pitch's frames from which all of it is told.
WHOLE = 0.5
# By how much its frames may differ in where they stand, in projector pixels.
ALIKE_PX = 1.0


def misplaced(session: Session, proofs: Sequence[FrameProof]) -> Iterator[str]:
    """Pitches whose frames do not stand where the geometry profile has their raster."""
    named = any(use.kind == "geometry" for use in session.plan.calibration)
    if named and proofs and all(proof.match is None for proof in proofs):
        yield (
            "No frame was compared with the plan's geometry profile: it is missing from the "
            "session, of a board or of pictures of another size, white and black were exposed "
            "otherwise, or an older version judged the frames (`verify --images` judges anew)."
        )
    patterns = session.plan.patterns
    kinds: dict[tuple[Family, int], list[FrameProof]] = {}
    for proof in proofs:
        pattern = patterns[proof.step]
        kinds.setdefault((pattern.family, pattern.pitch_px), []).append(proof)
    told: dict[str, list[str]] = {}
    for (family, pitch_px), own in kinds.items():
        off = [proof for proof in own if proof.finding in ELSEWHERE and proof.match is not None]
        if len(off) > WHOLE * len(own):
            told.setdefault(_how(off), []).append(f"{family} of {pitch_px} px")
    for how, which in told.items():
        yield (
            f"The frames of {', '.join(which)} {how}: the projector's picture was moved, scaled or "
            "turned, or projector, camera or scene were since the geometry profile was measured."
        )


def _how(off: Sequence[FrameProof]) -> str:
    """Where the frames of one pitch stand, as far as one thing explains them all."""
    moved = [proof.displaced_px for proof in off if proof.displaced_px is not None]
    if moved and np.ptp(moved, axis=0).max() <= ALIKE_PX:
        down, right = np.median(moved, axis=0)
        return f"stand {displaced((round(down), round(right)))} from where their raster has them"
    alike = [name for name in off[0].seen_as if all(name in proof.seen_as for proof in off)]
    if not alike:
        return "do not show what their raster predicts"
    return f"show {alike[0]} instead" if " of " in alike[0] else f"are {alike[0]}"
