"""A result in the formats of other programs, with what it is inside each file.

Exported are the components, their standard errors where there are any, white light and the mask;
or direct and global light at every pitch, and where the noise is known direct light freed from its
bias with its standard errors, with white light and the mask. All lie in the file as in the result:
float32, linear, NaN where saturated. Only PNG is for looking at: its values went through the curve
that it states.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path, PurePosixPath

import cv2
import numpy as np
import scipy.io
from numpy.typing import NDArray
from pydantic import JsonValue

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


@dataclass(frozen=True, slots=True)
class Parcel:
    """Images of a result that travel together.

    Parameters
    ----------
    result
        Whose they are.
    images
        Name of each and where in the result it lies.
    said
        What is said inside the file.
    """

    result: Result
    images: Mapping[str, str]
    said: Mapping[str, JsonValue]

    def image(self, name: str) -> Image:
        """As it lies on the disk, (height, width, 3)."""
        return self.result.view(self.images[name])

    @property
    def text(self) -> str:
        """What is said inside a file that holds the mask too."""
        return description_text({**self.said, "mask": MASK_CLASSES})


def export(result: Result, kind: Format, out: Path, *, pitches: bool = False) -> tuple[Path, ...]:
    """Write a result as one file, or as a folder: for PNG, and for pitches as EXR.

    Parameters
    ----------
    result
        The result.
    kind
        The format.
    out
        The file, or the folder; earlier files of the same names are replaced.
    pitches
        Direct and global light at every pitch instead of the components.

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
    parcel = pitch_parcel(result) if pitches else component_parcel(result)
    if kind is Format.PNG:
        return tuple(_write_png(parcel, out))
    if kind is Format.EXR and pitches:
        return tuple(_write_exr_folder(parcel, out))
    writers: dict[Format, Callable[[Parcel, Path], None]] = {
        Format.EXR: _write_exr,
        Format.MAT: _write_mat,
        Format.NPZ: _write_npz,
        Format.HDF5: _write_hdf5,
    }
    with whole_file(out) as part:
        writers[kind](parcel, part)
    return (out,)


def component_parcel(result: Result) -> Parcel:
    """Components, then ``NAME-error``, then ``white``."""
    names = result.record.components
    images = {name: f"components/{name}.tiff" for name in names}
    if result.record.deviations:
        images |= {f"{name}-error": f"deviations/{name}.tiff" for name in names}
    return Parcel(result, images | {"white": "white.tiff"}, description(result))


def pitch_parcel(result: Result) -> Parcel:
    """``direct-0008``, ``global-0008``, ``corrected-0008``, ``deviation-0008`` …, then ``white``.

    Two families of patterns in one result have their names in them: ``direct-checker-0008``.
    """
    images: dict[str, str] = {}
    listed: list[JsonValue] = []
    for pitch in result.record.pitches:
        named = {"direct": pitch.direct, "global": pitch.global_}
        named |= {"corrected": pitch.corrected or "", "deviation": pitch.deviation or ""}
        own = {kind: PurePosixPath(path).stem for kind, path in named.items() if path}
        images |= {own[kind]: named[kind] for kind in own}
        about: dict[str, JsonValue] = {
            "family": pitch.family.value,
            "pitch_px": pitch.pitch_px,
            "shifts": pitch.shifts,
            "resolved": pitch.resolved,
        }
        listed.append({**about, **own})
    kinds: dict[str, JsonValue] = {
        "direct": "direct light at the pitch, as separated",
        "global": "all other light",
        "corrected": "direct light freed from the bias that noise gives max/min",
        "deviation": "standard error of that",
    }
    said = description(result) | {"pitches": listed, "images": kinds}
    return Parcel(result, images | {"white": "white.tiff"}, said)


