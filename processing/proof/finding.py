"""What a frame is found to show, and by which figures."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Finding(StrEnum):
    """What a frame is found to show.

    ``doubtful`` frames do not agree with their complement, which looks wrong itself; ``unseen``
    ones have a pattern too faint or too unpredictable to be told from others; ``exposed`` ones were
    taken with other settings than asked; ``misplaced`` ones show their pattern, but elsewhere on
    the scene than the projector's pixels are known to be seen.
    """

    OWN = "own"
    PREVIOUS = "previous"
    BLANK = "blank"
    PARTIAL = "partial"
    OTHER = "other"
    DOUBTFUL = "doubtful"
    EXPOSED = "exposed"
    MISPLACED = "misplaced"
    UNSEEN = "unseen"


@dataclass(frozen=True, slots=True)
class Judgement:
    """A frame against its prediction.

    Parameters
    ----------
    finding
        What it shows; ``unseen`` where its pattern is too faint or unpredictable to be told.
    change
        Mean square of the difference from the picture before, noise taken off, in parts of what
        their codes let expect: 0 where both show the same. NaN where there is none before.
    level
        Light of the frame over that of the mean of white and black, black taken off.
    residual
        Mean square of what the prediction leaves, in parts of the contrast, noise taken off.
    gain
        Lamp and exposure relative to white and black, or to the typical frame of the kind.
    mixed
        Part of the picture before that is in the frame; NaN where it cannot be told.
    """

    finding: Finding
    change: float
    level: float
    residual: float
    gain: float
    mixed: float = float("nan")

    @property
    def is_wrong(self) -> bool:
        """The frame shows something else than its pattern."""
        return self.finding not in {Finding.OWN, Finding.UNSEEN}
