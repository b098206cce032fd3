"""Independent vector analysis, as in the paper."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from acquire.errors import StackError
from acquire.methods.components import Components, OfPitches, Told, cautions_of, or_none
from acquire.pitches import SeparatedPitches, open_rows
from acquire.result import MixingRecord, PixelClass
from processing.independence.decomposition import decompose_iva
from processing.patterns import Family

PAPERS_COMPONENTS = 3
IVA_INTERVAL = (
    "95 % confidence of α as the separation found it, by separating again without each tenth of "
    "the picture, the principal components given"
)


class Iva(OfPitches):
    """Independent vector analysis, as in the paper; see `processing.independence.decomposition`."""

    def __init__(
        self, n_components: int | None, n_iterations: int, smoothing_px: float | None
    ) -> None:
        self._n_components, self._n_iterations = n_components, n_iterations
        self._smoothing_px = smoothing_px

    def decompose(
        self,
        folder: Path,
        separated: SeparatedPitches,
        told: Told,
    ) -> Components:
        """Unmix the direct images of the resolved pitches and white."""
        resolved = separated.resolved
        n_components = self._n_components or min(PAPERS_COMPONENTS, len(resolved) + 1)
        check_components(len(resolved), n_components, "resolved ")
        try:
            found = decompose_iva(
                [*open_rows(folder, resolved), separated.white],
                [*(float(pitch.pitch_px) for pitch in resolved), np.inf],
                separated.mask == PixelClass.MEASURED,
                n_components=n_components,
                n_iterations=self._n_iterations,
                smoothing_px=self._smoothing_px,
                progress=told,
            )
        except ValueError as error:
            raise StackError(
                f"Independent vector analysis finds nothing to hold on to here: {error}. The "
                "direct and global images of single pitches need no decomposition."
            ) from error
        return Components(
            images=dict(zip(found.names, found.components, strict=True)),
            deviations={},
            white=separated.white,
            mixing=MixingRecord(
                families=(*(pitch.family for pitch in resolved), Family.WHITE),
                pitch_px=(*(pitch.pitch_px for pitch in resolved), None),
                alpha=found.mixing.tolist(),
                half_width=or_none(found.mixing_half_width),
                interval=IVA_INTERVAL,
            ),
            noise=found.noise,
            shares=tuple(found.shares.tolist()),
            cost=tuple(found.cost.tolist()),
            used={
                "method": "iva",
                "n_components": n_components,
                "significant_components": found.significant,
                "smoothing_px_used": found.smoothing_px,
            },
            cautions=cautions_of(found.warnings),
        )


def check_components(n_pitches: int, n_components: int, kind: str = "") -> None:
    """Refuse more components than there are observations of a pixel."""
    rows = n_pitches + 1
    if not 2 <= n_components <= rows:
        raise StackError(
            f"--components {n_components}: {n_pitches} {kind}pitch(es) and white light give {rows} "
            f"observations of a pixel, so 2 to {rows} components can be told apart."
        )
