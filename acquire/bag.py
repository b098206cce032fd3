"""A session, and what was made of it, in one file: a BagIt bag (RFC 8493) in a ZIP archive.

    NAME/bagit.txt, NAME/bag-info.txt
    NAME/manifest-sha256.txt          digest of every file below data/
    NAME/tagmanifest-sha256.txt       digests of the three above
    NAME/data/session/…               the session as it lies on the disk
    NAME/data/result/…                a result, where one is packed along

Any ZIP and `sha256sum -c manifest-sha256.txt` suffice to read and check it. The same files give the
same bytes. A bag from a stranger is data: names, number and sizes are checked before anything is
written, links are refused, and nothing is written outside the folder that was asked for.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import stat
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path, PurePosixPath
from typing import IO

from acquire.errors import SessionError
from acquire.session.folder import storage, sync_folder
from acquire.session.records import MAX_FRAME_BYTES
from acquire.session.store import LOCK
from acquire.storage import check_room

DECLARATION = b"BagIt-Version: 1.0\nTag-File-Character-Encoding: UTF-8\n"
MANIFEST, TAG_MANIFEST = "manifest-sha256.txt", "tagmanifest-sha256.txt"
MAX_FILES = 500_000
MAX_MANIFEST_BYTES = 128 << 20
CHUNK_BYTES = 1 << 20
MOST_PARTS = 8
MOST_ROOT_CHARACTERS = 64
_UNSOUND = (
    zipfile.BadZipFile, zipfile.LargeZipFile, NotImplementedError, RuntimeError, EOFError,
    zlib.error,
)  # fmt: skip
_EPOCH = (1980, 1, 1, 0, 0, 0)
_LINE = re.compile(r"^([0-9a-f]{64}) [ *](\S.*)$")
_PART = re.compile(r"^[A-Za-z0-9_][A-Za-z0-9_.\-]{0,127}$")


@dataclass(frozen=True, slots=True)
class Bag:
    """An archive whose names and sizes make sense.

    Parameters
    ----------
    archive
        Open for reading.
    root
        The one folder at its top.
    entries
        By name relative to `root`.
    manifest
        Digest of every payload file, by name relative to `root`.
    """

    archive: zipfile.ZipFile
    root: str
    entries: dict[str, zipfile.ZipInfo]
    manifest: dict[str, str]


def pack(folders: dict[str, Path], out: Path, file_done: Callable[[], None]) -> None:
    """Write a bag; a file that exists already is never replaced.

    Parameters
    ----------
    folders
        Name below data/, ``session`` and perhaps ``result``, and the folder.
    out
        The file to write.
    file_done
        Called after each file.
    """
    if out.exists() or out.is_symlink():
        raise SessionError(f"{out} exists; nothing was written. Give another --out.")
    root = _root(out.stem)
    payload = {
        f"data/{name}/{path.relative_to(folder).as_posix()}": path
        for name, folder in folders.items()
        for path in _files(folder)
    }
    _check_names([f"{root}/{name}" for name in payload], folders)
    size = sum(path.stat().st_size for path in payload.values())
    check_room(out.absolute().parent, size + (1 << 20))
    part = out.with_name(f".{out.name}.part")
    with storage(out, whole=True):
        part.unlink(missing_ok=True)
        try:
            with zipfile.ZipFile(part, "x", zipfile.ZIP_STORED, allowZip64=True) as archive:
                _write(archive, root, payload, size, file_done)
            with part.open("rb") as file:
                os.fsync(file.fileno())
            part.replace(out)
            sync_folder(out.absolute().parent)
        except BaseException:
            part.unlink(missing_ok=True)
            raise


def _root(stem: str) -> str:
    """The name of the one folder at the top, after the file's, as every system can have it."""
    name = re.sub(r"[^A-Za-z0-9_-]+", "-", stem).strip("-")
    return name[:MOST_ROOT_CHARACTERS] or "bag"


