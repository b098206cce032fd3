"""Room on the disk, asked before anything is shown; files that are there whole or not at all."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from acquire.errors import StorageError
from acquire.session.folder import storage


def free_bytes(folder: Path) -> int:
    """Bytes free where the folder is or will be."""
    with storage(folder):
        existing = next(
            path for path in (folder.absolute(), *folder.absolute().parents) if path.exists()
        )
        return shutil.disk_usage(existing).free


def check_room(folder: Path, needed_bytes: int) -> None:
    """Refuse to start what cannot be kept."""
    free = free_bytes(folder)
    if needed_bytes > free:
        raise StorageError(
            f"The disk of {folder} has {free / 1e9:.2f} GB free; {needed_bytes / 1e9:.2f} GB are "
            "needed. Make room, choose another --out, or plan fewer pitches or shifts."
        )


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a name to write to, with the suffix of `path`; it becomes `path` when all went well."""
    part = path.with_name(f".part-{path.name}")
    with storage(path, whole=True):
        part.unlink(missing_ok=True)
        try:
            yield part
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
