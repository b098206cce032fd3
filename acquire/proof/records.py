"""Lines of proof.jsonl: what each frame was found to show, and its figures."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

from pydantic import Field, ValidationError

from acquire.errors import SessionError
from acquire.plan import MAX_STEPS
from acquire.proof.exposures import Exposure
from acquire.session.folder import append_durably, read_plain, storage, whole_bytes
from acquire.session.records import MAX_ATTEMPTS
from acquire.session.store import PROOF
from acquire.validation import StrictModel, explain
from processing.proof.finding import Finding
from processing.proof.places import Sighting

MAX_BYTES = 256 << 20
# Part of the picture that is told to be dark where it should be lit.
SHADED_AT = 0.01


_WORDS = {
    Finding.BLANK: "shows no light of the projector",
    Finding.PREVIOUS: "shows the picture before it",
    Finding.PARTIAL: "shows its pattern in part only",
    Finding.OTHER: "does not show what its pattern predicts",
    Finding.EXPOSED: "was exposed otherwise than asked",
    Finding.MISPLACED: "shows its pattern elsewhere on the scene",
    Finding.DOUBTFUL: "does not add up to white with its complement, which looks wrong too",
}


class FrameProof(StrictModel):
    """One frame as it was judged; figures that could not be had are null.

    `light`: lamp and exposure, against the first references or, without any, the typical frame
    of the unit. `change`: mean square change from the picture before in parts of the expected
    one. `residual`: what its prediction leaves, in parts of its contrast. `mixed`: the part of the
    picture before that is in it. `additivity`: pattern and complement against white and black,
    relative. `moved_px`: against the first white, down and right, in camera pixels. `saturated`,
    `unlit`: parts of the frame's pixels that are, or that white does not light. `shaded`: part
    of what white lights that neither it nor its complement does. `match`: correlation with its
    pattern at the places that the geometry profile tells. `displaced_px`: where a misplaced pattern
    stands from there, down and right, in projector pixels, the shortest way. `seen_as`: what
    explains that as well, or another pattern that is seen there. `settings`: what its file has
    otherwise than asked. `kept`: found wrong, and kept all the same because the person who captured
    asked for that.
    """

    step: int = Field(ge=0, lt=MAX_STEPS)
    attempt: int = Field(ge=0, lt=MAX_ATTEMPTS)
    finding: Finding
    light: float | None = None
    change: float | None = None
    residual: float | None = None
    mixed: float | None = None
    additivity: float | None = None
    moved_px: tuple[float, float] | None = None
    saturated: float = 0.0
    unlit: float | None = None
    shaded: float | None = None
    match: float | None = None
    displaced_px: tuple[float, float] | None = None
    seen_as: tuple[Annotated[str, Field(max_length=60)], ...] = Field(default=(), max_length=8)
    settings: str = Field(default="", max_length=200)
    camera_time: str = Field(default="", max_length=23)
    kept: bool = False

    @property
    def is_wrong(self) -> bool:
        """The frame shows something else than its pattern."""
        return self.finding not in {Finding.OWN, Finding.UNSEEN}

    @property
    def in_words(self) -> str:
        """What is wrong with the frame, as a predicate."""
        words = _WORDS.get(self.finding, "shows its pattern")
        if self.settings:
            words += f" ({self.settings})"
        if self.finding is Finding.MISPLACED and self.displaced_px is not None:
            words += f" ({displaced(self.displaced_px)})"
        elif self.finding is Finding.OTHER and self.seen_as:
            words += f" but a {self.seen_as[0]}"
        if (self.shaded or 0) > SHADED_AT:
            joined = "and" if self.is_wrong else "but"
            words += f", {joined} {self.shaded:.0%} of what should be lit is dark"
        return words


def figure(value: float) -> float | None:
    """A figure of a line: six digits, null where it is none."""
    return float(f"{value:.6g}") if math.isfinite(value) else None


def rounded(moved: tuple[float, float] | None) -> tuple[float, float] | None:
    """A movement of a line, to a thousandth of a pixel."""
    return None if moved is None else (round(moved[0], 3), round(moved[1], 3))


def displaced(moved_px: tuple[float, float]) -> str:
    """Where a pattern stands from its place, in words."""
    ways = zip(moved_px, (("down", "up"), ("to the right", "to the left")), strict=True)
    parts = [f"{abs(px):g} px {ahead if px > 0 else back}" for px, (ahead, back) in ways if px]
    return " and ".join(parts) or "turned over"


def placed_proof(proof: FrameProof, sighting: Sighting) -> FrameProof:
    """The line of a frame with what is seen at the places of the geometry profile."""
    return proof.model_copy(
        update={
            "match": figure(sighting.match),
            "displaced_px": sighting.displaced_px,
            "seen_as": sighting.seen_as,
        }
    )


def plain_proof(exposure: Exposure, finding: Finding) -> FrameProof:
    """The line of an exposure, without figures of comparisons."""
    settings = exposure.contradictions
    return FrameProof(
        step=exposure.record.step,
        attempt=exposure.record.attempt,
        finding=Finding.EXPOSED if settings else finding,
        saturated=float(f"{exposure.samples.saturated_part:.6g}"),
        settings=settings,
        camera_time=exposure.samples.notes.camera_time,
    )


def append_proofs(folder: Path, proofs: Iterable[FrameProof]) -> None:
    """Append lines in one piece."""
    text = "".join(proof.model_dump_json() + "\n" for proof in proofs)
    if text:
        append_durably(folder / PROOF, text.encode(), make=True)


def recover_proofs(folder: Path) -> None:
    """Cut off what a crash left unfinished."""
    path = folder / PROOF
    if not path.exists():
        return
    end = whole_bytes(read_plain(path, MAX_BYTES))
    with storage(path), path.open("rb+") as file:
        file.truncate(end)


def read_proofs(folder: Path) -> dict[tuple[int, int], FrameProof]:
    """The last line of every exposure, by step and attempt; none where nothing was judged."""
    path = folder / PROOF
    with storage(path):
        if not path.exists():
            return {}
    found = {}
    content = read_plain(path, MAX_BYTES)
    lines = content[: whole_bytes(content)].split(b"\n")[:-1]
    for number, line in enumerate(lines, 1):
        try:
            proof = FrameProof.model_validate_json(line)
        except ValidationError as error:
            raise SessionError(f"Cannot use line {number} of {path}:\n{explain(error)}") from error
        found[proof.step, proof.attempt] = proof
    return found
