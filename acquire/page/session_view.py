"""What the page shows of a session: its newest frame, and what that frame should show."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from acquire.page.comparison import Comparison, compared, small
from acquire.page.darkroom import Negative
from acquire.page.session_tail import SessionTail
from acquire.page.state import Setting
from acquire.profile_file import read_maps, read_profile
from acquire.proof.expectation import Expectation, Places
from acquire.session import FrameRecord


@dataclass(frozen=True, slots=True)
class LastFrame:
    """The newest frame.

    Parameters
    ----------
    picture
        Decoded.
    about
        Its line, its light and what the proof has found so far, for the browser.
    comparison
        With what it should show.
    """

    picture: Negative
    about: dict[str, Any]
    comparison: Comparison


class SessionView:
    """Looks at one session, from one thread.

    Parameters
    ----------
    folder
        Of the session, which another process writes.
    setting
        Of the page.
    """

    def __init__(self, folder: Path, setting: Setting) -> None:
        self._tail = SessionTail(folder)
        self._setting = setting
        self._expectation: Expectation | None = None
        self._looked_at: FrameRecord | None = None

    def newest(self) -> LastFrame | None:
        """The newest frame; None when it was looked at already."""
        self._tail.follow()
        record = self._tail.last
        plan = self._setting.plan
        if record is None or record == self._looked_at or plan is None:
            return None
        self._looked_at = record
        if self._expectation is None:
            self._expectation = Expectation(
                plan,
                self._setting.projector_px,
                self._tail.frames,
                lambda line: small(self._tail.picture(line)),
                _places(self._setting),
            )
        picture = self._tail.picture(record)
        reduced = small(picture)
        expected = self._expectation.of(record, reduced)
        about = record.model_dump(mode="json", exclude={"file"})
        light = {"measured": expected.light, "expected": expected.expected_light}
        seen = {"light": light, "proofs": asdict(self._tail.proofs())}
        return LastFrame(picture, about | seen, compared(reduced, expected))


def _places(setting: Setting) -> Places | None:
    """Columns and rows of the geometry profile that the plan names."""
    if setting.geometry is None:
        return None
    path = Path(setting.geometry)
    maps = read_maps(path, read_profile(path)[0])
    return maps["column"], maps["row"]
