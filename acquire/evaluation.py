"""A result against the truth: the table by which a decomposition is judged.

Relative error = ‖estimate − truth‖ / ‖truth‖ over measured pixels and all colours; beside it the
same after the best single gain for each colour, and single-pitch max/min at its finest pitch and
at the pitch that an oracle, who knows the truth, would choose.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from acquire.errors import ResultError, SessionError
from acquire.result import PixelClass, Result
from acquire.session.folder import read_plain
from processing.metrics import (
    EstimateError,
    best_assignment,
    errors_of,
    oracle,
    relative_error,
    relative_error_with_gains,
)

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
        ``finest pitch`` and at the ``oracle's pitch``; near and far range from the difference of
        two pitches, the ``oracle's pitches``.
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


def evaluate(
    result: Result, truth: dict[str, Image], done: Callable[[], object] = lambda: None
) -> Evaluation:
    """Compare every component, and single-pitch max/min beside it, with the truth.

    `done` is called after each of the `COMPARISONS`.
    """
    usable = result.mask == PixelClass.MEASURED
    for image in truth.values():
        usable &= np.isfinite(image).all(axis=-1)
    rows: list[Row] = []
    for compare in COMPARISONS:
        rows += compare(result, truth, usable)
        done()
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
    """Direct and global light at single pitches, as max/min reads them and freed from noise."""
    pitches = sorted(result.record.pitches, key=lambda pitch: pitch.pitch_px)
    labels = [f"{pitch.family} {pitch.pitch_px} px" for pitch in pitches]
    direct = [pitch.direct for pitch in pitches]
    wholes = {"direct": (truth.get("direct"), (result.pitch_image(path) for path in direct))}
    rest = [image for part, image in truth.items() if part != "direct"]
    shades = (result.pitch_image(pitch.global_) for pitch in pitches)
    wholes["global"] = (np.sum(rest, axis=0) if rest else None, shades)
    for whole, (target, images) in wholes.items():
        if target is not None:
            yield from _pitch_rows(whole, labels, errors_of(images, target, usable), "")
    corrected = [pitch.corrected for pitch in pitches if pitch.corrected is not None]
    if "direct" in truth and len(corrected) == len(pitches):
        estimates = (result.pitch_image(path) for path in corrected)
        found = errors_of(estimates, truth["direct"], usable)
        yield from _pitch_rows("direct", labels, found, ", noise corrected")


def _pitch_rows(
    whole: str, labels: list[str], errors: tuple[EstimateError, ...], how: str
) -> Iterator[Row]:
    for matching, one in (("finest pitch", errors[0]), ("oracle's pitch", oracle(errors))):
        yield Row(whole, labels[one.index] + how, matching, one.error, one.error_after_gains)


def _two_pitches(
    result: Result, truth: dict[str, Image], usable: NDArray[np.bool_]
) -> Iterator[Row]:
    """Near and far range from the finest pitch and one coarser, chosen by who knows the truth."""
    finest, *coarser = sorted(result.record.pitches, key=lambda pitch: pitch.pitch_px)
    parts = [part for part in PARTS[1:] if part in truth and np.any(truth[part][usable])]
    if not coarser:
        return
    direct, white = result.pitch_image(finest.direct), result.white
    for part in parts:
        near = part == "subsurface"
        images = (result.pitch_image(pitch.direct) for pitch in coarser)
        estimates = (image - direct if near else white - image for image in images)
        best = oracle(errors_of(estimates, truth[part], usable))
        other_px = coarser[best.index].pitch_px
        label = f"{other_px} less {finest.pitch_px} px" if near else f"white less {other_px} px"
        yield Row(part, label, "oracle's pitches", best.error, best.error_after_gains)


COMPARISONS = (_named, _assigned, _single_pitch, _two_pitches)
