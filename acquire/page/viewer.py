"""One browser that looks, and how fast it may ask."""

from __future__ import annotations

import asyncio
import json
import struct
from dataclasses import asdict, dataclass, field
from typing import Any

from acquire.page.darkroom import Box, Print

BURST, PER_S = 60.0, 20.0


@dataclass(eq=False, slots=True)
class Viewer:
    """What a browser wants and has; `news` is set when there may be something for it.

    Parameters
    ----------
    number
        Of the viewer, from 1, never given twice.
    box
        The part of the picture that it wants pixel for pixel; None for all.
    ready
        Whether it has shown its last picture.
    state, picture, compared, projector
        Keys of what it was sent last.
    is_due
        Whether it should hear that the page is alive.
    pattern
        What its last picture should show; empty for one that was only looked at.
    """

    number: int
    box: Box | None = None
    ready: bool = True
    state: str = ""
    picture: tuple[int, Box | None] | None = None
    compared: int = 0
    projector: str = ""
    is_due: bool = False
    pattern: str = ""
    news: asyncio.Event = field(default_factory=asyncio.Event)
    _allowance: float = BURST
    _counted_s: float = 0.0

    def may_ask(self, now_s: float) -> bool:
        """Whether it has not asked too often; counts one question."""
        gained = (now_s - self._counted_s) * PER_S
        self._allowance = min(self._allowance + gained, BURST) - 1
        self._counted_s = now_s
        return self._allowance >= 0


def packed(head: dict[str, Any], *files: bytes) -> bytes:
    """Pack a header and files into one binary message: length, JSON, files.

    The length is 32 bits, little-endian, of the JSON, whose key ``sizes`` has the files' lengths.
    """
    text = json.dumps(head | {"sizes": [len(file) for file in files]}).encode()
    return struct.pack("<I", len(text)) + text + b"".join(files)


def packed_print(head: dict[str, Any], shown: Print) -> bytes:
    """Pack a camera picture: image, then marks."""
    about = asdict(shown)
    image, marks = about.pop("image"), about.pop("marks")
    return packed(head | about, image, marks)
