"""A result against the truth: the table by which a decomposition is judged.

Relative error = ‖estimate − truth‖ / ‖truth‖ over measured pixels and all colours; beside it the
same after the best single gain for each colour, and single-pitch max/min at its finest pitch and
at the pitch that an oracle, who knows the truth, would choose.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from acquire.errors import ResultError, SessionError
from acquire.result import PixelClass, Result
from acquire.session.folder import read_plain
from processing.metrics import best_assignment, relative_error, relative_error_with_gains

PARTS = ("direct", "subsurface", "interreflection")
MAX_TRUTH_BYTES = 8 << 30
Image = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the table.

    Parameters
    ----------
    truth
        The part of light that is compared.
    estimate
        What stands for it.
    matching
        ``named`` under its own name, ``assigned`` by best assignment, or max/min at the
        ``finest pitch`` and at the ``oracle's pitch``.
    error, error_after_gains
        Relative errors; NaN where the truth is zero.
    """

    truth: str
    estimate: str
    matching: str
    error: float
    error_after_gains: float


@dataclass(frozen=True, slots=True)
class Evaluation:
    """The table and over how many pixels it was computed."""

    method: str
    rows: tuple[Row, ...]
    pixels: int
    excluded: int


def read_truth(path: Path, shape: tuple[int, int]) -> dict[str, Image]:
    """The parts of light in a truth file, each (height, width, 3), checked before loading."""
    wanted = (*shape, 3)
    try:
        archive = zipfile.ZipFile(io.BytesIO(read_plain(path, MAX_TRUTH_BYTES)))
        names = {info.filename: info.file_size for info in archive.infolist()}
        parts = {}
        for part in PARTS:
            if f"{part}.npy" not in names:
                continue
            if names[f"{part}.npy"] > np.prod(wanted) * 8 + 4096:
                raise ResultError(f"{path}: {part} is larger than {wanted} (the result's shape).")
            with archive.open(f"{part}.npy") as file:
                parts[part] = np.lib.format.read_array(file, allow_pickle=False)
    except (zipfile.BadZipFile, ValueError, EOFError, SessionError) as error:
        raise ResultError(
            f"Cannot read the truth {path}: {error} A truth file is an npz with any of "
            f"{', '.join(PARTS)}."
        ) from error
    if not parts:
        raise ResultError(f"{path} holds none of {', '.join(PARTS)}.")
    for part, image in parts.items():
        if image.shape != wanted or image.dtype.kind not in "fiu":
            raise ResultError(
                f"{path}: {part} is {image.shape} {image.dtype}, the result {wanted}."
            )
    return {part: np.asarray(image, np.float32) for part, image in parts.items()}


def evaluate(result: Result, truth: dict[str, Image]) -> Evaluation:
    """Compare every component, and single-pitch max/min beside it, with the truth."""
    usable = result.mask == PixelClass.MEASURED
    for image in truth.values():
        usable &= np.isfinite(image).all(axis=-1)
    rows = [
        *_named(result, truth, usable),
        *_assigned(result, truth, usable),
        *_single_pitch(result, truth, usable),
    ]
    return Evaluation(
        result.record.method, tuple(rows), int(usable.sum()), int(usable.size - usable.sum())
    )


def _row(
    part: str, estimate: str, matching: str, image: Image, truth: Image, usable: NDArray[np.bool_]
) -> Row:
    return Row(
        part,
        estimate,
        matching,
        relative_error(image, truth, usable),
        relative_error_with_gains(image, truth, usable),
    )


def _named(result: Result, truth: dict[str, Image], usable: NDArray[np.bool_]) -> Iterator[Row]:
    for part, image in truth.items():
        if part in result.record.components:
            yield _row(part, part, "named", result.component(part), image, usable)


def _assigned(result: Result, truth: dict[str, Image], usable: NDArray[np.bool_]) -> Iterator[Row]:
    parts = [part for part in truth if np.any(truth[part][usable])]
    names = result.record.components
    if not parts or len(parts) > len(names):
        return
    components = np.stack([result.component(name) for name in names])
    truths = np.stack([truth[part] for part in parts])
    chosen = best_assignment(components, truths, usable).components
    for part, index in zip(parts, chosen, strict=True):
        yield _row(part, names[index], "assigned", components[index], truth[part], usable)


def _single_pitch(
    result: Result, truth: dict[str, Image], usable: NDArray[np.bool_]
) -> Iterator[Row]:
    wholes = {"direct": truth.get("direct")}
    rest = [image for part, image in truth.items() if part != "direct"]
    wholes["global"] = np.sum(rest, axis=0) if rest else None
    for whole, target in wholes.items():
        if target is None:
            continue
        rows = []
        for pitch in sorted(result.record.pitches, key=lambda pitch: pitch.pitch_px):
            path = pitch.direct if whole == "direct" else pitch.global_
            label = f"{pitch.family} {pitch.pitch_px} px"
            image = result.pitch_image(path)
            rows.append(_row(whole, label, "finest pitch", image, target, usable))
        best = min(rows, key=lambda row: row.error)
        yield rows[0]
        yield Row(whole, best.estimate, "oracle's pitch", best.error, best.error_after_gains)