def _check_names(names: list[str], folders: dict[str, Path]) -> None:
    """Refuse to pack what nobody could unpack."""
    bad = next((name for name in names if not _is_name(name)), None)
    if bad is not None:
        inside = PurePosixPath(*PurePosixPath(bad).parts[3:])
        raise SessionError(
            f"{folders[PurePosixPath(bad).parts[2]] / inside} has a name that not every system can "
            "have (letters, digits, `_`, `-` and `.` without spaces, at most 128). Rename it or "
            "take it out of the folder; nothing was packed."
        )


def _is_name(name: str) -> bool:
    parts = name.split("/")
    return 2 <= len(parts) <= MOST_PARTS and all(
        _PART.match(part) and not part.endswith(".") for part in parts
    )


def _files(folder: Path) -> Iterator[Path]:
    for path in sorted(folder.rglob("*")):
        if path.is_symlink():
            raise SessionError(f"{path} is a link; a bag holds files only. Nothing was packed.")
        if path.is_file() and path.name != LOCK and not path.name.endswith(".part"):
            yield path


def _write(
    archive: zipfile.ZipFile,
    root: str,
    payload: dict[str, Path],
    size: int,
    file_done: Callable[[], None],
) -> None:
    manifest = []
    for name, path in sorted(payload.items()):
        with path.open("rb") as source, _entry(archive, f"{root}/{name}") as target:
            manifest.append(f"{_copy(source, target)}  {name}\n")
        file_done()
    version = metadata.version("lumisplit")
    info = f"Bag-Software-Agent: lumisplit {version}\nPayload-Oxum: {size}.{len(payload)}\n"
    tags = {
        "bag-info.txt": info.encode(),
        "bagit.txt": DECLARATION,
        MANIFEST: "".join(manifest).encode(),
    }
    tags[TAG_MANIFEST] = "".join(
        f"{hashlib.sha256(content).hexdigest()}  {name}\n" for name, content in tags.items()
    ).encode()
    for name, content in tags.items():
        with _entry(archive, f"{root}/{name}") as target:
            target.write(content)


def _entry(archive: zipfile.ZipFile, name: str) -> IO[bytes]:
    info = zipfile.ZipInfo(name, _EPOCH)
    info.external_attr = (stat.S_IFREG | 0o644) << 16
    info.create_system = 3
    return archive.open(info, "w", force_zip64=True)


def _copy(source: IO[bytes], target: IO[bytes] | None, limit: int = MAX_FRAME_BYTES) -> str:
    """Copy in pieces, at most `limit` bytes; the digest."""
    digest = hashlib.sha256()
    left = limit
    while chunk := source.read(CHUNK_BYTES):
        left -= len(chunk)
        if left < 0:
            raise SessionError(f"A file is longer than the {limit} bytes that make sense.")
        digest.update(chunk)
        if target is not None:
            target.write(chunk)
    return digest.hexdigest()


@contextmanager
def opened(path: Path) -> Iterator[Bag]:
    """Open a bag and check everything but its payload's digests; raises `SessionError`."""
    try:
        with zipfile.ZipFile(path) as archive:
            yield _checked(archive, path)
    except _UNSOUND as error:
        raise SessionError(f"{path} is not a sound ZIP archive: {error}.") from error
    except OSError as error:
        raise SessionError(f"Cannot read {path}: {error.strerror or error}.") from error


def problems(bag: Bag) -> Iterator[str | None]:
    """One item a payload file, None when its digest is right."""
    for name, digest in bag.manifest.items():
        yield None if _digest(bag, name) == digest else f"{name}: its digest differs."


def unpack(bag: Bag, out: Path, file_done: Callable[[], None]) -> None:
    """Write session and result into a new folder; all of it or, when a digest differs, nothing."""
    if out.exists() or out.is_symlink():
        raise SessionError(f"{out} exists; nothing was written. Give another --out.")
    check_room(out.absolute().parent, sum(bag.entries[n].file_size for n in bag.manifest))
    part = out.with_name(f".{out.name}.part")
    with storage(out, whole=True):
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir(parents=True)
        try:
            for name, digest in bag.manifest.items():
                target = part.joinpath(*PurePosixPath(name).parts[1:])
                target.parent.mkdir(parents=True, exist_ok=True)
                with target.open("xb") as file:
                    found = _digest(bag, name, file)
                if found != digest:
                    raise SessionError(f"{name}: its digest differs. Nothing was unpacked.")
                file_done()
            part.rename(out)
        except BaseException:
            shutil.rmtree(part, ignore_errors=True)
            raise


