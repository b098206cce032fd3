"""Reading and writing in a folder that may come from a stranger or lose power at any moment."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from io import FileIO
from pathlib import Path

from acquire.errors import SessionError, StorageError

OUT_OF_SPACE = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
_ADVICE = {
    errno.ENOENT: "The folder is gone: was it moved, renamed or deleted, or its drive pulled out? "
    "Put it back where it was and give the same command again.",
    errno.EROFS: "The disk takes no writing any more, as the system does with one that fails or "
    "was pulled out. Look at its cable and the system's log, make it writable, and give the same "
    "command again.",
    errno.EIO: "The disk fails or was pulled out. Look at its cable and the system's log, and copy "
    "what is on it before anything else.",
    errno.EACCES: "See who may write there (`ls -l`), and give the same command again.",
}
_SAFE = "Everything before it is safe."
_NOTHING = "Nothing of it was left there, and what it is made of was not touched."
_ADVICE |= {errno.ENOTDIR: _ADVICE[errno.ENOENT], errno.ENODEV: _ADVICE[errno.EIO]}
# A disk's cache may hold that many lines; more are no mishap of a power cut.
MOST_LOST = 16


def read_plain(path: Path, max_bytes: int) -> bytes:
    """Content of a plain file; refuses links, devices, pipes and more than `max_bytes`."""
    flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    try:
        descriptor = os.open(path, flags | getattr(os, "O_BINARY", 0))
    except OSError as error:
        why = "it is a link" if error.errno == errno.ELOOP else error.strerror
        raise SessionError(f"Cannot read {path}: {why}.") from error
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise SessionError(f"Cannot read {path}: it is not a plain file.")
    with os.fdopen(descriptor, "rb") as file:
        status = os.fstat(file.fileno())
        if status.st_size > max_bytes:
            raise SessionError(
                f"Refused {path}: {status.st_size} bytes, where at most {max_bytes} make sense."
            )
        return file.read(max_bytes + 1)


def write_durably(path: Path, data: bytes) -> None:
    """Write a file so that after a power cut it is there whole or not at all."""
    part = path.with_name(f".{path.name}.part")
    with storage(path):
        part.unlink(missing_ok=True)
        try:
            # "x" makes the file: a link planted under this name is refused, not followed.
            with part.open("xb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            part.replace(path)
        except BaseException:
            part.unlink(missing_ok=True)
            raise
        sync_folder(path.parent)


def append_durably(path: Path, line: bytes, *, make: bool = False) -> None:
    """Append a line; a line that did not fit is taken back so that the file stays whole.

    A file that is not there is made only with `make`: of a session that was moved away in the
    middle, nothing may begin anew.
    """
    with storage(path):
        if make and not path.exists():
            path.touch()
            sync_folder(path.parent)
        # Unbuffered: what is taken back must not be written again when the file is closed.
        with path.open("rb+", buffering=0) as file:
            _append(file, line)


def _append(file: FileIO, line: bytes) -> None:
    end = file.seek(0, os.SEEK_END)
    try:
        if file.write(line) != len(line):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        os.fsync(file.fileno())
    except OSError:
        file.truncate(end)
        raise


def whole_bytes(content: bytes) -> int:
    """Length of the lines that are whole: a power cut can leave a torn end, or zeros for it."""
    end = content.rfind(b"\n") + 1
    zero = content.find(b"\0")
    if zero >= 0 and content.count(b"\n", zero) <= MOST_LOST:
        end = min(end, content.rfind(b"\n", 0, zero) + 1)
    return end


def sync_folder(folder: Path) -> None:
    """Make new names in a folder survive a power cut, where the system can do that."""
    if not hasattr(os, "O_DIRECTORY"):
        return
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextmanager
def storage(path: Path, *, whole: bool = False) -> Iterator[None]:
    """Say what an unwritable disk means.

    Parameters
    ----------
    path
        What is written.
    whole
        It is there whole or not at all, and what it is made of is only read.
    """
    try:
        yield
    except OSError as error:
        if error.errno in OUT_OF_SPACE:
            raise StorageError(
                f"The disk is full: {path} could not be written. {_NOTHING if whole else _SAFE} "
                "Make room and give the same command again"
                + (", or write elsewhere." if whole else "; it goes on where it stopped.")
            ) from error
        told = _ADVICE.get(error.errno or 0, _NOTHING if whole else _SAFE)
        raise StorageError(f"Cannot write {path}: {error.strerror}. {told}") from error
