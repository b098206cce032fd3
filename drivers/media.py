"""What kind of file it is, told from its content: names lie, first bytes seldom do."""

from __future__ import annotations

import io
import logging
from collections.abc import Iterator
from contextlib import contextmanager

import tifffile

from drivers.errors import DecodeError

PICTURE_TYPES = ("image/tiff", "image/png", "image/jpeg")

_MAGIC = (
    (0, b"\x89PNG\r\n\x1a\n", "image/png"),
    (0, b"\xff\xd8\xff", "image/jpeg"),
    (0, b"FUJIFILMCCD-RAW", "image/x-fuji-raf"),
    (0, b"IIRO", "image/x-olympus-orf"),
    (0, b"IIRS", "image/x-olympus-orf"),
    (0, b"MMOR", "image/x-olympus-orf"),
    (0, b"IIU\x00", "image/x-panasonic-rw2"),
    (6, b"HEAPCCDR", "image/x-canon-crw"),
    (4, b"ftypcrx ", "image/x-canon-cr3"),
    (8, b"CR\x02", "image/x-canon-cr2"),
)
_TIFF_MAGIC = (b"II*\x00", b"MM\x00*", b"II+\x00", b"MM\x00+")
_MOSAIC_MAKERS = (
    ("NIKON", "image/x-nikon-nef"),
    ("SONY", "image/x-sony-arw"),
    ("PENTAX", "image/x-pentax-pef"),
    ("RICOH", "image/x-pentax-pef"),
)
_MOSAIC = {32803, 34892}  # PhotometricInterpretation: colour filter array, linear raw
_MAX_SUBFILES = 16

# tifffile logs what it then raises or ignores; without a handler Python would print it.
logging.getLogger("tifffile").addHandler(logging.NullHandler())


def media_type(data: bytes) -> str:
    """Media type of a whole picture or raw file.

    Raises
    ------
    DecodeError
        The file is empty, no picture, or a damaged TIFF.
    """
    if not data:
        raise DecodeError("the file is empty; was it copied whole?")
    for start, magic, name in _MAGIC:
        if data.startswith(magic, start):
            return name
    if data.startswith(_TIFF_MAGIC):
        with open_tiff(data) as file:
            return _tiff_type(file)
    raise DecodeError(
        "the file is neither TIFF, PNG or JPEG nor a raw file that is known here; "
        "save it as TIFF or PNG, or keep the camera's raw file"
    )


@contextmanager
def open_tiff(data: bytes) -> Iterator[tifffile.TiffFile]:
    """A TIFF opened for reading; whatever goes wrong with it is a `DecodeError`."""
    try:
        with tifffile.TiffFile(io.BytesIO(data)) as file:
            yield file
    except DecodeError:
        raise
    except Exception as error:
        # tifffile lets out whatever its parsing trips over, from KeyError to MemoryError.
        reason = str(error) or type(error).__name__
        raise DecodeError(
            f"the TIFF is damaged or cut off ({reason[:200]}); was it copied whole?"
        ) from error


def _tiff_type(file: tifffile.TiffFile) -> str:
    first = file.pages.first
    if "DNGVersion" in first.tags:
        return "image/x-adobe-dng"
    subfiles = [first, *(first.pages or ())[:_MAX_SUBFILES]]
    if not any(isinstance(p, tifffile.TiffPage) and p.photometric in _MOSAIC for p in subfiles):
        return "image/tiff"
    make = first.tags.get("Make")
    maker = str(make.value).upper() if make else ""
    return next((name for key, name in _MOSAIC_MAKERS if key in maker), "image/x-raw")
