"""Pictures of the frames that look worst, each with what it should show, for the result.

Which they are: first what was found wrong and kept all the same, then what was taken again, as it
was before, then of the frames that count those that their prediction leaves most of. Pictures are
averaged down to `SIDE_PX`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from acquire.frames import Frames
from acquire.proof.expectation import Expectation, Expected, Small, reduced
from acquire.proof.records import FrameProof, read_proofs
from acquire.result import PortraitRecord, write_tiff
from acquire.session import FrameRecord, Session
from acquire.session.folder import storage

MOST = 6
# Of these, frames that count and were found right: the worst of them say how good the rest is.
LEAST_RIGHT = 2
SIDE_PX = 256
# Where a projector's size was not recorded, its pixels are looked for within the largest there is.
LARGEST_PROJECTOR_PX = 2400, 4096

Chosen = list[tuple[FrameRecord, FrameProof | None]]


def keep_portraits(
    session: Session, folder: Path, begins: Callable[[int], object], done: Callable[[], object]
) -> tuple[PortraitRecord, ...]:
    """Write pictures of the worst frames and of their predictions into a result folder.

    Parameters
    ----------
    session
        Whose frames were judged at capture; without that there are no pictures.
    folder
        The result.
    begins
        Told how many there are.
    done
        Called after each.
    """
    chosen = worst_frames(session)
    if not chosen:
        return ()
    begins(len(chosen))
    with storage(folder):
        (folder / "proof").mkdir(exist_ok=True)
    return tuple(_portraits(session, folder, chosen, done))


def worst_frames(session: Session) -> Chosen:
    """At most six frames, the worst first, with what was found about them."""
    proofs = read_proofs(session.folder)
    if not proofs:
        return []
    current = [(frame, proofs.get((frame.step, frame.attempt))) for frame in session.frames]
    kept = [(frame, proof) for frame, proof in current if proof is not None and proof.is_wrong]
    counting = {(frame.step, frame.attempt) for frame in session.frames}
    again: Chosen = [
        (line, proofs.get((line.step, line.attempt)))
        for line in session.lines
        if (line.step, line.attempt) not in counting
    ]
    right = [
        (frame, proof)
        for frame, proof in current
        if proof is not None and not proof.is_wrong and proof.residual is not None
    ]
    right.sort(key=lambda each: -(each[1].residual or 0.0))
    wrong = [*kept, *again][: MOST - min(LEAST_RIGHT, len(right))]
    return [*wrong, *right[: MOST - len(wrong)]]


def _portraits(
    session: Session, folder: Path, chosen: Chosen, done: Callable[[], object]
) -> Iterator[PortraitRecord]:
    frames = Frames(session)

    def develop(record: FrameRecord) -> Small:
        ((_, image),) = frames.images([record])
        return reduced(image.values, image.saturated, SIDE_PX)

    proofs = read_proofs(session.folder)
    # What was found wrong predicts nothing.
    trusted = {
        frame.step: frame
        for frame in session.frames
        if (proof := proofs.get((frame.step, frame.attempt))) is None or not proof.is_wrong
    }
    size = session.projector_px or LARGEST_PROJECTOR_PX
    expectation = Expectation(session.plan, size, trusted, develop)
    counting = {(frame.step, frame.attempt) for frame in session.frames}
    for record, proof in chosen:
        frame = develop(record)
        expected = expectation.of(record, frame)
        superseded = (record.step, record.attempt) not in counting
        yield _kept(folder, record, proof, frame, expected, superseded=superseded)
        done()


def _kept(
    folder: Path,
    record: FrameRecord,
    proof: FrameProof | None,
    frame: Small,
    expected: Expected,
    *,
    superseded: bool,
) -> PortraitRecord:
    name = f"{record.step:06d}-{record.attempt}.tiff"
    measured, predicted = f"proof/measured-{name}", None
    _write(folder / measured, frame)
    white = expected.white
    miss: float | None = None
    if expected.prediction is not None:
        predicted = f"proof/predicted-{name}"
        _write(folder / predicted, expected.prediction)
        known = frame.usable & expected.prediction.usable
        difference = (frame.values - expected.prediction.values).mean(axis=2)[known]
        scale = white or float(np.percentile(expected.prediction.values, 99))
        if known.any() and scale > 0:
            miss = float(np.sqrt(np.mean(difference**2, dtype=np.float64))) / scale
    shape = frame.usable.shape
    return PortraitRecord(
        step=record.step,
        attempt=record.attempt,
        pattern=str(record.pattern),
        verdict=_verdict(proof, superseded=superseded),
        is_right=proof is not None and not proof.is_wrong and not superseded,
        how=expected.how,
        holds=None if expected.holds is None else round(expected.holds, 6),
        miss=miss,
        white=white,
        light=None if proof is None else proof.light,
        residual=None if proof is None else proof.residual,
        additivity=None if proof is None else proof.additivity,
        measured=measured,
        predicted=predicted,
        shape=(shape[0], shape[1]),
    )


def _verdict(proof: FrameProof | None, *, superseded: bool) -> str:
    found = "was found wrong" if proof is None else proof.in_words
    if superseded:
        return f"{found}; it was taken again and does not count"
    if proof is not None and proof.is_wrong:
        return f"{found}; it was kept all the same"
    return found


def _write(path: Path, picture: Small) -> None:
    usable = picture.usable[..., np.newaxis]
    write_tiff(path, np.where(usable, picture.values, np.float32(np.nan)).astype(np.float32))
