"""Frames against what the geometry profile says that every pixel sees of their raster."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from acquire.errors import ProfileError
from acquire.plan import Plan
from acquire.profile_file import read_maps, read_profile
from acquire.proof.samples import FrameSamples, every_other
from acquire.proof.units import FAMILIES
from acquire.proof.white_black import WhiteBlack, spread_evenly
from acquire.session import Session
from acquire.session.store import PROFILES
from processing.patterns import Pattern
from processing.proof.finding import Finding
from processing.proof.parts import Parts
from processing.proof.places import Places, Sighting, known_to_px, shortest, sighting

# Samples that are looked at, evenly spread.
MOST_PLACES = 4000
# By how much a pattern is seen elsewhere than the one that it is.
ALIKE_PX = 1.0
PARTS = (2, 2), (4, 4)
# A quantity of profiles that were measured on a board in place of the scene.
OF_A_BOARD = "reprojection_px"


class Placement:
    """What samples see of the projector's raster, and what their frames show by it.

    Parameters
    ----------
    plan
        What should be shown.
    column, row
        float, (height, width) of the camera's picture: projector pixels, 0 at the centre of the
        first; NaN where none is known.
    projector_px
        (height, width).
    """

    def __init__(
        self,
        plan: Plan,
        column: NDArray[np.floating],
        row: NDArray[np.floating],
        projector_px: tuple[int, int],
    ) -> None:
        kept = every_other(column.shape)
        self._column = column[kept].astype(np.float64)
        self._row = row[kept].astype(np.float64)
        self._footprint_px = _footprint_px(column, row)
        self._projector_px = projector_px
        self._kinds = {(one.family, one.pitch_px) for one in plan.patterns}

    @property
    def known_to_px(self) -> float:
        """Projector pixels by which a pattern may stand elsewhere without being wrong."""
        return known_to_px(self._footprint_px)

    def sighting(
        self, pattern: Pattern, samples: FrameSamples, known: WhiteBlack, before: Pattern | None
    ) -> Sighting | None:
        """What an exposure shows; None where the profile says nothing of it.

        Parameters
        ----------
        pattern
            Of its step.
        samples
            Of its file.
        known
            White and black that were exposed alike.
        before
            What should have been shown before it; None where that is not known.
        """
        if pattern.family not in FAMILIES or samples.grid.shape != self._row.shape:
            return None
        chosen = self._looked_at(known)
        if chosen.size == 0:
            return None
        black, white, light = (
            one.grid.ravel()[chosen].astype(np.float64)
            for one in (known.black, known.white, samples)
        )
        places = Places(
            self._row.ravel()[chosen],
            self._column.ravel()[chosen],
            self._footprint_px,
            self._projector_px,
        )
        span = white - black
        relative = (light - black) / span
        variance = (2 * known.noise.at(light) + known.noise.at(white)) / span**2
        parts = self._parts(chosen)
        found = sighting(pattern, places, relative, variance, self._others(pattern), parts)
        if before is not None and _is_of(found, before, pattern):
            return replace(found, finding=Finding.PREVIOUS)
        return found

    def _looked_at(self, known: WhiteBlack) -> NDArray[np.int64]:
        """Samples that are lit and whose place is known."""
        placed = np.isfinite(self._row) & np.isfinite(self._column)
        return spread_evenly(known.usable & placed, MOST_PLACES)

    def _parts(self, chosen: NDArray[np.int64]) -> list[NDArray[np.int64]]:
        """Quarters and sixteenths of the picture, as places in what was chosen."""
        down, right = np.unravel_index(chosen, self._row.shape)
        return [
            np.flatnonzero(labels == label)
            for counts in PARTS
            for labels in (Parts.grid((down, right), self._row.shape, counts).labels,)
            for label in np.unique(labels)
        ]

    def _others(self, pattern: Pattern) -> list[Pattern]:
        """Of other families at this pitch, and of the plan's other pitches; at any shift."""
        kinds = self._kinds | {(family, pattern.pitch_px) for family in FAMILIES}
        kinds -= {(pattern.family, pattern.pitch_px)}
        return [Pattern(family, pitch) for family, pitch in sorted(kinds) if family in FAMILIES]


def placement_of(session: Session) -> Placement | None:
    """By the geometry profile that the plan names, as it lies in the session.

    None where the plan names none, where it was measured on a board in place of the scene, or
    where its copy is missing or not the one that the plan names.
    """
    digests = {use.sha256 for use in session.plan.calibration if use.kind == "geometry"}
    projector_px = session.projector_px
    if not digests or projector_px is None:
        return None
    path = session.folder / PROFILES / "geometry.json"
    try:
        profile, digest = read_profile(path)
        if digest not in digests or OF_A_BOARD in profile.quantities:
            return None
        maps = read_maps(path, profile)
    except ProfileError:
        return None
    return Placement(session.plan, maps["column"], maps["row"], projector_px)


def _is_of(found: Sighting, before: Pattern, pattern: Pattern) -> bool:
    """Whether a pattern stands where that of the picture before should."""
    kinds = {(one.family, one.pitch_px) for one in (before, pattern)}
    if found.displaced_px is None or len(kinds) > 1:
        return False
    down = before.shift_y_px - pattern.shift_y_px + found.displaced_px[0]
    right = before.shift_x_px - pattern.shift_x_px + found.displaced_px[1]
    return max(map(abs, shortest((down, right), pattern))) <= ALIKE_PX


def _footprint_px(column: NDArray[np.floating], row: NDArray[np.floating]) -> float:
    """Projector pixels from one camera pixel to the next, median over both directions."""
    steps = [np.hypot(np.diff(column, axis=axis), np.diff(row, axis=axis)) for axis in (0, 1)]
    known = np.concatenate([step[np.isfinite(step)] for step in steps])
    return float(np.median(known)) if known.size else 1.0
