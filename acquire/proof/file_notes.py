"""What a frame's file says of its exposure itself, whatever was asked of the camera.

Raw files that are laid out like TIFF have a directory with the camera's clock, and exposure time,
aperture and speed in it or in the one of Exif (DC-008-2019, 4.6.5).
"""

from __future__ import annotations

import io
import math
from collections.abc import Mapping
from dataclasses import dataclass

import tifffile

from drivers.protocols import CameraSettings

_DATE_TIME, _EXIF, _DATE_TIME_ORIGINAL, _SUB_SECONDS = 306, 34665, 36867, 37521
_EXPOSURE = (33434, "ExposureTime"), (33437, "FNumber"), (34855, "ISOSpeedRatings")
_IN_EXIF = (
    *_EXPOSURE,
    (_DATE_TIME_ORIGINAL, "DateTimeOriginal"),
    (_SUB_SECONDS, "SubsecTimeOriginal"),
)
# Files round to nominal steps; the smallest step of a dial is a third of a stop, 26 % of light.
ROUNDED_WITHIN = 0.12


@dataclass(frozen=True, slots=True)
class FileNotes:
    """None and empty where the file does not say.

    Parameters
    ----------
    camera_time
        When the camera took the frame, by its own clock.
    exposure_s, aperture, iso
        How it was exposed.
    """

    camera_time: str = ""
    exposure_s: float | None = None
    aperture: float | None = None
    iso: float | None = None

    def contradictions(self, asked: CameraSettings) -> list[str]:
        """Settings that the file has otherwise than asked, in words."""
        own = (
            ("exposure time", self.exposure_s, asked.exposure_s, "s"),
            ("aperture", self.aperture, asked.aperture, ""),
            ("ISO", self.iso, asked.iso, ""),
        )
        return [
            f"{name} {told:g}{f' {unit}' if unit else ''} instead of {wanted:g}"
            for name, told, wanted, unit in own
            if told and wanted and abs(math.log(told / wanted)) > ROUNDED_WITHIN
        ]


def file_notes(data: bytes) -> FileNotes:
    """Read a file's notes; those of no TIFF-like file are empty."""
    if data[:2] not in {b"II", b"MM"}:
        return FileNotes()
    try:
        with tifffile.TiffFile(io.BytesIO(data)) as file:
            own: dict[int, object] = {tag.code: tag.value for tag in file.pages.first.tags}
        exif = own.get(_EXIF)
        if isinstance(exif, Mapping):
            own |= {code: exif[name] for code, name in _IN_EXIF if exif.get(name) is not None}
        exposure_s, aperture, iso = (_number(own.get(code)) for code, _ in _EXPOSURE)
        return FileNotes(_time(own), exposure_s, aperture, iso)
    except Exception:  # noqa: BLE001 - tifffile lets out whatever its parsing trips over
        return FileNotes()


def _time(own: Mapping[int, object]) -> str:
    """When the exposure was, by the camera's clock."""
    text = str(own.get(_DATE_TIME_ORIGINAL) or own.get(_DATE_TIME) or "")[:19]
    part = str(own.get(_SUB_SECONDS) or "").strip()[:3]
    if not text.isprintable():
        return ""
    return f"{text}.{part}" if part.isdecimal() and part.isascii() else text


def _number(value: object) -> float | None:
    """A value of a tag, a number or numerator and denominator; None for what is no number."""
    parts = value if isinstance(value, tuple) else (value,)
    if not parts or not all(isinstance(part, int | float) for part in parts):
        return None
    number = float(parts[0])
    if len(parts) > 1:
        number = number / float(parts[1]) if parts[1] else 0.0
    return number if math.isfinite(number) and number > 0 else None
