"""The simulated bench: a projector and a camera that share one scene and one clock.

Everything random about an exposure is drawn from (seed, number of the exposure, attempt), never
from what happened before, and the light on the scene is known from the last raster alone. A
bench can therefore be opened at any position of a run and delivers from there, byte for byte,
what an uninterrupted run would have.
"""

from __future__ import annotations

import itertools
from collections.abc import Generator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from drivers.errors import CameraError, CameraTimeoutError, ProjectorError
from drivers.protocols import CameraSettings, Raster, RawFrame
from drivers.raster import check_raster
from drivers.sim.clock import EPOCH_S, PacedClock, SimulatedClock
from drivers.sim.defects import Defects
from drivers.sim.dng import MEDIA_TYPE, encode_dng
from drivers.sim.scene import scene_named
from drivers.sim.sensor import REFERENCE, REFERENCE_LEVEL, check_settings, expose, exposure_gain
from drivers.sim.stage import Chance, Stage
from drivers.sim.transport import Light, Transport, superpixels

DELIVERY_S = 0.05
LIVE_FRAME_S = 0.1
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


class SimulatedProjector:
    """A projector on the simulated bench (see `drivers.protocols.Projector`).

    Parameters
    ----------
    stage
        What it shares with the camera.
    settle_s
        Time that `show` takes.
    """

    def __init__(self, stage: Stage, settle_s: float) -> None:
        self._stage = stage
        self._settle_s = settle_s
        self._open = True

    @property
    def resolution(self) -> tuple[int, int]:
        """(height, width) in projector pixels."""
        return self._stage.transport.projector_px

    def show(self, raster: Raster) -> None:
        """Show a raster and let it settle."""
        check_raster(raster, self.resolution)
        if not self._open:
            raise ProjectorError("the projector is closed; open the bench again")
        self._stage.command(raster)
        self._stage.clock.sleep(self._settle_s)

    def check(self) -> None:
        """Nothing can pull the cable of a simulated projector; only closing ends what it shows."""
        if not self._open:
            raise ProjectorError("the projector is closed; open the bench again")

    def close(self) -> None:
        """Go black."""
        if self._open:
            self._stage.command(None)
        self._open = False


class SimulatedCamera:
    """A camera on the simulated bench (see `drivers.protocols.Camera`).

    Parameters
    ----------
    stage
        What it shares with the projector.

    Attributes
    ----------
    ahead_s
        How far its clock, which its files tell, is ahead of the bench's.
    """

    def __init__(self, stage: Stage) -> None:
        self.ahead_s = 0.0
        self._stage = stage
        self._open = True
        self._settings = REFERENCE

    def capture(self, settings: CameraSettings) -> RawFrame:
        """Expose once; the file is a DNG."""
        if not self._open:
            raise CameraError("the camera is closed; open the bench again")
        check_settings(settings)
        self._settings = settings
        stage = self._stage
        started_s = stage.clock.now()
        chance = stage.chance()
        if chance.timed_out:
            stage.attempt += 1
            stage.clock.sleep(settings.exposure_s + TIMEOUT_S)
            raise CameraTimeoutError(f"no file {TIMEOUT_S:g} s after exposure {stage.index}")
        if chance.swapped and stage.file_delivered_last is not None:
            data = stage.file_delivered_last
        else:
            data = self._file(settings, chance)
        stage.clock.sleep(settings.exposure_s)
        stage.clock.sleep(DELIVERY_S)
        stage.delivered(data)
        return RawFrame(data, MEDIA_TYPE, settings, started_s, stage.clock.now())

    def live_view(self, settings: CameraSettings | None = None) -> Generator[bytes]:
        """DNG files of what is on the scene; the frames of the run are as if never looked at."""
        if settings is not None:
            check_settings(settings)
            self._settings = settings
        for number in itertools.count():
            if not self._open:
                raise CameraError("the camera is closed; open the bench again")
            yield self._file(self._settings, self._stage.live_chance(number))
            self._stage.clock.sleep(LIVE_FRAME_S)

    def read_back(self) -> CameraSettings | None:
        """The settings of the last exposure or live view."""
        return self._settings

    def close(self) -> None:
        """Let the sensor go."""
        self._open = False

    def _file(self, settings: CameraSettings, chance: Chance) -> bytes:
        stage = self._stage
        if stage.defects.iso_turned is not None and stage.is_second_half:
            settings = replace(settings, iso=round(stage.defects.iso_turned))
        counts = expose(
            stage.signal(settings, chance),
            settings.iso,
            stage.defects.full_well_e,
            stage.defects.read_noise_e,
            chance.noise,
        )
        return encode_dng(counts, settings, stage.clock.now() + self.ahead_s)


@dataclass(frozen=True, slots=True)
class SimulatedBench:
    """A simulated projector, camera and clock, and the truth about their scene."""

    projector: SimulatedProjector
    camera: SimulatedCamera
    clock: SimulatedClock
    stage: Stage

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
        black = self.stage.emitted(np.zeros(self.projector.resolution, np.uint8))
        white = self.stage.emitted(np.full(self.projector.resolution, 255, np.uint8))
        return self._scaled(self.stage.transport.parts(white - black), settings)

    def components(
        self, raster: Raster, settings: CameraSettings | None = None
    ) -> Mapping[str, NDArray[np.float64]]:
        """The same parts for any raster, the projector's black level included."""
        check_raster(raster, self.projector.resolution)
        return self._scaled(self.stage.transport.parts(self.stage.emitted(raster)), settings)

    def projector_coordinates(self) -> NDArray[np.float64]:
        """(height, width, 2): the (row, column) of the projector that each camera pixel sees.

        Pixel centres are whole numbers; NaN where the camera pixel's centre sees no surface.
        """
        return self.stage.transport.coordinates

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
    *,
    real_time: bool = False,
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
    real_time
        Whether waiting takes as long as on a real bench; the files are the same.
    """
    if settle_s < 0 or frames_in_run < 1:
        raise ValueError(f"settle_s ≥ 0 and frames_in_run ≥ 1, not {settle_s}, {frames_in_run}")
    position = RunPosition() if position is None else position
    if position.raster_shown_last is not None:
        check_raster(position.raster_shown_last, config.projector_px)
    if config.defects.swapped and position.index and position.file_delivered_last is None:
        raise ValueError("where files are swapped, going on needs the file that was delivered last")
    transport = Transport.of(scene_named(config.scene), config.camera_px, config.projector_px)
    clock = (PacedClock if real_time else SimulatedClock)(position.time_s)
    stage = Stage(
        transport,
        config.defects,
        config.seed,
        frames_in_run,
        clock,
        position.index,
        position.raster_shown_last,
        position.file_delivered_last,
    )
    return SimulatedBench(SimulatedProjector(stage, settle_s), SimulatedCamera(stage), clock, stage)
