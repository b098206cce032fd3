"""A simulated camera whose frames go wrong in known ways, and what each of them really shows."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from acquire.bench_file import SimSection
from acquire.plan import Plan
from acquire.rig.bench import Bench, Resumption, closed_with
from acquire.rig.simulated import simulated_bench
from drivers.protocols import CameraSettings, Devices, Raster, RawFrame
from drivers.sim.defects import Defects
from drivers.sim.devices import SimulatedBench, SimulationConfig, build
from drivers.sim.sensor import exposure_gain

# Mishaps of the simulated bench itself, and those that are added here: the picture before, with
# fresh noise; the next one of the plan; any one of the plan; a mixture of the picture before and
# the right one; the right one drawn over black down to some row; a white window over part of it.
COMMON = ("late", "dropped", "swapped")
OF_THE_BENCH = ("late", "dropped", "swapped", "torn")
ADDED = ("repeated", "ahead", "stray", "blended", "cut", "overlay")
KEY = (7,)


@dataclass(frozen=True, slots=True)
class Exposure:
    """What befell an exposure.

    Parameters
    ----------
    fate
        The mishap's name, or ``good``.
    is_wrong
        The raster on the scene was not the one that should have been.
    visibility
        √(Σ difference²/variance) over the photosites, without and with noise of the sensor: what
        an observer who knows both pictures exactly has to tell them apart by. 0 where it is right.
    error
        Root mean square difference of the pictures in parts of the right one's mean light.
    """

    fate: str
    is_wrong: bool
    visibility: float = 0.0
    error: float = 0.0


@dataclass(slots=True)
class Witness:
    """A simulated camera that knows which raster each of its files shows."""

    bench: SimulatedBench
    plan: Plan
    seed: int
    rate: float
    shows: list[Exposure] = field(default_factory=list)
    _last: Raster | None = None

    def capture(self, settings: CameraSettings) -> RawFrame:
        """Expose, and note what befell the exposure and whether it shows what was asked for."""
        stage, wanted = self.bench.stage, self.bench.stage.commanded
        sequence = np.random.SeedSequence((self.seed, stage.index), spawn_key=KEY)
        own = self._mishap(wanted, np.random.default_rng(sequence))
        if own is not None:
            stage.command(own[1])
        chance = stage.chance()
        displayed = stage.displayed(chance)
        fate = "torn" if chance.drawn is not None else "good" if own is None else own[0]
        fate = "dropped" if chance.dropped else "late" if chance.late else fate
        if chance.swapped and self._last is not None:
            displayed, fate = self._last, "swapped"
        self.shows.append(self._exposure(fate, displayed, wanted, settings))
        frame = self.bench.camera.capture(settings)
        if own is not None:
            stage.command(wanted)
        self._last = displayed.copy()
        return frame

    def close(self) -> None:
        """Let the sensor go."""
        self.bench.camera.close()

    def _mishap(self, wanted: Raster, chance: np.random.Generator) -> tuple[str, Raster] | None:
        """A mishap's name and the raster that it puts on the scene."""
        number = int(chance.random() / self.rate) if self.rate else len(ADDED)
        if number >= len(ADDED):
            return None
        size = self.bench.projector.resolution
        before = np.zeros(size, np.uint8) if self._last is None else self._last
        part = chance.uniform(0.1, 0.9)
        made: Raster
        match ADDED[number]:
            case "repeated":
                made = before
            case "blended":
                made = np.rint(part * before + (1 - part) * wanted.astype(np.float64))
            case "cut":
                made = np.where(np.arange(size[0])[:, np.newaxis] < part * size[0], wanted, 0)
            case "overlay":
                made = wanted.copy()
                down, right = chance.uniform(0, 0.7, 2) * size
                height, width = chance.uniform(0.1, 0.4, 2) * size
                made[int(down) : int(down + height), int(right) : int(right + width)] = 255
            case "ahead" | "stray":
                made = self._other(wanted, chance, following=ADDED[number] == "ahead")
        return ADDED[number], made.astype(np.uint8)

    def _other(self, wanted: Raster, chance: np.random.Generator, *, following: bool) -> Raster:
        """Another raster of the plan: the one after, or any."""
        size = self.bench.projector.resolution
        at = [self.plan.projector.raster(pattern, size) for pattern in self.plan.patterns]
        if not following:
            return at[int(chance.integers(len(at)))]
        place = next(k for k, raster in enumerate(at) if np.array_equal(raster, wanted))
        return at[(place + 1) % len(at)]

    def _exposure(
        self, fate: str, displayed: Raster, wanted: Raster, settings: CameraSettings
    ) -> Exposure:
        if np.array_equal(displayed, wanted):
            return Exposure(fate, is_wrong=False)
        seen, right = self._light(displayed, settings), self._light(wanted, settings)
        defects = self.bench.stage.defects
        variance: NDArray[np.float64] | float = 1 / 12 / 15871**2
        if defects.full_well_e is not None:
            range_e = defects.full_well_e * 200 / (settings.iso or 200)
            variance = variance + right / range_e + (defects.read_noise_e / range_e) ** 2
        return Exposure(
            fate,
            is_wrong=True,
            visibility=float(np.sqrt(np.sum((seen - right) ** 2 / variance))),
            error=float(np.sqrt(np.mean((seen - right) ** 2)) / right.mean())
            if right.mean() > 0
            else float("inf"),
        )

    def _light(self, raster: Raster, settings: CameraSettings) -> NDArray[np.float64]:
        stage = self.bench.stage
        light = stage.transport.photosites(stage.emitted(raster)) + stage.defects.ambient
        return exposure_gain(settings) * light


def watched(section: SimSection, rate: float) -> tuple[Bench, list[Witness]]:
    """The bench of a file's section, with witnesses of what it shows.

    Parameters
    ----------
    section
        `[sim]` of a bench file.
    rate
        Probability, for each exposure, of each of the mishaps in `ADDED`.
    """
    witnesses: list[Witness] = []

    def connect(resumption: Resumption, closing: ExitStack) -> Devices:
        defects = {name: getattr(section, name) for name in Defects.__dataclass_fields__}
        config = SimulationConfig(
            section.scene, section.seed, section.camera_px, section.projector_px, Defects(**defects)
        )
        bench = build(config, len(resumption.plan), resumption.plan.projector.settle_s)
        witnesses.append(Witness(bench, resumption.plan, section.seed, rate))
        return closed_with(Devices(bench.projector, witnesses[-1], bench.clock), closing)

    return replace(simulated_bench(section), _connect=connect), witnesses
