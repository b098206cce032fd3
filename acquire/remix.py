"""The scene with its kinds of light in other amounts: mix = Σ gain · component, in linear light."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import tifffile
from numpy.typing import NDArray
from PIL import Image as Pillow
from PIL.PngImagePlugin import PngInfo

from acquire.errors import ResultError
from acquire.provenance import description, description_text
from acquire.result import Result
from acquire.storage import whole_file
from acquire.tone import Tone, encode, exposure_of

Image = NDArray[np.float32]
ROWS_PIXELS = 1 << 19
SATURATED_RGB = np.array([0xD5, 0x5E, 0x00], np.uint8)
CURVES = {
    Tone.SRGB: "clipped to [0, 1], then the sRGB curve of IEC 61966-2-1",
    Tone.SOFT: "x (1 + x/16)/(1 + x), clipped to [0, 1], then the sRGB curve of IEC 61966-2-1",
}


@dataclass(frozen=True, slots=True)
class Preset:
    """A mix worth a name: `gains` of every component, in order."""

    name: str
    title: str
    gains: tuple[float, ...]


def presets(components: Sequence[str]) -> tuple[Preset, ...]:
    """The presets for which the components exist; the first is the light as it was captured."""
    found = [Preset("as-captured", "As captured", (1.0,) * len(components))]
    if "direct" in components:
        found.append(
            Preset("direct-only", "Direct only", tuple(float(n == "direct") for n in components))
        )
    if "interreflection" in components:
        gains = tuple(float(n != "interreflection") for n in components)
        found.append(Preset("no-interreflection", "No inter-reflection", gains))
    if "subsurface" in components:
        gains = tuple(2.0 if n == "subsurface" else 1.0 for n in components)
        found.append(Preset("scattering-x2", "Scattering ×2", gains))
    return tuple(found)


def gains_for(
    components: Sequence[str], preset: str | None, given: Mapping[str, float]
) -> tuple[float, ...]:
    """The gain of every component: those given, else the preset's, else 0.

    Raises
    ------
    ResultError
        A component or preset that there is not; a gain that is no finite number; no gain at all.
    """
    offered = {each.name: each for each in presets(components)}
    if preset is None and not given:
        raise ResultError(
            f"Nothing to mix: give --gain COMPONENT=NUMBER (there are {', '.join(components)}) or "
            f"--preset ({', '.join(offered)})."
        )
    if preset is not None and preset not in offered:
        raise ResultError(
            f"No preset {preset!r} for this result; there are {', '.join(offered)} "
            f"(its components are {', '.join(components)})."
        )
    for name, gain in given.items():
        if name not in components:
            raise ResultError(
                f"No component {name!r} in this result; there are {', '.join(components)}."
            )
        if not math.isfinite(gain):
            raise ResultError(f"The gain of {name} is {gain}; it must be a finite number.")
    base = offered[preset].gains if preset is not None else (0.0,) * len(components)
    return tuple(given.get(name, gain) for name, gain in zip(components, base, strict=True))


def mix(components: Sequence[NDArray[np.floating]], gains: Sequence[float]) -> NDArray[np.float64]:
    """Σ gain · component.

    Parameters
    ----------
    components
        Linear light, each (height, width, 3); NaN where it was not measured.
    gains
        One a component; 0 leaves a component out, but not its NaN.

    Returns
    -------
    (height, width, 3), linear, NaN where any component is.
    """
    if len(components) != len(gains) or not gains:
        raise ValueError(f"{len(components)} components and {len(gains)} gains")
    total = np.zeros(components[0].shape)
    for component, gain in zip(components, gains, strict=True):
        total += np.float64(gain) * component
    return total


def mixed_rows(result: Result, gains: Sequence[float]) -> Iterator[NDArray[np.float64]]:
    """The mix at full resolution, some rows at a time from the top."""
    height, width = result.record.shape
    step = rows_at_once(width)
    images = [result.component_view(name) for name in result.record.components]
    for top, bottom in pairwise([*range(0, height, step), height]):
        yield mix([image[top:bottom] for image in images], gains)


def rows_at_once(width: int) -> int:
    """As many rows as are half a megapixel, at least one."""
    return max(1, ROWS_PIXELS // width)


def write_mix(
    result: Result, gains: Sequence[float], path: Path, exposure_stops: float, tone: Tone
) -> None:
    """Write a mix as float32 linear TIFF, or as 8-bit PNG for a screen, by the suffix of `path`.

    Parameters
    ----------
    result
        Where the components are.
    gains
        One a component.
    path
        ``….tiff``, ``….tif`` or ``….png``; an earlier file is replaced.
    exposure_stops, tone
        Of a PNG: powers of two beyond the report's exposure, and the tone curve.
    """
    result.refuse_inside(path)
    said = description(result) | {
        "kind": "mix of components: sum of gain × component",
        "gains": dict(zip(result.record.components, gains, strict=True)),
    }
    match path.suffix.lower():
        case ".tiff" | ".tif":
            _write_tiff(result, gains, path, description_text(said))
        case ".png":
            gain = exposure_of(result.view("white.tiff")) * 2.0**exposure_stops
            said |= {"display_gain": gain, "curve": CURVES[tone], "color_space": "sRGB curve"}
            said["not_measured"] = "orange-red #D55E00"
            _write_png(result, gains, path, gain, tone, description_text(said))
        case suffix:
            raise ResultError(
                f"Cannot tell what to write from the suffix {suffix!r} of {path}: give a .tiff "
                "(float32, linear) or a .png (8 bits, for a screen)."
            )


def _write_tiff(result: Result, gains: Sequence[float], path: Path, said: str) -> None:
    height, width = result.record.shape
    strips = (rows.astype(np.float32) for rows in mixed_rows(result, gains))
    with whole_file(path) as part:
        tifffile.imwrite(
            part,
            strips,
            shape=(height, width, 3),
            dtype=np.float32,
            photometric="rgb",
            rowsperstrip=min(height, rows_at_once(width)),
            metadata=None,
            description=said,
        )


def _write_png(
    result: Result, gains: Sequence[float], path: Path, gain: float, tone: Tone, said: str
) -> None:
    height, width = result.record.shape
    pixels = np.empty((height, width, 3), np.uint8)
    top = 0
    for rows in mixed_rows(result, gains):
        pixels[top : top + len(rows)] = developed(rows, gain, tone)
        top += len(rows)
    notes = PngInfo()
    notes.add_itxt("Description", said)
    with whole_file(path) as part:
        Pillow.fromarray(pixels).save(part, "PNG", pnginfo=notes)


def developed(light: NDArray[np.float64], gain: float, tone: Tone) -> NDArray[np.uint8]:
    """Linear light × gain by a tone curve; what was not measured in orange-red.

    Parameters
    ----------
    light
        (height, width, 3), NaN where a pixel was not measured.
    gain
        Light × gain = 1 is full brightness.
    """
    unknown = np.isnan(light).any(axis=2, keepdims=True)
    return np.where(unknown, SATURATED_RGB, encode(np.where(unknown, 0, light * gain), tone))
