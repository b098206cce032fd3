"""What was found at capture about the frames that count, for the result."""

from __future__ import annotations

import math
from collections.abc import Sequence

from acquire.proof.records import FrameProof, read_proofs
from acquire.proof.verdict import verdict
from acquire.result import PitchRecord, ProofRecord
from acquire.session import Session
from processing.proof.finding import Finding


def proof_of(session: Session) -> ProofRecord | None:
    """The findings in numbers; None where the frames were not judged."""
    proofs = _that_count(session)
    if not proofs:
        return None
    return ProofRecord(
        judged=len(proofs),
        wrong=sum(proof.is_wrong for proof in proofs.values()),
        unseen=sum(proof.finding is Finding.UNSEEN for proof in proofs.values()),
        retaken=len(session.lines) - len(session.frames),
        light=tuple(proof.light for proof in proofs.values()),
        additivity=tuple(proof.additivity for proof in proofs.values()),
        moved_px=tuple(
            None if proof.moved_px is None else round(math.hypot(*proof.moved_px), 3)
            for proof in proofs.values()
        ),
        saturated=tuple(proof.saturated for proof in proofs.values()),
        shaded=tuple(proof.shaded for proof in proofs.values()),
        # Its first sentence counts what is counted here.
        verdict=tuple(verdict(session, tuple(proofs.values())))[1:],
    )


def proven(session: Session, pitches: Sequence[PitchRecord]) -> tuple[PitchRecord, ...]:
    """The pitches, each with what was found about its frames."""
    proofs = _that_count(session)
    if not proofs:
        return tuple(pitches)
    own: dict[tuple[str, int], list[FrameProof]] = {}
    for frame in session.frames:
        proof = proofs.get(frame.step)
        if proof is not None:
            own.setdefault((frame.pattern.family, frame.pattern.pitch_px), []).append(proof)
    return tuple(
        pitch.model_copy(update=_figures(own.get((pitch.family, pitch.pitch_px), [])))
        for pitch in pitches
    )


def _figures(proofs: Sequence[FrameProof]) -> dict[str, object]:
    residuals = [proof.residual for proof in proofs if proof.residual is not None]
    return {
        "proven": sum(proof.finding is Finding.OWN for proof in proofs),
        "residual": max(residuals, default=None),
    }


def _that_count(session: Session) -> dict[int, FrameProof]:
    """The proof of each step's frame that counts, in the order of the steps."""
    proofs = read_proofs(session.folder)
    found = {frame.step: proofs.get((frame.step, frame.attempt)) for frame in session.frames}
    return {step: proof for step, proof in found.items() if proof is not None}