def _digest(bag: Bag, name: str, target: IO[bytes] | None = None) -> str:
    entry = bag.entries[name]
    try:
        with bag.archive.open(entry) as source:
            return _copy(source, target, entry.file_size)
    except _UNSOUND as error:
        raise SessionError(f"{name} is damaged: {error}.") from error


def _checked(archive: zipfile.ZipFile, path: Path) -> Bag:
    infos = [info for info in archive.infolist() if not info.is_dir()]
    if not infos or len(infos) > MAX_FILES:
        raise SessionError(f"{path} holds {len(infos)} files; it is no packed session.")
    for info in infos:
        _check_entry(info, path)
    # Of two entries that share their bytes, one is there to swell.
    if sum(info.compress_size for info in infos) > path.stat().st_size:
        raise SessionError(f"Refused {path}: its files claim more bytes than it has.")
    roots = {info.filename.split("/", 1)[0] for info in infos}
    if len(roots) != 1:
        raise SessionError(f"{path} is no bag: it has {len(roots)} folders at its top, not one.")
    root = roots.pop()
    entries = {info.filename.partition("/")[2]: info for info in infos}
    # Not every system tells capitals from small letters.
    if len({name.casefold() for name in entries}) != len(infos):
        raise SessionError(f"Refused {path}: a name stands in it twice.")
    tags = _tags(archive, entries, path)
    for name, digest in tags.items():
        if name not in entries or _plain_digest(archive, entries[name]) != digest:
            raise SessionError(f"{path} is damaged: {name} is missing or its digest differs.")
    manifest = _manifest(archive, entries, MANIFEST, path)
    payload = {name for name in entries if name.startswith("data/")}
    if payload != set(manifest):
        odd = sorted(payload ^ set(manifest))[0]
        raise SessionError(f"{path} is damaged: {odd} is not both listed and there.")
    return Bag(archive, root, entries, manifest)


def _check_entry(info: zipfile.ZipInfo, path: Path) -> None:
    mode = info.external_attr >> 16
    if not _is_name(info.filename):
        raise SessionError(f"Refused {path}: {info.filename[:80]!r} is no name of a bag's file.")
    if mode and not stat.S_ISREG(mode) and stat.S_IFMT(mode):
        raise SessionError(f"Refused {path}: {info.filename} is a link or a device.")
    if info.compress_type not in {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}:
        raise SessionError(
            f"Refused {path}: {info.filename} is neither stored nor deflated, as the files of a "
            "bag are."
        )
    if info.file_size > MAX_FRAME_BYTES:
        raise SessionError(f"Refused {path}: {info.filename} claims {info.file_size} bytes.")


def _tags(
    archive: zipfile.ZipFile, entries: dict[str, zipfile.ZipInfo], path: Path
) -> dict[str, str]:
    tags = _manifest(archive, entries, TAG_MANIFEST, path)
    if {MANIFEST, "bagit.txt"} - set(tags):
        raise SessionError(f"{path} is no packed session: {TAG_MANIFEST} lists too little.")
    return tags


def _manifest(
    archive: zipfile.ZipFile, entries: dict[str, zipfile.ZipInfo], name: str, path: Path
) -> dict[str, str]:
    entry = entries.get(name)
    if entry is None or entry.file_size > MAX_MANIFEST_BYTES:
        raise SessionError(f"{path} is no packed session: it has no usable {name}.")
    found: dict[str, str] = {}
    for line in archive.read(entry).decode("utf-8", "replace").splitlines():
        match = _LINE.match(line)
        if match is None or match[2] in found:
            raise SessionError(f"{path} is damaged: {name} has the line {line[:80]!r}.")
        found[match[2]] = match[1]
    return found


def _plain_digest(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> str:
    with archive.open(entry) as source:
        return _copy(source, None, min(entry.file_size, MAX_MANIFEST_BYTES))
