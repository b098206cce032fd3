"""What the scene of a simulated bench receives as a function of time, and what befalls a frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.protocols import CameraSettings, Raster
from drivers.sim.clock import SimulatedClock
from drivers.sim.defects import Defects
from drivers.sim.lamp import emission, flicker_gain
from drivers.sim.sensor import exposure_gain
from drivers.sim.transport import Transport

LIVE_KEY = (9,)


@dataclass(frozen=True, slots=True)
class Chance:
    """What befalls one attempt at one exposure.

    `drawn` is the part of the rows, from the top, that show the raster where it is torn.
    """

    late: bool
    dropped: bool
    swapped: bool
    timed_out: bool
    flicker_phase_rad: float
    noise: np.random.Generator
    drawn: float | None = None


class Stage:
    """The joint between projector and camera: the scene, its light, the run's defects.

    Parameters
    ----------
    transport, defects, clock
        The scene, what is wrong, and the time.
    seed
        Of all randomness, ≥ 0.
    frames_in_run
        Number of exposures over which drift and motion spread.
    index
        Number of frames delivered before.
    shown
        The raster on the scene; None for black.
    file_delivered_last
        The last frame's bytes, if there is one.
    """

    def __init__(
        self,
        transport: Transport,
        defects: Defects,
        seed: int,
        frames_in_run: int,
        clock: SimulatedClock,
        index: int,
        shown: Raster | None,
        file_delivered_last: bytes | None,
    ) -> None:
        self.transport = transport
        self.defects = defects
        self.clock = clock
        self.index = index
        self.attempt = 0
        self.file_delivered_last = file_delivered_last
        self._seed = seed
        self._frames_in_run = frames_in_run
        self._black: Raster = np.zeros(transport.projector_px, np.uint8)
        self._current: Raster = self._black if shown is None else shown.copy()
        self._previous: Raster = self._current
        self._arrival_s = -np.inf

    def command(self, raster: Raster | None) -> None:
        """The projector is told, now, to show a raster; None is black."""
        self._previous = self._current
        self._current = self._black if raster is None else raster.copy()
        self._arrival_s = self.clock.now() + self.defects.latency_s

    def delivered(self, data: bytes) -> None:
        """An exposure is over: whatever was still on its way has arrived."""
        self.index += 1
        self.attempt = 0
        self.file_delivered_last = data
        self._previous = self._current
        self._arrival_s = -np.inf

    def chance(self) -> Chance:
        """What befalls the exposure that begins now."""
        sequence = np.random.SeedSequence((self._seed, self.index, self.attempt))
        fate_seed, noise_seed = sequence.spawn(2)
        fate = np.random.default_rng(fate_seed).random(7)
        late, dropped, swapped, timed_out, turn, torn, part = fate
        defects = self.defects
        return Chance(
            late=late < defects.late,
            dropped=dropped < defects.dropped,
            swapped=swapped < defects.swapped,
            timed_out=timed_out < defects.timeouts,
            flicker_phase_rad=2 * np.pi * turn,
            noise=np.random.default_rng(noise_seed),
            drawn=0.1 + 0.8 * part if torn < defects.torn else None,
        )

    def live_chance(self, number: int) -> Chance:
        """The noise of a frame that is only looked at, from a sequence of its own."""
        sequence = np.random.SeedSequence((self._seed, number), spawn_key=LIVE_KEY)
        noise = np.random.default_rng(sequence)
        turn = float(noise.random())
        return Chance(
            late=False,
            dropped=False,
            swapped=False,
            timed_out=False,
            flicker_phase_rad=2 * np.pi * turn,
            noise=noise,
        )

    def signal(self, settings: CameraSettings, chance: Chance) -> NDArray[np.float64]:
        """Expected light of an exposure that begins now, fraction of the sensor's range."""
        defects = self.defects
        run = self.index / max(self._frames_in_run - 1, 1)
        lamp = (1 + defects.drift * run) * flicker_gain(
            defects.flicker, chance.flicker_phase_rad, settings.exposure_s
        )
        emitted = self._emitted(settings.exposure_s, chance)
        if defects.shade and self.is_second_half:
            emitted = emitted.copy()
            emitted[:, : round(defects.shade * emitted.shape[1])] = 0
        light = self.transport.photosites(emitted)
        moved = shifted(light, defects.move_px * run)
        return exposure_gain(settings) * (lamp * moved + defects.ambient)

    @property
    def is_second_half(self) -> bool:
        """Whether half of the run is over."""
        return 2 * self.index >= self._frames_in_run

    def emitted(self, raster: Raster) -> NDArray[np.float64]:
        """Light of the projector's pixels under a raster, fraction of white."""
        blur_px = self.defects.blur_px * self.transport.projector_px_per_camera_px
        return emission(raster, self.defects.gamma, self.defects.black_level, blur_px)

    def displayed(self, chance: Chance) -> Raster:
        """What the projector shows when whatever was on its way has arrived."""
        if chance.dropped:
            return self._black
        if chance.late:
            return self._projected(self._previous)
        if chance.drawn is not None:
            return self._projected(_torn(self._current, self._previous, chance.drawn))
        return self._projected(self._current)

    def _projected(self, raster: Raster) -> Raster:
        """Where the projector's optics put a raster."""
        defects = self.defects
        if not self.is_second_half or (defects.slip_px == 0 and defects.zoom == 1):
            return raster
        return _moved(raster, round(defects.slip_px), defects.zoom)

    @property
    def commanded(self) -> Raster:
        """The raster that the projector was told to show last."""
        return self._current

    def _emitted(self, exposure_s: float, chance: Chance) -> NDArray[np.float64]:
        light = self.emitted(self.displayed(chance))
        old = float(np.clip((self._arrival_s - self.clock.now()) / exposure_s, 0, 1))
        if old == 0 or chance.dropped or chance.late or chance.drawn is not None:
            return light
        before = self.emitted(self._projected(self._previous))
        if light.ndim != before.ndim:
            light, before = (
                frame if frame.ndim == 3 else np.repeat(frame[..., np.newaxis], 3, axis=2)
                for frame in (light, before)
            )
        return old * before + (1 - old) * light


