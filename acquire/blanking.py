"""Values that could not be measured, blanked in images and in their files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tifffile
from numpy.typing import NDArray

from acquire.result import PixelClass
from acquire.session.folder import storage


@dataclass(frozen=True, slots=True)
class Unusable:
    """Pixels whose values mean nothing.

    Parameters
    ----------
    saturated, unlit
        int, (n,), places in the raster, line by line.
    """

    saturated: NDArray[np.int64]
    unlit: NDArray[np.int64]

    @classmethod
    def of(cls, mask: NDArray[np.uint8]) -> Unusable:
        """Those of a mask, (height, width), `PixelClass`."""
        return cls(*(np.flatnonzero(mask == k) for k in (PixelClass.SATURATED, PixelClass.UNLIT)))

    def blank(self, image: NDArray[np.float32]) -> None:
        """Make saturated pixels of an image, (height, width, colours), NaN, and unlit ones 0."""
        pixels = image.reshape(-1, image.shape[-1])
        pixels[self.saturated] = np.nan
        pixels[self.unlit] = 0

    def blank_file(self, path: Path) -> None:
        """The same in a TIFF file, of which nothing else is touched."""
        if not self.saturated.size and not self.unlit.size:
            return
        with storage(path):
            self.blank(tifffile.memmap(path, mode="r+"))
