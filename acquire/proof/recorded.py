"""The proof of a session that lies on the disk, and what it says about the session as a whole."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from acquire.errors import ProofError
from acquire.proof.examination import Examination
from acquire.proof.records import FrameProof
from acquire.proof.samples import sample_frame
from acquire.session import Session, Transfer
from drivers.errors import DecodeError

DRIFT_AT = 0.01
UNSTEADY_AT = 0.005
ADDITIVITY_AT = 0.02
MOVED_AT_PX = 0.1
SATURATED_AT = 0.001


def examine(session: Session, frame_done: Callable[[], None]) -> Iterator[FrameProof]:
    """Judge every frame that counts anew, whatever was said of it when it was captured.

    Parameters
    ----------
    session
        Complete or not, captured or imported.
    frame_done
        Called after each frame was read.

    Raises
    ------
    ProofError
        A frame cannot be decoded.
    """
    examination = Examination(session.plan, session.projector_px)
    transfer = session.record.source.transfer if session.record.source else Transfer.RAW
    last_step = -1
    for number, record in enumerate(session.lines):
        try:
            samples = sample_frame(session.read(record), record.media_type, transfer)
        except DecodeError as error:
            raise ProofError(f"{session.folder / record.file}: {error}.") from error
        examination.add(number, record, samples)
        frame_done()
        newest = record.step > last_step
        last_step = max(last_step, record.step)
        follows = session.lines[number + 1].step if number + 1 < len(session.lines) else None
        # A unit's retakes follow its last frame.
        if newest and follows is not None and follows < record.step:
            continue
        if follows is None or follows > last_step:
            for unit in examination.closing_at(last_step):
                yield from examination.judge(unit)
                examination.settle(unit)


def verdict(session: Session, proofs: Sequence[FrameProof]) -> Iterator[str]:
    """What the figures say about the session, in words; nothing where all is well."""
    wrong = sum(proof.is_wrong for proof in proofs)
    unseen = sum(proof.finding == "unseen" for proof in proofs)
    again = len(session.lines) - len(session.frames)
    yield (
        f"{len(proofs)} frames judged: {wrong} wrong, {unseen} too faint or too few of a kind to "
        f"be told; {again} were taken again during the capture."
    )
    light = np.array([proof.light for proof in proofs if proof.light is not None])
    if light.size >= 3:
        yield from _steadiness(light)
    sums = [abs(proof.additivity) for proof in proofs if proof.additivity is not None]
    if sums and max(sums) > ADDITIVITY_AT:
        yield f"Patterns and complements miss white and black by up to {max(sums):.1%}."
    moved = [proof.moved_px for proof in proofs if proof.moved_px is not None]
    if moved:
        farthest = max(float(np.hypot(*shift)) for shift in moved)
        if farthest > MOVED_AT_PX:
            yield f"The scene or the camera moved by up to {farthest:.2f} camera pixels."
    saturated = max((proof.saturated for proof in proofs), default=0.0)
    if saturated > SATURATED_AT:
        yield f"Up to {saturated:.1%} of the pixels of a frame are saturated: expose less."


def _steadiness(light: np.ndarray) -> Iterator[str]:
    """Drift of the light as a line through all frames, and how far they lie from it."""
    order = np.linspace(-0.5, 0.5, light.size)
    slope = float(order @ (light - light.mean()) / (order @ order))
    rest = float(np.std(light - light.mean() - slope * order))
    if abs(slope) > DRIFT_AT:
        yield f"Lamp or exposure drifted by {slope:+.1%} over the session."
    if rest > UNSTEADY_AT:
        yield f"The light of single frames varies by {rest:.1%} (standard deviation): flicker."
