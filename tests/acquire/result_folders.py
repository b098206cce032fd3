"""Small result folders whose numbers are known, for tests of whatever reads a result."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import JsonValue

from acquire.plan import CameraPlan, ProjectorPlan
from acquire.result import (
    MaskRecord,
    MixingRecord,
    PitchRecord,
    PixelClass,
    Result,
    ResultRecord,
    SessionSummary,
    write_record,
    write_tiff,
)
from acquire.session.records import RunRecord, SourceRecord
from processing.patterns import Family

SIM: dict[str, JsonValue] = {"kind": "sim", "sim": {"scene": "corner", "seed": 7, "gamma": None}}
RUN = RunRecord(started_s=1.7e9, first_step=0, finished_s=1.7e9 + 60, outcome="complete")


def write_result(
    folder: Path,
    *,
    names: Sequence[str] = ("direct", "subsurface", "interreflection"),
    families: Sequence[Family] = (Family.CHECKER,),
    pitches_px: Sequence[int] = (8, 16, 32),
    shape: tuple[int, int] = (24, 32),
    pixel_class: PixelClass = PixelClass.MEASURED,
    bench: dict[str, JsonValue] = SIM,
    options: dict[str, JsonValue] | None = None,
    source: SourceRecord | None = None,
    runs: tuple[RunRecord, ...] = (RUN,),
    warnings: tuple[str, ...] = (),
    method: str = "iva",
    versions: dict[str, str] | None = None,
) -> Result:
    """Write a result in which component k carries (k + 1)/(1 + 2 + …) of the light.

    Direct light at every pitch is 0.6 of the white light; the upper left quarter of the pixels
    has `pixel_class`.
    """
    (folder / "components").mkdir(parents=True)
    (folder / "pitches").mkdir()
    height, width = shape
    mask = np.zeros(shape, np.uint8)
    mask[: height // 2, : width // 2] = pixel_class
    ramp = np.linspace(0.1, 1, height * width, dtype=np.float32).reshape(height, width, 1)
    white = (ramp * np.array([0.8, 0.6, 0.4], np.float32)).astype(np.float32)
    write_tiff(folder / "mask.tiff", mask)
    _write(folder / "white.tiff", white, mask)
    total = sum(range(1, len(names) + 1))
    for index, name in enumerate(names):
        _write(folder / f"components/{name}.tiff", white * ((index + 1) / total), mask)
    pitches = _write_pitches(folder, families, pitches_px, white, mask)
    saturated, unlit = (
        int((mask == kind).sum()) for kind in (PixelClass.SATURATED, PixelClass.UNLIT)
    )
    record = ResultRecord(
        method=method,
        options={"n_iterations": 10} if options is None else options,
        components=tuple(names),
        shape=shape,
        pitches=tuple(pitches),
        mixing=_mixing(pitches, len(names)),
        pca_shares=tuple(0.9 * 0.1**k for k in range(len(pitches) + 1)),
        convergence=(3.0, 2.5, 2.4),
        mask=MaskRecord(pixels=mask.size, saturated=saturated, unlit=unlit),
        noise=0.001,
        warnings=warnings,
        plan_sha256="0" * 64,
        session=_session(36 * len(pitches) + 2, bench, source, runs),
        versions={"lumisplit": "0.2.0"} if versions is None else versions,
    )
    write_record(folder, record)
    return Result.open(folder)


def _write_pitches(
    folder: Path,
    families: Sequence[Family],
    pitches_px: Sequence[int],
    white: NDArray[np.float32],
    mask: NDArray[np.uint8],
) -> list[PitchRecord]:
    pitches = []
    for family, pitch_px in itertools.product(families, pitches_px):
        stem = f"{pitch_px:04d}" if len(families) == 1 else f"{family.value}-{pitch_px:04d}"
        pitch = PitchRecord(
            family=family,
            pitch_px=pitch_px,
            shifts=36,
            direct=f"pitches/direct-{stem}.tiff",
            global_=f"pitches/global-{stem}.tiff",
        )
        _write(folder / pitch.direct, white * 0.6, mask)
        _write(folder / pitch.global_, white * 0.4, mask)
        pitches.append(pitch)
    return pitches


def _session(
    frames: int,
    bench: dict[str, JsonValue],
    source: SourceRecord | None,
    runs: tuple[RunRecord, ...],
) -> SessionSummary:
    return SessionSummary(
        plan_sha256="0" * 64,
        frames=frames,
        bench=bench,
        source=source,
        camera=CameraPlan(),
        projector=ProjectorPlan(),
        runs=runs,
        versions={"lumisplit": "0.1.0", "rawpy": "0.24.1"},
    )


def _write(path: Path, image: NDArray[np.float32], mask: NDArray[np.uint8]) -> None:
    known = np.where((mask == PixelClass.SATURATED)[..., np.newaxis], np.float32(np.nan), image)
    lit = np.where((mask == PixelClass.UNLIT)[..., np.newaxis], np.float32(0), known)
    write_tiff(path, lit.astype(np.float32))


def _mixing(pitches: Sequence[PitchRecord], n_components: int) -> MixingRecord:
    rows = [
        tuple(1 / (1 + k * pitch.pitch_px / 32) for k in range(n_components)) for pitch in pitches
    ]
    return MixingRecord(
        families=(*(pitch.family for pitch in pitches), Family.WHITE),
        pitch_px=(*(pitch.pitch_px for pitch in pitches), None),
        alpha=tuple((*rows, (1.0,) * n_components) for _ in range(3)),
    )
