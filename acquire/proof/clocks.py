"""The camera's own clock, as its files tell it, against one that nobody can set."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime

from acquire.proof.records import read_proofs
from acquire.session import Session

# Files may tell whole seconds of the exposure, the other clock the end of a delivery, which varies.
CAMERA_JUMP_S = 5.0
_FORMAT = "%Y:%m:%d %H:%M:%S"


def camera_clock_jumps(session: Session) -> Iterator[str]:
    """Jumps of the camera's clock from one judged exposure to the next, in words."""
    proofs = read_proofs(session.folder)
    before: tuple[int, float, float] | None = None
    for line in session.lines:
        proof = proofs.get((line.step, line.attempt))
        shown = None if proof is None else _seconds(proof.camera_time)
        if shown is None or line.monotonic_s is None:
            continue
        if before is not None:
            step, shown_before, true_before = before
            passed = line.monotonic_s - true_before
            jump = shown - shown_before - passed
            # That clock begins anew when the computer does.
            if passed >= 0 and abs(jump) > CAMERA_JUMP_S:
                yield (
                    f"The camera's clock jumped by {jump:+.0f} s between steps {step} and "
                    f"{line.step}; the order and the spacing of the frames are by another clock."
                )
        before = line.step, shown, line.monotonic_s


def _seconds(camera_time: str) -> float | None:
    second, _, part = camera_time.partition(".")
    try:
        whole = datetime.strptime(second, _FORMAT).replace(tzinfo=UTC).timestamp()
        return whole + float(f"0.{part or 0}")
    except ValueError:
        return None
