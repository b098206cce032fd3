"""The plan as a person writes it: a few numbers in TOML, checked and written out in full."""

from __future__ import annotations

import tomllib
from importlib import resources
from itertools import groupby
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field, ValidationError, model_validator

from acquire.errors import PlanError
from acquire.plan import MAX_STEPS, CameraPlan, Plan, ProjectorPlan
from acquire.validation import StrictModel, explain
from processing.patterns import Family, Pattern, shift_grid, untoggled_fraction

WHITE = Pattern(Family.WHITE)
BLACK = Pattern(Family.BLACK)
MAX_PLAN_BYTES = 1_000_000
MIN_SINUSOID_PHASES = 3


class PatternGrid(StrictModel):
    """The patterns: one family at several pitches, each at a grid of shifts."""

    family: Literal[
        Family.CHECKER,
        Family.STRIPES_COLUMNS,
        Family.STRIPES_ROWS,
        Family.SINUSOID_COLUMNS,
        Family.SINUSOID_ROWS,
    ] = Family.CHECKER
    pitch_px: tuple[int, ...] = Field(min_length=1, max_length=1000)
    shifts: tuple[int, int] = (6, 6)
    span_pitches: tuple[int, int] | None = None

    @model_validator(mode="after")
    def _sensible(self) -> PatternGrid:
        for pitch_px in self.pitch_px:
            if not 1 <= pitch_px <= 100_000:
                raise ValueError(f"pitch_px: a pitch is 1 to 100000 projector pixels: {pitch_px}")
        if len(set(self.pitch_px)) != len(self.pitch_px):
            raise ValueError("pitch_px: a pitch is listed twice; list each once")
        if not all(1 <= count <= 1000 for count in self.shifts):
            raise ValueError(f"shifts: (down, right) are 1 to 1000 each, not {self.shifts}")
        if self.span_pitches and not all(1 <= span <= 8 for span in self.span_pitches):
            raise ValueError(f"span_pitches: (down, right) are 1 to 8, not {self.span_pitches}")
        if len(self.pitch_px) * self.shifts[0] * self.shifts[1] > MAX_STEPS:
            raise ValueError(f"shifts: more than {MAX_STEPS} frames in all")
        return self

    def patterns_at(self, pitch_px: int) -> tuple[Pattern, ...]:
        """Every different pattern of one pitch, in shift order."""
        down, right = self.shifts
        counts = (
            down if self.family.varies_down else 1,
            right if self.family.varies_right else 1,
        )
        default_span = (2, 1) if self.family is Family.CHECKER else (2, 2)
        grid = shift_grid(pitch_px, counts, self.span_pitches or default_span)
        patterns = (Pattern(self.family, pitch_px, *shift) for shift in grid)
        return tuple(dict.fromkeys(patterns))


class References(StrictModel):
    """White and black: at the start, and again after every so many pattern frames."""

    every_frames: int | None = Field(default=None, ge=1)


class CalibrationSection(StrictModel):
    """`[calibration]`: profiles of the bench, paths relative to the plan."""

    dark: Path | None = None
    noise: Path | None = None
    response: Path | None = None
    leak: Path | None = None
    latency: Path | None = None
    geometry: Path | None = None
    board: Path | None = None


class PlanFile(StrictModel):
    """A plan as written by a person; `plan` writes it out in full."""

    pattern: PatternGrid
    references: References = References()
    camera: CameraPlan = CameraPlan()
    projector: ProjectorPlan = ProjectorPlan()
    calibration: CalibrationSection = CalibrationSection()

    def plan(self) -> Plan:
        """Every exposure in order: references, then pitch by pitch, shift by shift."""
        shown = [pattern for p in self.pattern.pitch_px for pattern in self.pattern.patterns_at(p)]
        block = self.references.every_frames or len(shown)
        ordered: list[Pattern] = []
        for start in range(0, len(shown), block):
            ordered += [WHITE, BLACK, *shown[start : start + block]]
        if self.references.every_frames:
            ordered += [WHITE, BLACK]
        return Plan(camera=self.camera, projector=self.projector, patterns=tuple(ordered))


