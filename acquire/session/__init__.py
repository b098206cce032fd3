"""The session on disk: a plan, the camera's files as they came, and a line for each.

    plan.json       every exposure in order, written once
    session.json    what was used and when: versions, bench, host, runs
    frames.jsonl    one line an exposure, appended after its file is safely on the disk
    proof.jsonl     what each frame was found to show, with figures
    frames/         the camera's bytes, never altered
    truth.npz       only with a simulated bench: the light's true parts

A folder that somebody else made is data: nothing in it is executed, every name is checked
against its one allowed form, links are not followed and sizes are bounded before reading.
"""

from acquire.session.records import (
    FrameRecord,
    RunRecord,
    SessionRecord,
    SourceRecord,
    Transfer,
)
from acquire.session.store import Session

__all__ = ["FrameRecord", "RunRecord", "Session", "SessionRecord", "SourceRecord", "Transfer"]