def _write_exr(parcel: Parcel, path: Path) -> None:
    """Compositing and rendering: float32 channels ``direct.R`` … and ``mask.class``."""
    try:
        import OpenEXR
    except ImportError as error:
        raise _missing("OpenEXR", "OpenEXR") from error
    # The mask as float too: programs scale integer channels to [0, 1] without a word.
    channels = {
        f"{name}.{colour}": np.ascontiguousarray(parcel.image(name)[..., k])
        for name in parcel.images
        for k, colour in enumerate(COLOURS)
    }
    channels["mask.class"] = parcel.result.mask.astype(np.float32)
    header = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "lumisplit": parcel.text,
    }
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))


def _write_exr_folder(parcel: Parcel, folder: Path) -> Iterator[Path]:
    """A file a pitch, because OpenEXR takes all channels of a file at once, and ``white.exr``."""
    files: dict[str, dict[str, str]] = {}
    for name, path in parcel.images.items():
        stem = "white" if name == "white" else f"pitch-{name.partition('-')[2]}"
        # Inside, the pitch is the file's.
        files.setdefault(stem, {})[name.partition("-")[0]] = path
    folder.mkdir(parents=True, exist_ok=True)
    for stem, images in files.items():
        out = folder / f"{stem}.exr"
        with whole_file(out) as part:
            _write_exr(Parcel(parcel.result, images, {**parcel.said, "file": stem}), part)
        yield out


def _write_mat(parcel: Parcel, path: Path) -> None:
    """MATLAB and Octave, version 5: one array a name, ``-`` become ``_``."""
    height, width = parcel.result.record.shape
    if height * width * 3 * 4 > MAT_VARIABLE_BYTES:
        raise ResultError(
            f"A MAT file of version 5 holds arrays of up to 2 GB; this result's images are larger "
            f"({height} × {width}). Take --to hdf5, which MATLAB reads too."
        )
    arrays: dict[str, object] = {
        name.replace("-", "_"): parcel.image(name) for name in parcel.images
    }
    arrays["mask"] = parcel.result.mask
    arrays["lumisplit"] = parcel.text
    scipy.io.savemat(path, arrays, appendmat=False, do_compression=False)


def _write_npz(parcel: Parcel, path: Path) -> None:
    """NumPy: one array a name, and ``lumisplit``, a JSON text."""
    arrays: dict[str, NDArray[np.generic]] = {name: parcel.image(name) for name in parcel.images}
    arrays["mask"] = parcel.result.mask
    arrays["lumisplit"] = np.array(parcel.text)
    with path.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays)


def _write_hdf5(parcel: Parcel, path: Path) -> None:
    """Everything that reads HDF5: a dataset a name, (height, width, colour).

    What is said is a dataset too: an attribute holds 64 kB, the words of some 300 pitches.
    """
    try:
        import h5py
    except ImportError as error:
        raise _missing("HDF5", "h5py") from error
    with h5py.File(path, "w") as file:
        file.create_dataset("lumisplit", data=description_text(parcel.said))
        for name in parcel.images:
            data = file.create_dataset(name, data=parcel.image(name))
            data.attrs["unit"] = str(parcel.said["unit"])
            data.attrs["color_space"] = str(parcel.said["color_space"])
            data.attrs["channels"] = ",".join(COLOURS)
        file.create_dataset("mask", data=parcel.result.mask).attrs["classes"] = MASK_CLASSES


def _write_png(parcel: Parcel, folder: Path) -> Iterator[Path]:
    """For looking at: 16 bits, exposed like the report, sRGB curve; a file an image."""
    gain = exposure_of(parcel.result.view("white.tiff"))
    folder.mkdir(parents=True, exist_ok=True)
    for name in parcel.images:
        said = {
            **parcel.said,
            "image": name,
            "display_gain": gain,
            "color_space": "camera RGB through the sRGB curve of IEC 61966-2-1, 16 bits",
            "unit": "65535 is 1/display_gain of the sensor's range; values outside are clipped",
            "not_measured": "black",
        }
        light = np.nan_to_num(parcel.image(name) * np.float32(gain), nan=0.0).clip(0, 1)
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
