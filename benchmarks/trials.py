"""Sessions drawn at random: plan, bench and what is wrong with it, each from a seed alone."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from acquire.bench_file import SimSection
from acquire.errors import PlanError
from acquire.plan import Plan
from acquire.plan_file import parse_plan
from benchmarks.mishaps import COMMON, OF_THE_BENCH

SCENES = ("corner", "groove", "board")
SIZES_PX = (((48, 64), (144, 192)), ((64, 96), (192, 256)), ((96, 96), (192, 256)))
CHECKER_SHIFTS = ((2, 1), (2, 2), (4, 1), (4, 2), (3, 3), (4, 4), (6, 6))
LINE_SHIFTS = (2, 3, 4, 5, 6, 8, 12)
FAMILIES = ("checker", "stripes-columns", "stripes-rows", "sinusoid-columns", "sinusoid-rows")
PITCHES_PX = (4, 6, 8, 10, 12, 16, 20, 24, 32, 40, 48)
EXPOSURES_S = (0.1, 0.05, 0.025, 0.01)
MOST_FRAMES = 160


@dataclass(frozen=True, slots=True)
class Trial:
    """A session to capture.

    Parameters
    ----------
    seed
        It was drawn from this.
    plan, section
        What to show, and on which bench.
    rate
        Probability of each mishap in `benchmarks.mishaps.ADDED` for each exposure.
    noise
        Standard deviation at full scale, of shots and of the read-out, in parts of it.
    """

    seed: int
    plan: Plan
    section: SimSection
    rate: float
    noise: tuple[float, float]

    def __str__(self) -> str:
        section, patterns = self.section, self.plan.patterns
        kinds = sorted({(p.family.value, p.pitch_px) for p in patterns if p.pitch_px})
        lamp = f"drift {section.drift:+.0%}, flicker {section.flicker:.0%}"
        return (
            f"{self.seed}: {section.scene} {section.camera_px[1]} × {section.camera_px[0]}, "
            f"{kinds[0][0]} {[pitch for _, pitch in kinds]}, {len(patterns)} frames, "
            f"{sum(p.family.is_reference for p in patterns)} references; noise "
            f"{self.noise[0]:.1%} + {self.noise[1]:.1%}, blur {section.blur_px:.1f} px, "
            f"gamma {section.gamma:.1f}, ambient {section.ambient:.0%}, black "
            f"{section.black_level:.1%}, moved {section.move_px:.1f} px, "
            f"{lamp} "
            f"at {self.plan.camera.exposure_s} s; {section.late:.1%} each"
        )


def trial(seed: int, rate: float | None = None) -> Trial:
    """Draw a session.

    With a `rate`, only frames that are late, dropped or swapped go wrong, each at that rate.
    """
    chance = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(11,)))
    camera_px, projector_px = SIZES_PX[chance.integers(len(SIZES_PX))]
    exposure_s = float(chance.choice(EXPOSURES_S))
    gamma = float(chance.choice([1.0, chance.uniform(1, 2.6)]))
    plan = None
    while plan is None:
        with suppress(PlanError):  # a plan that cannot be measured is refused: draw again
            text = _plan_text(chance, projector_px, exposure_s, gamma)
            plan = parse_plan(text, f"trial {seed}")
    drawn = float(chance.choice([0.002, 0.005, 0.01]))
    noise = float(chance.uniform(0.001, 0.02)), float(chance.uniform(0, 0.01))
    range_e = 1 / noise[0] ** 2
    iso = plan.camera.iso or 200
    section = SimSection(
        scene=SCENES[chance.integers(len(SCENES))],
        seed=1000 * seed,
        camera_px=camera_px,
        projector_px=projector_px,
        full_well_e=range_e * iso / 200,
        read_noise_e=noise[1] * range_e,
        gamma=gamma,
        black_level=_sometimes(chance, chance.uniform(0, 0.03)),
        blur_px=_sometimes(chance, chance.uniform(0, 1.5)),
        drift=_sometimes(chance, chance.uniform(-0.2, 0.2)),
        flicker=_sometimes(chance, chance.uniform(0, 0.3)),
        ambient=_sometimes(chance, chance.uniform(0, 0.2)),
        move_px=_sometimes(chance, chance.uniform(0, 0.5)),
        **dict.fromkeys(OF_THE_BENCH, drawn) if rate is None else dict.fromkeys(COMMON, rate),
    )
    return Trial(seed, plan, section, drawn if rate is None else 0.0, noise)


def _plan_text(
    chance: np.random.Generator, projector_px: tuple[int, int], exposure_s: float, gamma: float
) -> str:
    """A plan whose brightest frames fill the sensor as in the reference exposure."""
    family = str(chance.choice(FAMILIES, p=[0.5, 0.15, 0.15, 0.1, 0.1]))
    if family == "checker":
        shifts = CHECKER_SHIFTS[chance.integers(len(CHECKER_SHIFTS))]
    else:
        count = int(chance.choice([n for n in LINE_SHIFTS if "stripes" in family or n > 2]))
        shifts = (count, count)
    frames = shifts[0] * shifts[1] if family == "checker" else shifts[0]
    usable = [pitch for pitch in PITCHES_PX if 4 * pitch <= min(projector_px)]
    most = min(6, len(usable), MOST_FRAMES // frames)
    number = int(chance.integers(min(2, most), most + 1))
    pitches = sorted(chance.choice(usable, number, replace=False).tolist())
    known_gamma = gamma if "sinusoid" in family else float(chance.choice([1.0, gamma]))
    every = int(chance.choice([0, 8, 20, 50]))
    return "\n".join(
        [
            f'[pattern]\nfamily = "{family}"\npitch_px = {pitches}\nshifts = {list(shifts)}',
            f"[references]\nevery_frames = {every}" if every else "",
            f"[camera]\nexposure_s = {exposure_s}\niso = {round(200 * 0.1 / exposure_s)}",
            f"[projector]\ngamma = {known_gamma}",
        ]
    )


def _sometimes(chance: np.random.Generator, value: float) -> float:
    """A value in half of the trials, else nothing."""
    return float(value) if chance.random() < 0.5 else 0.0
