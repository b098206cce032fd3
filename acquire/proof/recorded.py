"""The proof of a session that lies on the disk."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from acquire.errors import ProofError
from acquire.proof.examination import Examination
from acquire.proof.placement import placement_of
from acquire.proof.records import FrameProof
from acquire.proof.samples import sample_frame
from acquire.session import Session, Transfer
from drivers.errors import DecodeError


class Recorded:
    """A session that is judged anew, whatever was said of it when it was captured.

    Parameters
    ----------
    session
        Complete or not, captured or imported.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        placement = placement_of(session)
        self._examination = Examination(session.plan, session.projector_px, placement)

    def proofs(self, frame_done: Callable[[], None]) -> Iterator[FrameProof]:
        """What every frame that counts shows.

        Parameters
        ----------
        frame_done
            Called after each frame was read.

        Raises
        ------
        ProofError
            A frame cannot be decoded.
        """
        session, examination = self._session, self._examination
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

    def disagreements(self) -> list[str]:
        """Pitches that stand elsewhere than the others say, once all is judged, in words."""
        return self._examination.disagreements()
