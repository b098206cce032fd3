"""The simulated bench: a projector and a camera that share one scene and one clock.

Everything random about an exposure is drawn from (seed, number of the exposure, attempt), never
from what happened before, and the light on the scene is known from the last raster alone. A
bench can therefore be opened at any position of a run and delivers from there, byte for byte,
what an uninterrupted run would have.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from drivers.errors import CameraError, CameraTimeoutError, ProjectorError
from drivers.protocols import CameraSettings, Raster, RawFrame
from drivers.raster import check_raster
from drivers.sim.clock import EPOCH_S, SimulatedClock
from drivers.sim.defects import Defects
from drivers.sim.dng import MEDIA_TYPE, encode_dng
from drivers.sim.lamp import emission, flicker_gain
from drivers.sim.scene import scene_named
from drivers.sim.sensor import REFERENCE_LEVEL, check_settings, expose, exposure_gain
from drivers.sim.transport import Light, Transport, superpixels

DELIVERY_S = 0.05
TIMEOUT_S = 2.0


@dataclass(frozen=True, slots=True)
class SimulationConfig:
    """What is simulated.

    Parameters
    ----------
    scene
        Name of a scene, see `drivers.sim.scene.SCENES`.
    seed
        Of all randomness, ≥ 0.
    camera_px
        (height, width) of the measured image; the sensor has a 2 × 2 Bayer quad for each.
        At least 11 each way.
    projector_px
        (height, width) of the projector.
    defects
        What is wrong with the bench.
    """

    scene: str = "corner"
    seed: int = 0
    camera_px: tuple[int, int] = (96, 96)
    projector_px: tuple[int, int] = (288, 384)
    defects: Defects = field(default_factory=Defects)

    def __post_init__(self) -> None:
        scene_named(self.scene)
        # LibRaw reads no file of less than 22 photosites a side.
        for name, least in (("camera_px", 11), ("projector_px", 2)):
            size = getattr(self, name)
            if len(size) != 2 or min(size) < least or max(size) > 8192:
                raise ValueError(f"{name} is (height, width), each {least} to 8192, not {size}")
        if self.seed < 0:
            raise ValueError(f"seed must be at least 0, not {self.seed}")


@dataclass(frozen=True, slots=True)
class RunPosition:
    """A place in a run at which a bench can be opened.

    Parameters
    ----------
    index
        Number of frames delivered before.
    time_s
        The bench's clock when the last of them had been delivered.
    raster_shown_last
        What the projector showed for it; None for black, as before the first frame.
    file_delivered_last
        The last frame's bytes; needed only where files are `swapped`.
    """

    index: int = 0
    time_s: float = EPOCH_S
    raster_shown_last: Raster | None = None
    file_delivered_last: bytes | None = None


@dataclass(frozen=True, slots=True)
class _Chance:
    """What befalls one attempt at one exposure."""

    late: bool
    dropped: bool
    swapped: bool
    timed_out: bool
    flicker_phase_rad: float
    noise: np.random.Generator


class _SharedLight:
    """What the scene receives as a function of time: the joint between projector and camera."""

    def __init__(
        self,
        transport: Transport,
        defects: Defects,
        seed: int,
        frames_in_run: int,
        clock: SimulatedClock,
        position: RunPosition,
    ) -> None:
        self.transport = transport
        self.defects = defects
        self.clock = clock
        self.index = position.index
        self.attempt = 0
        self.file_delivered_last = position.file_delivered_last
        self._seed = seed
        self._frames_in_run = frames_in_run
        self._black: Raster = np.zeros(transport.projector_px, np.uint8)
        shown = position.raster_shown_last
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

    def chance(self) -> _Chance:
        """What befalls the exposure that begins now."""
        sequence = np.random.SeedSequence((self._seed, self.index, self.attempt))
        fate_seed, noise_seed = sequence.spawn(2)
        late, dropped, swapped, timed_out, turn = np.random.default_rng(fate_seed).random(5)
        defects = self.defects
        return _Chance(
            late=late < defects.late,
            dropped=dropped < defects.dropped,
            swapped=swapped < defects.swapped,
            timed_out=timed_out < defects.timeouts,
            flicker_phase_rad=2 * np.pi * turn,
            noise=np.random.default_rng(noise_seed),
        )

    def signal(self, settings: CameraSettings, chance: _Chance) -> NDArray[np.float64]:
        """Expected light of an exposure that begins now, fraction of the sensor's range."""
        defects = self.defects
        run = self.index / max(self._frames_in_run - 1, 1)
        lamp = (1 + defects.drift * run) * flicker_gain(
            defects.flicker, chance.flicker_phase_rad, settings.exposure_s
        )
        light = self.transport.photosites(self._emitted(settings.exposure_s, chance))
        moved = shifted(light, defects.move_px * run)
        return exposure_gain(settings) * (lamp * moved + defects.ambient)

    def emitted(self, raster: Raster) -> NDArray[np.float64]:
        """Light of the projector's pixels under a raster, fraction of white."""
        blur_px = self.defects.blur_px * self.transport.projector_px_per_camera_px
        return emission(raster, self.defects.gamma, self.defects.black_level, blur_px)

    def _emitted(self, exposure_s: float, chance: _Chance) -> NDArray[np.float64]:
        if chance.dropped:
            return self.emitted(self._black)
        if chance.late:
            return self.emitted(self._previous)
        old = float(np.clip((self._arrival_s - self.clock.now()) / exposure_s, 0, 1))
        light = self.emitted(self._current)
        if old == 0:
            return light
        before = self.emitted(self._previous)
        if light.ndim != before.ndim:
            light, before = (
                frame if frame.ndim == 3 else np.repeat(frame[..., np.newaxis], 3, axis=2)
                for frame in (light, before)
            )
        return old * before + (1 - old) * light


