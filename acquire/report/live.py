"""The light that the page itself computes with: reduced, packed and put into words for scripts.

A block of light is float32 rounded to its upper 3 bytes (16 significant bits: the error is at most
2⁻¹⁶ of a value, whatever the gain) or 2 (2⁻⁸), stored as planes of bytes, the highest first,
deflated, base64. Components with negative values keep all 4: in a mix they can cancel, and the
rest is seen under any exposure. What was not measured is 0 there; the flags say where.
"""

from __future__ import annotations

import base64
import json
import math
import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray
from pydantic import JsonValue

from acquire.remix import SATURATED_RGB, presets
from acquire.report.figures import RGB_LINES, colour_of
from acquire.report.pictures import UNLIT_RGB, block_any, reduced, reduction
from acquire.report.plates import pitch_label
from acquire.result import PixelClass, Result, ResultRecord

REMIX_PX, PITCH_PX = 900, 260
ALL_BYTES, EXACT_BYTES, COARSE_BYTES = 4, 3, 2
UNKNOWN, HAS_SATURATED, HAS_UNLIT = 1, 2, 4
UNCERTAIN_PERCENTILE = 98
RAMP = "viridis"
Light = NDArray[np.floating]


@dataclass(frozen=True, slots=True)
class Block:
    """Packed numbers and the name under which the scripts find them."""

    name: str
    text: str


@dataclass(frozen=True, slots=True)
class Live:
    """What the scripts are given.

    Parameters
    ----------
    facts
        JSON without ``<``, so that it cannot end the element it stands in.
    first, later
        The light that the first mix needs, and what is only needed once somebody looks for it.
    remix_reduction, pitch_reduction
        Side of the blocks of camera pixels that were averaged.
    signed
        Whether a component has negative values.
    uncertain
        Standard error at the upper end of the colour map; None where there are no errors.
    direct_deviations
        Whether direct light is free from the bias of noise and has its standard errors.
    ramp
        Colours of the colour map from its lower to its upper end, for CSS.
    """

    facts: str
    first: tuple[Block, ...]
    later: tuple[Block, ...]
    remix_reduction: int
    pitch_reduction: int
    signed: bool
    uncertain: float | None
    direct_deviations: bool
    ramp: tuple[str, ...]


def layers_read(record: ResultRecord) -> int:
    """How many times `live_of` tells that it is further."""
    return len(record.components) + len(record.pitches)


def live_of(result: Result, display_gain: float, done: Callable[[], object] = lambda: None) -> Live:
    """Gather the light of a result for the page, one image in memory at a time.

    `done` is called `layers_read` times.
    """
    record = result.record
    fine, coarse = reduction(record.shape, REMIX_PX), reduction(record.shape, PITCH_PX)
    components = []
    for name in record.components:
        components.append(reduced(result.component_view(name), fine))
        done()
    deviations = [
        root_mean_square(result.view(f"deviations/{name}.tiff"), fine)
        for name in record.components
        if record.deviations
    ]
    uncertain = _upper_end(deviations)
    signed = any(np.nanmin(image, initial=0) < 0 for image in components)
    corrected = bool(record.pitches) and all(p.corrected and p.deviation for p in record.pitches)
    first = (
        _block("components", components, ALL_BYTES if signed else EXACT_BYTES),
        _flags("flags", result.mask, components, fine),
    )
    later = (
        _block("white", [reduced(result.view("white.tiff"), fine)], EXACT_BYTES),
        _block("deviations", deviations, COARSE_BYTES),
        *_pitch_blocks(result, corrected, coarse, done),
    )
    facts = _facts(record, fine, coarse) | {
        "display_gain": display_gain,
        "uncertain": uncertain,
        "direct_deviations": corrected,
    }
    text = json.dumps(facts, ensure_ascii=True).replace("<", "\\u003c")
    ramp = tuple(f"#{r:02x}{g:02x}{b:02x}" for r, g, b in _ramp(9))
    return Live(text, first, later, fine, coarse, signed, uncertain, corrected, ramp)


def _pitch_blocks(
    result: Result, corrected: bool, factor: int, done: Callable[[], object]
) -> Iterator[Block]:
    pitches = result.record.pitches
    directs = []
    for pitch in pitches:
        path = (corrected and pitch.corrected) or pitch.direct
        directs.append(reduced(result.view(path), factor))
        done()
    yield _block("direct", directs, EXACT_BYTES)
    paths = [pitch.deviation for pitch in pitches if corrected and pitch.deviation]
    errors = (deviation_of_mean(result.view(path), factor) for path in paths)
    yield _block("direct-deviations", errors, COARSE_BYTES)
    globals_ = (reduced(result.view(pitch.global_), factor) for pitch in pitches)
    yield _block("global", globals_, COARSE_BYTES)
    if directs:
        yield _flags("pitch-flags", result.mask, directs, factor)