def read_plan_file(path: Path) -> PlanFile:
    """Read and validate a plan; raises `PlanError` naming the key and the reason."""
    try:
        if path.stat().st_size > MAX_PLAN_BYTES:
            raise PlanError(f"{path} is {path.stat().st_size} bytes: no plan is that long.")
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise PlanError(
            f"Cannot read the plan {path}: {error.strerror}. "
            "`lumisplit plan --example` prints one to start from."
        ) from error
    except UnicodeDecodeError as error:
        raise PlanError(f"{path} is not a text file in UTF-8; a plan is TOML.") from error
    return _parse(text, str(path))


def read_plan(path: Path) -> Plan:
    """Read, validate and write out a plan, without the profiles that its [calibration] names."""
    plan = read_plan_file(path).plan()
    check_measurable(plan)
    return plan


def parse_plan(text: str, name: str) -> Plan:
    """Validate the text of a plan; `name` stands in messages."""
    plan = _parse(text, name).plan()
    check_measurable(plan)
    return plan


def _parse(text: str, name: str) -> PlanFile:
    try:
        return PlanFile.model_validate(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise PlanError(f"{name} is not valid TOML: {error}.") from error
    except ValidationError as error:
        raise PlanError(f"{name} cannot be used:\n{explain(error)}") from error


def example_text() -> str:
    """The commented plan of the paper."""
    return resources.files("acquire").joinpath("examples/paper.toml").read_text(encoding="utf-8")


def check_measurable(plan: Plan) -> None:
    """Refuse a plan whose frames cannot be separated at some pitch."""
    shown = (pattern for pattern in plan.patterns if pattern.family.is_separable)
    for (family, pitch_px), members in groupby(
        sorted(shown, key=_group), key=lambda pattern: (pattern.family, pattern.pitch_px)
    ):
        patterns = tuple(members)
        if family.is_binary:
            _check_toggles(patterns)
            continue
        phases = {round(pattern.phase % (2 * np.pi), 9) for pattern in patterns}
        if len(phases) < MIN_SINUSOID_PHASES:
            raise PlanError(
                f"pattern.shifts: {family} at pitch {pitch_px} has {len(phases)} different "
                f"phase(s), and a sinusoid has {MIN_SINUSOID_PHASES} unknowns. Ask for at least "
                f"{MIN_SINUSOID_PHASES} shifts along the direction in which it varies."
            )


def _group(pattern: Pattern) -> tuple[str, int]:
    return pattern.family.value, pattern.pitch_px


def _check_toggles(patterns: tuple[Pattern, ...]) -> None:
    never = untoggled_fraction(patterns)
    if never > 0:
        first = patterns[0]
        raise PlanError(
            f"pattern.shifts: at pitch {first.pitch_px} the {len(patterns)} shift(s) of "
            f"{first.family} leave {never:.1%} of the projector's pixels always lit or always "
            "dark; their direct light would read 0. Use more shifts, or shifts over 2 pitches "
            "down and 1 pitch right (the default span)."
        )


def check_fits(plan: Plan, resolution: tuple[int, int], bench: str) -> None:
    """Refuse a plan that the projector of a bench, (height, width) pixels, cannot show."""
    height, width = resolution
    wanted = plan.projector.resolution_px
    if wanted is not None and wanted != resolution:
        raise PlanError(
            f"projector.resolution_px: the plan is for {wanted[1]} × {wanted[0]} pixels, the "
            f"projector of {bench} has {width} × {height}. Correct the key or choose the bench."
        )
    for pattern in plan.patterns:
        too_tall = pattern.family.varies_down and pattern.pitch_px > height
        too_wide = pattern.family.varies_right and pattern.pitch_px > width
        if too_tall or too_wide:
            raise PlanError(
                f"pattern.pitch_px: a pitch of {pattern.pitch_px} px is wider than the projector "
                f"of {bench} ({width} × {height} px); it would show no pattern. Leave it out, or "
                "name another bench with --bench."
            )
