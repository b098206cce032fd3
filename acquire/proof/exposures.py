"""The exposures of a session that are still needed: their lines and their samples."""

from __future__ import annotations

from dataclasses import dataclass

from acquire.errors import ProofError
from acquire.proof.samples import FrameSamples
from acquire.session import FrameRecord


@dataclass(frozen=True, slots=True)
class Exposure:
    """A line of the session and the samples of its file."""

    record: FrameRecord
    samples: FrameSamples

    @property
    def contradictions(self) -> str:
        """Settings that the file has otherwise than asked, in words; empty where none."""
        asked = self.record.settings
        return "" if asked is None else ", ".join(self.samples.notes.contradictions(asked))


class Exposures:
    """Exposures by the number of their line, and which of them counts for each step."""

    def __init__(self) -> None:
        self._lines: dict[int, Exposure] = {}
        self._current: dict[int, int] = {}
        self._forgotten: set[int] = set()

    def add(self, number: int, record: FrameRecord, samples: FrameSamples) -> None:
        """Take in the exposure of line `number`, from 0; it counts for its step from now on."""
        known = next(iter(self._lines.values()), None)
        if known is not None and known.samples.grid.shape != samples.grid.shape:
            raise ProofError(
                f"Step {record.step}: its picture has another size than those before it. Set the "
                "camera to one size and full raw, and begin a new session."
            )
        self._lines[number] = Exposure(record, samples)
        self._current[record.step] = number
        self._forgotten.discard(record.step)

    def __contains__(self, step: int) -> bool:
        return step in self._current

    def __getitem__(self, step: int) -> Exposure:
        """The exposure that counts for a step."""
        return self._lines[self._current[step]]

    def line(self, number: int) -> Exposure:
        """The exposure of a line."""
        return self._lines[number]

    def before(self, step: int) -> Exposure | None:
        """The exposure that was made before that of a step, where it is kept."""
        return self._lines.get(self._current[step] - 1)

    def replaced(self, step: int) -> Exposure | None:
        """The exposure that that of a step was taken instead of, where it is kept."""
        own = self[step].record
        former = (line for line in self._lines.values() if line.record.step == step)
        return next((line for line in former if line.record.attempt == own.attempt - 1), None)

    def counts(self, exposure: Exposure) -> bool:
        """Whether an exposure is the one of its step that counts."""
        number = self._current.get(exposure.record.step)
        return number is not None and self._lines.get(number) is exposure

    def is_repeated(self, step: int) -> bool:
        """The file is that of the exposure before, although another raster was shown."""
        before, own = self.before(step), self[step].record
        if before is None or own.raster_sha256 is None:
            return False
        same = before.record.sha256 == own.sha256
        return same and before.record.raster_sha256 != own.raster_sha256

    def forget(self, steps: tuple[int, ...]) -> None:
        """Keep nothing of these steps but what a kept exposure, or the next one, comes after."""
        self._forgotten.update(steps)
        last = max(self._lines, default=-1)
        for number in sorted(self._lines, reverse=True):
            follower = self._lines.get(number + 1)
            is_before = follower is not None and follower.record.step not in self._forgotten
            forgotten = self._lines[number].record.step in self._forgotten
            if forgotten and number != last and not is_before:
                del self._lines[number]
        for step in self._forgotten & self._current.keys():
            if self._current[step] not in self._lines:
                del self._current[step]
