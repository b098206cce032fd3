"""What a reader must know about a decomposition before believing its numbers."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Remark:
    """A warning in three parts, each of whole sentences.

    Parameters
    ----------
    what
        What was found.
    meaning
        What it means for the numbers.
    remedy
        What to do.
    """

    what: str
    meaning: str
    remedy: str
