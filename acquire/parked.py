"""Images that wait on the disk until a part of them is wanted.

They are read, not mapped: what is mapped counts as memory of the process for as long as the system
has room for it, and is fetched a page at a time.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from acquire.errors import StorageError
from acquire.session.folder import storage

Image = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class ParkedImages:
    """Float32 images of one shape, one after the other in a file.

    Parameters
    ----------
    path
        The file.
    shape
        (images, height, width, colours).
    """

    path: Path
    shape: tuple[int, int, int, int]

    @classmethod
    def park(cls, path: Path, images: Image) -> ParkedImages:
        """Write (images, height, width, colours) into a new file."""
        n_images, height, width, colours = images.shape
        with storage(path), path.open("xb") as file:
            file.write(np.ascontiguousarray(images, np.float32).data)
        return cls(path, (n_images, height, width, colours))

    def __getitem__(self, part: tuple[slice, slice, slice], /) -> Image:
        """Some lines and columns of some images."""
        n_images, height, width, colours = self.shape
        which, lines = (
            range(*one.indices(n)) for one, n in zip(part, (n_images, height), strict=False)
        )
        columns = range(*part[2].indices(width))
        found = np.empty((len(which), len(lines), len(columns), colours), np.float32)
        whole = lines.step == 1 and len(columns) == width
        line = np.empty((width, colours), np.float32)
        if not found.size:
            return found
        try:
            with self.path.open("rb", buffering=0) as file:
                for image, k in zip(found, which, strict=True):
                    if whole:
                        self._read(file, k * height + lines.start, image)
                        continue
                    for out, y in zip(image, lines, strict=True):
                        self._read(file, k * height + y, line)
                        out[:] = line[part[2]]
        except OSError as error:
            raise StorageError(f"Cannot read {self.path}: {error.strerror}.") from error
        return found

    def _read(self, file: io.FileIO, line: int, values: Image) -> None:
        """Whole lines from one of all images on."""
        file.seek(line * self.shape[2] * self.shape[3] * values.itemsize)
        wanted = values.data.cast("B")
        while wanted:
            n_bytes = file.readinto(wanted)
            if not n_bytes:
                raise StorageError(f"{self.path} has become shorter since it was written.")
            wanted = wanted[n_bytes:]