def _torn(raster: Raster, previous: Raster, drawn: float) -> Raster:
    """The upper rows of one raster over the lower ones of another."""
    first, second = (
        one if raster.ndim == previous.ndim or one.ndim == 3 else np.repeat(one[..., None], 3, 2)
        for one in (raster, previous)
    )
    row = round(drawn * len(first))
    return np.concatenate([first[:row], second[row:]])


def _moved(raster: Raster, slip_px: int, zoom: float) -> Raster:
    """A raster moved to the right and larger about its middle, its nearest pixels; black around."""
    inside, places = [], []
    for size, slip in zip(raster.shape, (0, slip_px), strict=False):
        middle = (size - 1) / 2
        place = np.rint((np.arange(size) - slip - middle) / zoom + middle).astype(np.int64)
        inside.append((place >= 0) & (place < size))
        places.append(np.clip(place, 0, size - 1))
    moved = raster[np.ix_(*places)]
    moved[~np.outer(*inside)] = 0
    return moved


def shifted(mosaic: NDArray[np.float64], shift_px: float) -> NDArray[np.float64]:
    """A Bayer mosaic whose picture is moved to the right, each colour on its own grid.

    Parameters
    ----------
    mosaic
        (2·height, 2·width) photosites.
    shift_px
        In camera pixels (quads); what enters at the edge repeats the edge.
    """
    if shift_px == 0:
        return mosaic
    height, width = mosaic.shape
    from_px = np.clip(np.arange(width // 2) - shift_px, 0, width // 2 - 1)
    left = np.minimum(from_px.astype(np.int64), max(width // 2 - 2, 0))
    part = (from_px - left)[:, np.newaxis]
    quads = mosaic.reshape(height, width // 2, 2)
    return ((1 - part) * quads[:, left] + part * quads[:, left + 1]).reshape(height, width)
