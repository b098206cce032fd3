"""Calibration of time: how late the light of a new pattern is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from acquire.calibrating.finding import Finding, Plot, Setting
from acquire.calibrating.light import Viewer
from acquire.calibrating.plots import points_plot
from acquire.errors import ProfileError
from acquire.plan import Plan, ProfileKind
from acquire.profile_file import Quantity
from acquire.session import Session
from calibration.errors import UnsupportedError
from calibration.timing import fit_latency
from processing.patterns import Family, Pattern

BLACK = Pattern(Family.UNIFORM, levels=(0,))
LEVELS = (255, 180, 128, 90, 64, 45, 32, 23, 16)
MARGIN = 1.5
LEAST_MARGIN_S = 0.02
BRIGHT_PERCENTILE = 99.5
MOST_SIGNAL = 0.85


@dataclass(frozen=True, slots=True)
class LatencyCalibration:
    """Exposures that begin as a pattern is shown, between black and the brightest usable grey.

    A first short plan finds that grey: at an exposure of some tenths of a second white would
    saturate.
    """

    kind: ProfileKind = "latency"
    purpose: str = "time from showing a pattern to its light on the sensor; sets settle_s"
    exposure_s: float = 0.6
    changes: int = 6
    standing: int = 2

    def plan(self, setting: Setting, sessions: Sequence[Session]) -> Plan | None:
        """A ramp of greys, then changes without settling, each pattern shown three times."""
        projector = setting.projector.model_copy(update={"settle_s": 0.0})
        camera = setting.camera.model_copy(update={"exposure_s": self.exposure_s})
        if not sessions:
            ramp = [Pattern(Family.UNIFORM, levels=(level,)) for level in LEVELS]
            # Each twice: the first may still hold the light before it.
            twice = [pattern for pattern in ramp for _ in range(2)]
            return Plan(camera=camera, projector=projector, patterns=(BLACK, BLACK, *twice))
        if len(sessions) > 1:
            return None
        grey = Pattern(Family.UNIFORM, levels=(_level(sessions[0]),))
        shown = (BLACK,) * (1 + self.standing) + (grey,) * (1 + self.standing)
        return Plan(camera=camera, projector=projector, patterns=shown * self.changes)

    def fit(self, sessions: Sequence[Session], frame_done: Callable[[], None]) -> Finding:
        """Delay of every change, from its share of the old light."""
        session = sessions[-1]
        signals, greys = _signals(session, frame_done)
        before = np.concatenate([[-1], greys[:-1]])
        changing = (greys != before) & (before >= 0)
        standing = np.zeros(len(greys), bool)
        standing[2:] = (greys[2:] == greys[1:-1]) & (greys[1:-1] == greys[:-2])
        if not changing.any() or len(set(greys.tolist())) != 2 or not standing.any():
            raise ProfileError(
                f"{session.folder} does not alternate between black and one grey; it was captured "
                "for something else."
            )
        exposure_s = session.plan.camera.exposure_s
        black, white = (
            float(signals[standing & ((greys > 0) == lit)].mean()) for lit in (False, True)
        )
        found = fit_latency(signals[changing], greys[changing] > 0, black, white, exposure_s)
        settle_s = max(MARGIN * found.longest_s, found.longest_s + LEAST_MARGIN_S)
        delays = 1000 * found.delays_s[:, np.newaxis]
        return Finding(
            quantities={
                "delay_s": Quantity(
                    meaning="from the start of an exposure asked for as the pattern is shown until "
                    "the pattern's light; the projector's delay less the trigger's",
                    unit="s",
                    value=(found.delay_s,),
                    uncertainty=(found.deviation_s,),
                ),
                "rising_s": Quantity(
                    meaning="of black to grey alone", unit="s", value=(found.rising_s,)
                ),
                "falling_s": Quantity(
                    meaning="of grey to black alone", unit="s", value=(found.falling_s,)
                ),
                "settle_s": Quantity(
                    meaning=f"advised: {MARGIN:g} times the longest delay seen",
                    unit="s",
                    value=(float(np.ceil(1000 * settle_s) / 1000),),
                ),
            },
            warnings=tuple(_warnings(found.delay_s)),
            plots=(
                Plot(
                    "Delay of every change",
                    points_plot(
                        np.arange(len(delays), dtype=float), delays, "change", "delay in ms"
                    ),
                    "Rising and falling in turn. A projector whose delay jumps by whole refreshes "
                    "shows levels 17 ms apart.",
                ),
            ),
        )


def _warnings(delay_s: float) -> list[str]:
    found = [
        "What is measured is the projector's delay less the time from asking the camera until its "
        "shutter opens: light alone cannot tell the two apart. settle_s needs just this "
        "difference, with this camera; another camera needs its own."
    ]
    if delay_s < 0.002:
        found.append(
            "The new light is there as the exposure begins: the camera's own delay is as long as "
            "the projector's or longer, and how much longer cannot be seen."
        )
    return found


def _signals(
    session: Session, frame_done: Callable[[], None]
) -> tuple[
    np.ndarray[tuple[int], np.dtype[np.float64]], np.ndarray[tuple[int], np.dtype[np.int64]]
]:
    """Mean signal of the lit pixels and the grey level of every frame."""
    viewer = Viewer(session, frame_done, steady=False)
    frames = viewer.all_of(Family.UNIFORM)
    signals, greys = [], []
    for frame, image in viewer.images(frames):
        if image.saturated.mean() > 1e-3:
            raise UnsupportedError(
                f"step {frame.step} saturates: lower the ISO or stop the lens down"
            )
        signals.append(float(image.values.mean(dtype=np.float64)))
        greys.append(max(frame.pattern.levels))
    return np.array(signals), np.array(greys, np.int64)


def _level(session: Session) -> int:
    """The brightest grey that does not saturate."""
    viewer = Viewer(session, lambda: None, steady=False)
    fitting = []
    for frame, image in viewer.images(viewer.all_of(Family.UNIFORM)):
        bright = float(np.percentile(image.values, BRIGHT_PERCENTILE))
        if frame.pattern.levels != (0,) and not image.saturated.any() and bright < MOST_SIGNAL:
            fitting.append(max(frame.pattern.levels))
    twice = [level for level in fitting if fitting.count(level) == 2]
    if not twice:
        raise UnsupportedError(
            f"even the darkest grey saturates in {session.plan.camera.exposure_s:g} s: stop the "
            "lens down or lower the ISO"
        )
    return max(twice)
