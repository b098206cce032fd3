"""The proof beside a running capture: samples in a thread of its own, judges when a unit closes."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from types import TracebackType
from typing import Self

from acquire.errors import ProofError
from acquire.proof.examination import Examination
from acquire.proof.placement import placement_of
from acquire.proof.records import (
    SHADED_AT,
    FrameProof,
    append_proofs,
    read_proofs,
    recover_proofs,
)
from acquire.proof.samples import FrameSamples, sample_frame
from acquire.proof.units import Unit
from acquire.session import FrameRecord, Session, Transfer
from acquire.session.log import Kind
from drivers.errors import DecodeError
from processing.proof.finding import Finding

RETAKES = 3
# Exposures in a row that cannot be what they should be, after which the capture stops.
MOST_HOPELESS = 4
# Frames whose bytes are held while they wait to be sampled, beside the next exposure.
MOST_WAITING = 1
_URGENCY = (
    Finding.EXPOSED,
    Finding.BLANK,
    Finding.PREVIOUS,
    Finding.MISPLACED,
    Finding.PARTIAL,
    Finding.OTHER,
    Finding.DOUBTFUL,
)
_SPECIFIC = {Finding.EXPOSED, Finding.BLANK, Finding.PREVIOUS, Finding.MISPLACED}
_UNSPECIFIC = {Finding.OTHER, Finding.DOUBTFUL}
_CAUSES = {
    Finding.BLANK: "the projector is off, asleep, covered or without its cable.",
    Finding.PREVIOUS: "the camera delivers one file over and over (switch it off and on), or the "
    "projector shows every picture too late (raise settle_s; `lumisplit calibrate latency`).",
    Finding.PARTIAL: "a part of the projector's picture stands elsewhere or is covered (look at "
    "its keystone and zoom and for windows in front), or a part of the scene was moved since the "
    "geometry profile was measured: calibrate the geometry again, or take it out of the plan.",
    Finding.MISPLACED: "the projector's picture was moved, scaled or turned (look at its keystone "
    "and zoom and at the resolution of its monitor), or projector, camera or scene were moved "
    "since the geometry profile was measured: calibrate the geometry again, or take it out of the "
    "plan.",
    Finding.EXPOSED: "somebody turned the camera's dial, or it is not set to M. Set it as the plan "
    "says.",
    Finding.OTHER: "something else is projected, or far more light falls on the scene than white "
    "gave (is a lamp of the room on?), or the plan's geometry profile is not of this scene.",
}


class Prover:
    """Which step must be taken again, as far as the session's lines tell.

    Parameters
    ----------
    session
        Being captured; its lines are those that count.
    warn
        Called once with what a person should know when frames cannot be judged.
    keep_unproven
        Note what is still wrong after three retakes instead of stopping there.
    """

    def __init__(
        self, session: Session, warn: Callable[[str, Kind], None], *, keep_unproven: bool
    ) -> None:
        self._session, self._warn, self._keep_unproven = session, warn, keep_unproven
        self._examination = Examination(session.plan, session.projector_px, placement_of(session))
        self._waiting: deque[tuple[int, FrameRecord, Future[FrameSamples]]] = deque()
        self._sampler = ThreadPoolExecutor(1, thread_name_prefix="proof")
        self._blind = False
        self._retakes: dict[int, int] = {}
        self._open = set(self._examination.units)
        self._hopeless = 0
        self._is_watching = False
        self._is_shaded = False

    @property
    def is_done(self) -> bool:
        """Whether every unit was judged, or none can be."""
        return self._blind or not self._open

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._sampler.shutdown(cancel_futures=True)

    def resume(self) -> list[Unit]:
        """Read what earlier runs captured, as far as it is needed; the units still to be judged."""
        recover_proofs(self._session.folder)
        proofs = read_proofs(self._session.folder)
        frames, lines = self._session.frames, self._session.lines
        done = {
            frame.step
            for frame in frames
            if (proof := proofs.get((frame.step, frame.attempt))) is not None
            and (proof.kept or not proof.is_wrong)
        }
        units = self._examination.units
        needed = {step for unit in units for step in unit.steps if unit.are_references}
        needed |= {s for unit in units for s in unit.steps if not done.issuperset(unit.steps)}
        for number, record in enumerate(lines):
            follower = lines[number + 1].step if number + 1 < len(lines) else record.step
            if record.step in needed or follower in needed or number == len(lines) - 1:
                self.take(number, record, self._session.read(record))
        self._collect(0)
        self._is_watching = True
        closed = [unit for unit in units if unit.closes_at < len(frames)]
        for unit in closed:
            if done.issuperset(unit.steps) and not self._blind:
                self._examination.settle(unit)
                self._open.discard(unit)
        return [unit for unit in closed if not done.issuperset(unit.steps)]

    def take(self, number: int, record: FrameRecord, data: bytes) -> None:
        """Sample the frame of a line, in the background, and look at the one before.

        Raises
        ------
        ProofError
            Several exposures in a row cannot be what they should be.
        """
        if self._blind:
            return
        source = self._session.record.source
        transfer = source.transfer if source else Transfer.RAW
        if transfer is Transfer.RAW and record.media_type == "image/jpeg":
            transfer = Transfer.SRGB
        sampling = self._sampler.submit(sample_frame, data, record.media_type, transfer)
        self._waiting.append((number, record, sampling))
        self._collect(MOST_WAITING)

    def closing_at(self, step: int) -> tuple[Unit, ...]:
        """The units to be judged after this step."""
        return self._examination.closing_at(step)

    def next_retake(self, unit: Unit) -> tuple[int, str] | None:
        """The step that must be taken again now, and why; None when the unit is settled.

        Raises
        ------
        ProofError
            A step was taken again three times and is still wrong.
        """
        self._collect(0)
        if self._blind:
            return None
        proofs = self._examination.judge(unit)
        wrong = [proof for proof in proofs if proof.is_wrong]
        open_ = [proof for proof in wrong if self._retakes.get(proof.step, 0) < RETAKES]
        if len(open_) < len(wrong) and not self._keep_unproven:
            # It may be the other one of a pair that is wrong.
            open_ = [proof for proof in open_ if proof.finding in _UNSPECIFIC]
            if not open_:
                raise ProofError(self._message(min(wrong, key=self._order)))
        if not open_:
            self._settle(unit, proofs)
            return None
        chosen = min(open_, key=self._order)
        # The report shows what was found about the exposure that no longer counts.
        append_proofs(self._session.folder, [chosen])
        self._retakes[chosen.step] = self._retakes.get(chosen.step, 0) + 1
        again = f"taking it again ({self._retakes[chosen.step]} of {RETAKES})"
        return chosen.step, f"{self._named(chosen)} {chosen.in_words}; {again}."

    def _order(self, proof: FrameProof) -> tuple[int, int, int, int, int]:
        reference = self._session.plan.patterns[proof.step].family.is_reference
        return (
            # Patterns are judged against the references.
            not reference,
            # What the other one of a pair may be guilty of: first those not taken again yet.
            proof.finding not in _SPECIFIC,
            proof.attempt,
            _URGENCY.index(proof.finding),
            -proof.step if reference else proof.step,
        )

    def _settle(self, unit: Unit, proofs: tuple[FrameProof, ...]) -> None:
        worst = max(proofs, key=lambda proof: proof.shaded or 0)
        if (worst.shaded or 0) > SHADED_AT and not self._is_shaded:
            self._is_shaded = True
            self._warn(
                f"{self._named(worst)}: {worst.shaded:.0%} of what white lights is dark in it and "
                "in its complement. Look whether something stands in front of the projector or the "
                "camera. The frames are kept.",
                Kind.WARNING,
            )
        append_proofs(
            self._session.folder,
            (proof.model_copy(update={"kept": proof.is_wrong}) for proof in proofs),
        )
        self._examination.settle(unit)
        self._open.discard(unit)
        if not self._open:
            for text in self._examination.disagreements():
                self._warn(text, Kind.WARNING)

    def _collect(self, at_most: int) -> None:
        while len(self._waiting) > at_most:
            number, record, sampling = self._waiting.popleft()
            try:
                self._examination.add(number, record, sampling.result())
            except DecodeError as error:
                if not self._blind:
                    self._warn(
                        f"step {record.step}: {error}. Nothing can be said about what the frames "
                        "show; they are kept unjudged.",
                        Kind.WARNING,
                    )
                self._blind = True
            else:
                self._watch(number, record)

    def _watch(self, number: int, record: FrameRecord) -> None:
        """Stop where one exposure after the other cannot be what it should be."""
        if not self._is_watching:
            return
        proof = self._examination.seen_at_once(number)
        if proof is None:
            self._hopeless = 0
            return
        self._hopeless += 1
        if self._hopeless < MOST_HOPELESS or self._keep_unproven:
            if record.attempt == 0:
                text = f"{self._named(proof)} {proof.in_words}; it will be taken again."
                self._warn(text, Kind.SUSPECT)
            return
        raise ProofError(
            f"{_capital(self._named(proof))} {proof.in_words}, like {MOST_HOPELESS - 1} exposures "
            f"before it: {_CAUSES[proof.finding]} The capture stopped here so as not to go on in "
            "vain. Every frame is kept; the same command goes on and takes the wrong ones again."
        )

    def _named(self, proof: FrameProof) -> str:
        return f"step {proof.step} ({self._session.plan.patterns[proof.step]})"

    def _message(self, proof: FrameProof) -> str:
        return (
            f"{_capital(self._named(proof))} {proof.in_words}, also after {RETAKES} retakes. "
            "Every frame is kept. Look at the projector (on, awake, its window in front), at "
            "settle_s in the plan, and whether something moved or the light of the room changed; "
            "then give the same command again. `--keep-unproven` goes on all the same and notes "
            "it; `lumisplit verify --images` lists what is wrong."
        )


def _capital(words: str) -> str:
    return words[0].upper() + words[1:]