class SimulatedProjector:
    """A projector on the simulated bench (see `drivers.protocols.Projector`).

    Parameters
    ----------
    light
        What it shares with the camera.
    settle_s
        Time that `show` takes.
    """

    def __init__(self, light: _SharedLight, settle_s: float) -> None:
        self._light = light
        self._settle_s = settle_s
        self._open = True

    @property
    def resolution(self) -> tuple[int, int]:
        """(height, width) in projector pixels."""
        return self._light.transport.projector_px

    def show(self, raster: Raster) -> None:
        """Show a raster and let it settle."""
        check_raster(raster, self.resolution)
        if not self._open:
            raise ProjectorError("the projector is closed; open the bench again")
        self._light.command(raster)
        self._light.clock.sleep(self._settle_s)

    def close(self) -> None:
        """Go black."""
        if self._open:
            self._light.command(None)
        self._open = False


class SimulatedCamera:
    """A camera on the simulated bench (see `drivers.protocols.Camera`)."""

    def __init__(self, light: _SharedLight) -> None:
        self._light = light
        self._open = True

    def capture(self, settings: CameraSettings) -> RawFrame:
        """Expose once; the file is a DNG."""
        if not self._open:
            raise CameraError("the camera is closed; open the bench again")
        check_settings(settings)
        light = self._light
        started_s = light.clock.now()
        chance = light.chance()
        if chance.timed_out:
            light.attempt += 1
            light.clock.sleep(settings.exposure_s + TIMEOUT_S)
            raise CameraTimeoutError(
                f"no file {TIMEOUT_S:g} s after exposure {light.index}; try it again"
            )
        if chance.swapped and light.file_delivered_last is not None:
            data = light.file_delivered_last
        else:
            defects = light.defects
            signal = light.signal(settings, chance)
            counts = expose(
                signal, settings.iso, defects.full_well_e, defects.read_noise_e, chance.noise
            )
            data = encode_dng(counts, settings)
        light.clock.sleep(settings.exposure_s)
        light.clock.sleep(DELIVERY_S)
        light.delivered(data)
        return RawFrame(data, MEDIA_TYPE, settings, started_s, light.clock.now())

    def close(self) -> None:
        """Let the sensor go."""
        self._open = False


@dataclass(frozen=True, slots=True)
class SimulatedBench:
    """A simulated projector, camera and clock, and the truth about their scene."""

    projector: SimulatedProjector
    camera: SimulatedCamera
    clock: SimulatedClock
    light: _SharedLight

    def truth(self, settings: CameraSettings | None = None) -> Mapping[str, NDArray[np.float64]]:
        """Parts of the light of white minus black, noise-free, without ambient, drift and motion.

        Parameters
        ----------
        settings
            Exposure for which the values hold; None for 0.1 s, f/8, ISO 200.

        Returns
        -------
        ``direct``, ``subsurface`` and ``interreflection``, (height, width, 3) each, linear, as a
        fraction of the sensor's range: in the units of a decoded frame.
        """
        black = self.light.emitted(np.zeros(self.projector.resolution, np.uint8))
        white = self.light.emitted(np.full(self.projector.resolution, 255, np.uint8))
        return self._scaled(self.light.transport.parts(white - black), settings)

    def components(
        self, raster: Raster, settings: CameraSettings | None = None
    ) -> Mapping[str, NDArray[np.float64]]:
        """The same parts for any raster, the projector's black level included."""
        check_raster(raster, self.projector.resolution)
        return self._scaled(self.light.transport.parts(self.light.emitted(raster)), settings)

    def projector_coordinates(self) -> NDArray[np.float64]:
        """(height, width, 2): the (row, column) of the projector that each camera pixel sees.

        Pixel centres are whole numbers; NaN where the camera pixel's centre sees no surface.
        """
        return self.light.transport.coordinates

    @staticmethod
    def _scaled(parts: Light, settings: CameraSettings | None) -> Mapping[str, NDArray[np.float64]]:
        gain = REFERENCE_LEVEL if settings is None else exposure_gain(settings)
        return {
            name: gain * superpixels(getattr(parts, name))
            for name in ("direct", "subsurface", "interreflection")
        }


def build(
    config: SimulationConfig,
    frames_in_run: int = 1,
    settle_s: float = 0.0,
    position: RunPosition | None = None,
) -> SimulatedBench:
    """A bench as it stands at a position of a run.

    Parameters
    ----------
    config
        What is simulated.
    frames_in_run
        Number of exposures over which `drift` and `move_px` spread.
    settle_s
        Time that the projector's `show` takes.
    position
        Where the run goes on; None for its start.
    """
    if settle_s < 0 or frames_in_run < 1:
        raise ValueError(f"settle_s ≥ 0 and frames_in_run ≥ 1, not {settle_s}, {frames_in_run}")
    position = RunPosition() if position is None else position
    if position.raster_shown_last is not None:
        check_raster(position.raster_shown_last, config.projector_px)
    if config.defects.swapped and position.index and position.file_delivered_last is None:
        raise ValueError("where files are swapped, going on needs the file that was delivered last")
    transport = Transport.of(scene_named(config.scene), config.camera_px, config.projector_px)
    clock = SimulatedClock(position.time_s)
    light = _SharedLight(transport, config.defects, config.seed, frames_in_run, clock, position)
    return SimulatedBench(SimulatedProjector(light, settle_s), SimulatedCamera(light), clock, light)


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
