"""A result in the formats of other programs, with what it is inside each file.

Exported are the components, their standard errors where there are any, white light and the mask,
as they lie in the result: float32, linear, NaN where saturated. Only PNG is for looking at: its
values went through the curve that it states.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from enum import StrEnum
from pathlib import Path

import cv2
import numpy as np
import scipy.io
from numpy.typing import NDArray

from acquire.errors import ResultError
from acquire.provenance import description, description_text
from acquire.result import Result
from acquire.storage import whole_file
from acquire.tone import exposure_of

Image = NDArray[np.float32]
COLOURS = "RGB"
MASK_CLASSES = "0 measured, 1 saturated, 2 unlit"
PNG_HEADER_BYTES = 33
MAT_VARIABLE_BYTES = (1 << 31) - 1


class Format(StrEnum):
    """What can be written; the comments in the functions below say for whom."""

    EXR = "exr"
    MAT = "mat"
    NPZ = "npz"
    HDF5 = "hdf5"
    PNG = "png"


def export(result: Result, kind: Format, out: Path) -> tuple[Path, ...]:
    """Write a result as one file, or for PNG as a folder of one file an image.

    Parameters
    ----------
    result
        The result.
    kind
        The format.
    out
        The file, or the folder; earlier files of the same names are replaced.

    Returns
    -------
    What was written.

    Raises
    ------
    ResultError
        `out` lies inside the result, the library of the format is not installed, or the format
        cannot hold so large an image.
    """
    result.refuse_inside(out)
    if kind is Format.PNG:
        return tuple(_write_png(result, out))
    writers: dict[Format, Callable[[Result, Path], None]] = {
        Format.EXR: _write_exr,
        Format.MAT: _write_mat,
        Format.NPZ: _write_npz,
        Format.HDF5: _write_hdf5,
    }
    with whole_file(out) as part:
        writers[kind](result, part)
    return (out,)


def image_names(result: Result) -> tuple[str, ...]:
    """Names of the exported images: components, then ``NAME-error``, then ``white``."""
    names = result.record.components
    errors = tuple(f"{name}-error" for name in names if result.record.deviations)
    return (*names, *errors, "white")


def _image(result: Result, name: str) -> Image:
    if name == "white":
        return result.view("white.tiff")
    component = name.removesuffix("-error")
    folder = "components" if component == name else "deviations"
    return result.view(f"{folder}/{component}.tiff")


def _write_exr(result: Result, path: Path) -> None:
    """Compositing and rendering: float32 channels ``direct.R`` … and ``mask.class``."""
    try:
        import OpenEXR
    except ImportError as error:
        raise _missing("OpenEXR", "OpenEXR") from error
    # The mask as float too: programs scale integer channels to [0, 1] without a word.
    channels = {
        f"{name}.{colour}": np.ascontiguousarray(_image(result, name)[..., k])
        for name in image_names(result)
        for k, colour in enumerate(COLOURS)
    }
    channels["mask.class"] = result.mask.astype(np.float32)
    header = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "lumisplit": description_text(description(result) | {"mask": MASK_CLASSES}),
    }
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))


def _write_mat(result: Result, path: Path) -> None:
    """MATLAB and Octave, version 5: one array a name, ``-`` become ``_``."""
    height, width = result.record.shape
    if height * width * 3 * 4 > MAT_VARIABLE_BYTES:
        raise ResultError(
            f"A MAT file of version 5 holds arrays of up to 2 GB; this result's images are larger "
            f"({height} × {width}). Take --to hdf5, which MATLAB reads too."
        )
    arrays: dict[str, object] = {
        name.replace("-", "_"): _image(result, name) for name in image_names(result)
    }
    arrays["mask"] = result.mask
    arrays["lumisplit"] = description_text(description(result) | {"mask": MASK_CLASSES})
    scipy.io.savemat(path, arrays, appendmat=False, do_compression=False)


def _write_npz(result: Result, path: Path) -> None:
    """NumPy: one array a name, and ``lumisplit``, a JSON text."""
    arrays: dict[str, NDArray[np.generic]] = {
        name: _image(result, name) for name in image_names(result)
    }
    arrays["mask"] = result.mask
    said = description_text(description(result) | {"mask": MASK_CLASSES})
    arrays["lumisplit"] = np.array(said)
    with path.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays)


def _write_hdf5(result: Result, path: Path) -> None:
    """Everything that reads HDF5: a dataset a name, (height, width, colour)."""
    try:
        import h5py
    except ImportError as error:
        raise _missing("HDF5", "h5py") from error
    said = description(result)
    with h5py.File(path, "w") as file:
        file.attrs["lumisplit"] = description_text(said)
        for name in image_names(result):
            data = file.create_dataset(name, data=_image(result, name))
            data.attrs["unit"] = str(said["unit"])
            data.attrs["color_space"] = str(said["color_space"])
            data.attrs["channels"] = ",".join(COLOURS)
        file.create_dataset("mask", data=result.mask).attrs["classes"] = MASK_CLASSES


def _write_png(result: Result, folder: Path) -> Iterator[Path]:
    """For looking at: 16 bits, exposed like the report, sRGB curve; a file an image."""
    gain = exposure_of(result.view("white.tiff"))
    folder.mkdir(parents=True, exist_ok=True)
    for name in image_names(result):
        said = description(result) | {
            "image": name,
            "display_gain": gain,
            "color_space": "camera RGB through the sRGB curve of IEC 61966-2-1, 16 bits",
            "unit": "65535 is 1/display_gain of the sensor's range; values outside are clipped",
            "not_measured": "black",
        }
        light = np.nan_to_num(_image(result, name) * np.float32(gain), nan=0.0).clip(0, 1)
        curve = 1.055 * light ** np.float32(1 / 2.4) - 0.055
        encoded = np.where(light <= 0.0031308, 12.92 * light, curve)
        pixels = np.rint(65535 * encoded).astype(np.uint16)
        done, data = cv2.imencode(".png", pixels[..., ::-1])
        if not done:
            raise ResultError(f"{name} cannot be encoded as PNG.")
        path = folder / f"{name}.png"
        with whole_file(path) as part:
            part.write_bytes(_with_text(data.tobytes(), description_text(said)))
        yield path


def _with_text(png: bytes, text: str) -> bytes:
    """Put a tEXt chunk after the header of a PNG (ISO/IEC 15948, 11.3.4.3)."""
    body = b"tEXt" + b"Description\0" + text.encode("ascii")
    chunk = (len(body) - 4).to_bytes(4, "big") + body + zlib.crc32(body).to_bytes(4, "big")
    return png[:PNG_HEADER_BYTES] + chunk + png[PNG_HEADER_BYTES:]


def _missing(what: str, package: str) -> ResultError:
    return ResultError(
        f"{what} is written by {package}, which is not installed here: "
        "`pip install 'lumisplit[export]'`, or choose another --to."
    )