def _facts(record: ResultRecord, fine: int, coarse: int) -> dict[str, JsonValue]:
    families = tuple(dict.fromkeys(pitch.family for pitch in record.pitches))
    return {
        "shape": list(record.shape),
        "components": [
            {"name": name, "colour": colour_of(k)} for k, name in enumerate(record.components)
        ],
        "presets": {each.name: list(each.gains) for each in presets(record.components)},
        "marks": [[int(v) for v in mark] for mark in (SATURATED_RGB, UNLIT_RGB)],
        "colours": list(RGB_LINES),
        "ramp": [int(value) for value in _ramp(256).ravel()],
        "remix": _layout(record.shape, fine, len(record.components)),
        "pitch": _layout(record.shape, coarse, len(record.pitches)),
        "pitches": [
            {
                "px": pitch.pitch_px,
                "family": pitch.family.value,
                "label": pitch_label(pitch, families),
                "whole": pitch.proven is None or pitch.whole,
            }
            for pitch in record.pitches
        ],
    }


def packed(light: Light, n_bytes: int) -> bytes:
    """Planes of the upper bytes of float32, deflated; NaN becomes 0.

    Parameters
    ----------
    light
        Any shape.
    n_bytes
        1 to 4 of the bytes are kept, rounded to nearest.
    """
    bits = np.nan_to_num(light.astype(np.float32), nan=0.0).ravel().view(np.uint32)
    if n_bytes < 4:
        bits = bits + np.uint32(1 << (31 - 8 * n_bytes))
    planes = [(bits >> np.uint32(24 - 8 * k)).astype(np.uint8) for k in range(n_bytes)]
    return zlib.compress(np.concatenate(planes).tobytes(), 6)


def root_mean_square(image: NDArray[np.float32], factor: int) -> NDArray[np.float64]:
    """Root of the mean square over colours and blocks of pixels, (height, width, 1)."""
    squares = reduced(np.square(image), factor)
    mean: NDArray[np.float64] = np.sqrt(squares.mean(axis=2, keepdims=True))
    return mean


def deviation_of_mean(image: NDArray[np.float32], factor: int) -> NDArray[np.float64]:
    """Standard error of the mean of a block of independent pixels, (height, width, 3)."""
    mean: NDArray[np.float64] = np.sqrt(reduced(np.square(image), factor)) / factor
    return mean


def _upper_end(deviations: list[NDArray[np.float64]]) -> float | None:
    known = [image[np.isfinite(image)] for image in deviations]
    values = np.concatenate(known) if known else np.array([])
    end = float(np.percentile(values, UNCERTAIN_PERCENTILE)) if values.size else 0.0
    return end if end > 0 else None


def _layout(shape: tuple[int, int], factor: int, layers: int) -> dict[str, JsonValue]:
    height, width = (math.ceil(side / factor) for side in shape)
    return {"block": factor, "height": height, "width": width, "layers": layers}


def _block(name: str, images: Iterable[NDArray[np.float64]], n_bytes: int) -> Block:
    layers = [image.astype(np.float32) for image in images]
    light = np.stack(layers) if layers else np.empty(0, np.float32)
    return Block(name, base64.b64encode(packed(light, n_bytes)).decode())


def _flags(
    name: str, mask: NDArray[np.uint8], images: list[NDArray[np.float64]], factor: int
) -> Block:
    unknown: NDArray[np.bool_] = np.any(np.isnan(np.stack(images)), axis=(0, 3))
    flags = UNKNOWN * unknown.astype(np.uint8)
    flags |= HAS_SATURATED * block_any(mask == PixelClass.SATURATED, factor).astype(np.uint8)
    flags |= HAS_UNLIT * block_any(mask == PixelClass.UNLIT, factor).astype(np.uint8)
    return Block(name, base64.b64encode(zlib.compress(flags.tobytes(), 6)).decode())


def _ramp(number: int) -> NDArray[np.uint8]:
    colours = np.array(mpl.colormaps[RAMP](np.linspace(0, 1, number)))[:, :3]
    rounded: NDArray[np.uint8] = np.rint(255 * colours).astype(np.uint8)
    return rounded
