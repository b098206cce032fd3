"""What the camera in the machine sees: pictures that were rendered outside.

An emulated processor takes long to import what simulates scenes and reads raw files.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from drivers.errors import CameraError
from drivers.protocols import CameraSettings, Raster
from drivers.raster import raster_digest
from drivers.sim.ptp_responder.source import NoDeveloper

INDEX = "index.json"
WHITE = "white"  # lit by a projector that shows nothing else


@dataclass(frozen=True, slots=True)
class Exposure:
    """A rendered picture: what lit the scene, how it was exposed, the files of it."""

    light: str
    exposure_s: float
    aperture: float
    iso: int
    raw: str
    jpeg: str


class RenderedScene(NoDeveloper):
    """A scene's pictures, for a simulated camera; and what makes JPEGs of them.

    Parameters
    ----------
    folder
        With the rendered files and their index.

    Attributes
    ----------
    light
        What lights the scene now: a raster's digest, or `WHITE`.
    """

    def __init__(self, folder: Path) -> None:
        index = [Exposure(**line) for line in json.loads((folder / INDEX).read_text())]
        self._raws = {
            (each.light, round(1e6 * each.exposure_s), each.aperture, each.iso): (
                folder / each.raw
            ).read_bytes()
            for each in index
        }
        self._jpegs = {
            (folder / each.raw).read_bytes(): (folder / each.jpeg).read_bytes() for each in index
        }
        self.light = WHITE

    def shoot(self, settings: CameraSettings) -> tuple[bytes, str]:
        """A raw file of the scene as it is lit now."""
        place = self.light, round(1e6 * settings.exposure_s), settings.aperture, settings.iso
        if place not in self._raws:
            raise CameraError(f"the scene was not rendered as {place}")
        return self._raws[place], "image/x-adobe-dng"

    def jpeg(self, data: bytes, media_type: str) -> bytes:
        """The JPEG that was rendered with a raw file."""
        return self._jpegs[data] if data in self._jpegs else super().jpeg(data, media_type)


class MemoryProjector:
    """A projector whose light reaches a rendered scene (see `drivers.protocols.Projector`)."""

    def __init__(self, scene: RenderedScene, resolution: tuple[int, int]) -> None:
        self._scene = scene
        self.resolution = resolution

    def show(self, raster: Raster) -> None:
        self._scene.light = raster_digest(raster)

    def check(self) -> None:
        pass

    def close(self) -> None:
        self._scene.light = WHITE
