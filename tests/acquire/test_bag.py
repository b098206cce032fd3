"""A session in one file: what comes out is what went in, and nothing else comes out."""

from __future__ import annotations

import hashlib
import resource
import shutil
import stat
import subprocess
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from typer.testing import CliRunner

from acquire import bag
from acquire.cli.main import app
from acquire.errors import SessionError, StorageError
from acquire.pipeline import Options, process
from acquire.session import Session
from acquire.session.verification import problems
from tests.acquire.captures import captured


class Quiet:
    def stage(self, name: str, total: int) -> None: ...

    def advance(self) -> None: ...


def nothing() -> None: ...


def digests(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != ".lock"
    }


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made")
    captured(folder / "session")
    process(Session.open(folder / "session"), folder / "result", Options(), Quiet())
    folders = {"session": folder / "session", "result": folder / "result"}
    bag.pack(folders, folder / "one.zip", nothing)
    return folder


def unpacked(path: Path, out: Path) -> Path:
    with bag.opened(path) as content:
        bag.unpack(content, out, nothing)
    return out


def test_what_comes_out_is_what_went_in(made: Path, tmp_path: Path) -> None:
    out = unpacked(made / "one.zip", tmp_path / "out")
    for name in ("session", "result"):
        assert digests(out / name) == digests(made / name)
    session = Session.open(out / "session")
    assert session.complete
    assert [problem for problem in problems(session) if problem] == []


def test_another_lab_gets_bit_identical_results(made: Path, tmp_path: Path) -> None:
    out = unpacked(made / "one.zip", tmp_path / "out")
    process(Session.open(out / "session"), tmp_path / "again", Options(), Quiet())
    ours, theirs = digests(made / "result"), digests(tmp_path / "again")
    pictures = [name for name in ours if name.endswith(".tiff")]
    assert len(pictures) > 5
    assert {name: theirs[name] for name in pictures} == {name: ours[name] for name in pictures}


def test_the_same_files_give_the_same_bytes(made: Path, tmp_path: Path) -> None:
    folders = {"session": made / "session", "result": made / "result"}
    bag.pack(folders, tmp_path / "one.zip", nothing)
    assert (tmp_path / "one.zip").read_bytes() == (made / "one.zip").read_bytes()


def test_common_tools_can_check_it(made: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(made / "one.zip") as archive:
        assert archive.testzip() is None
        archive.extractall(tmp_path)
    for manifest in ("manifest-sha256.txt", "tagmanifest-sha256.txt"):
        subprocess.run(
            ["sha256sum", "--check", "--strict", "--quiet", manifest],
            cwd=tmp_path / "one",
            check=True,
        )


Entries = dict[str, bytes]


def rewritten(source: Path, target: Path, change: Callable[[Entries], object]) -> Path:
    with zipfile.ZipFile(source) as archive:
        entries = {name: archive.read(name) for name in archive.namelist()}
    change(entries)
    with zipfile.ZipFile(target, "w") as archive:
        for name, content in entries.items():
            archive.writestr(name, content)
    return target


def relisted(entries: Entries) -> None:
    """Make the manifests right for what a hostile author put in."""
    payload = {n.removeprefix("one/"): c for n, c in entries.items() if "/data/" in n}
    lines = [f"{hashlib.sha256(c).hexdigest()}  {n}\n" for n, c in payload.items()]
    entries["one/manifest-sha256.txt"] = "".join(lines).encode()
    tags = {n: entries[f"one/{n}"] for n in ("bagit.txt", "manifest-sha256.txt")}
    entries["one/tagmanifest-sha256.txt"] = "".join(
        f"{hashlib.sha256(c).hexdigest()}  {n}\n" for n, c in tags.items()
    ).encode()


def add(name: str) -> Callable[[Entries], object]:
    def change(entries: Entries) -> None:
        entries[name] = b"x"
        relisted(entries)

    return change


def flip(entries: Entries) -> None:
    name = "one/data/session/frames/000003.dng"
    entries[name] = entries[name][:-1] + bytes([entries[name][-1] ^ 1])


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        pytest.param(flip, "digest differs", id="one bit"),
        pytest.param(lambda e: e.pop("one/data/session/plan.json"), "listed", id="file gone"),
        pytest.param(lambda e: e.update({"one/data/x": b""}), "listed", id="file added"),
        pytest.param(lambda e: e.pop("one/bagit.txt"), "missing", id="no declaration"),
        pytest.param(lambda e: e.pop("one/manifest-sha256.txt"), "manifest", id="no manifest"),
        pytest.param(lambda e: e.clear(), "no packed session", id="empty"),
        pytest.param(add("one/data/../../../evil"), "no name", id="out of the folder"),
        pytest.param(add("/data/evil"), "no name", id="absolute"),
        pytest.param(add("one/data/..\\evil"), "no name", id="backslash"),
        pytest.param(add("two/data/evil"), "top", id="two roots"),
        pytest.param(add("one/data/session/PLAN.json"), "twice", id="other capitals"),
        pytest.param(add("one/data/session/plan.json."), "no name", id="dot at the end"),
        pytest.param(add("one/data/session/a b"), "no name", id="space"),
        pytest.param(add("one/data/1/2/3/4/5/6/7/8"), "no name", id="deep"),
        pytest.param(add("one/data/session/\u00e9"), "no name", id="not ASCII"),
    ],
)
def test_what_is_not_sound_is_refused_and_nothing_is_written(
    made: Path, tmp_path: Path, change: Callable[[Entries], object], reason: str
) -> None:
    path = rewritten(made / "one.zip", tmp_path / "bad.zip", change)
    with pytest.raises(SessionError, match=reason):
        unpacked(path, tmp_path / "deep" / "out")
    left = {p.name for p in tmp_path.rglob("*")}
    assert left <= {"bad.zip", "deep"}


def test_a_link_is_refused(made: Path, tmp_path: Path) -> None:
    path = rewritten(made / "one.zip", tmp_path / "bad.zip", lambda _: None)
    with zipfile.ZipFile(path, "a") as archive:
        info = zipfile.ZipInfo("one/data/session/frames/link")
        info.external_attr = (stat.S_IFLNK | 0o777) << 16
        archive.writestr(info, "/etc/passwd")
    with pytest.raises(SessionError, match="link"):
        unpacked(path, tmp_path / "out")


@pytest.mark.parametrize(
    "content", [b"", b"PK\x03\x04", b"x" * 1000], ids=["empty", "cut", "noise"]
)
def test_no_archive_is_one_message(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "x.zip").write_bytes(content)
    with pytest.raises(SessionError, match=r"x\.zip"):
        unpacked(tmp_path / "x.zip", tmp_path / "out")


def test_nothing_is_replaced(made: Path, tmp_path: Path) -> None:
    with pytest.raises(SessionError, match="exists"):
        bag.pack({"session": made / "session"}, made / "one.zip", nothing)
    (tmp_path / "out").mkdir()
    with pytest.raises(SessionError, match="exists"):
        unpacked(made / "one.zip", tmp_path / "out")


@contextmanager
def room_for(n_bytes: int) -> Iterator[None]:
    """As on a disk that fills up while a file is written: the system takes no more of it."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (n_bytes, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


# Parts of the packed file: in the first frame, in the middle, before the directory at its end.
@pytest.mark.parametrize("part", [0.001, 0.5, 0.98])
def test_a_disk_that_fills_up_leaves_no_half_file_and_the_session_as_it_was(
    made: Path, tmp_path: Path, part: float
) -> None:
    before = digests(made / "session")
    with room_for(int(part * (made / "one.zip").stat().st_size)):
        words = ["pack", str(made / "session"), str(made / "result"), "--out"]
        run = CliRunner().invoke(app, [*words, str(tmp_path / "x.zip"), "--quiet"])
    assert isinstance(run.exception, StorageError)
    said = str(run.exception)
    assert f"The disk is full: {tmp_path / 'x.zip'} could not be written." in said
    assert "Nothing of it was left there" in said
    assert not list(tmp_path.iterdir())
    assert digests(made / "session") == before
    bag.pack({"session": made / "session"}, tmp_path / "x.zip", nothing)


def test_a_disk_that_fills_up_leaves_nothing_half_unpacked(made: Path, tmp_path: Path) -> None:
    with room_for((made / "session/frames/000000.dng").stat().st_size // 2):
        words = ["unpack", str(made / "one.zip"), "--out", str(tmp_path / "out"), "--quiet"]
        run = CliRunner().invoke(app, words)
    assert isinstance(run.exception, StorageError)
    assert "The disk is full" in str(run.exception)
    assert not list(tmp_path.iterdir())


def patched(made: Path, tmp_path: Path, change: Callable[[zipfile.ZipFile], object]) -> Path:
    """The bag with its directory, which stands at its end, written anew after a change."""
    path = rewritten(made / "one.zip", tmp_path / "bad.zip", lambda _: None)
    with zipfile.ZipFile(path, "a") as archive:
        change(archive)
        archive._didModify = True  # type: ignore[attr-defined] # writes the directory
    return path


def huge(archive: zipfile.ZipFile) -> None:
    archive.getinfo("one/data/session/plan.json").file_size = 1 << 40


def shared(archive: zipfile.ZipFile) -> None:
    first, *others = archive.infolist()[:200]
    for other in others:
        other.compress_size = first.compress_size + (1 << 20)


def other_method(archive: zipfile.ZipFile) -> None:
    archive.getinfo("one/data/session/plan.json").compress_type = zipfile.ZIP_BZIP2


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        pytest.param(huge, "claims 1099511627776 bytes", id="huge"),
        pytest.param(shared, "more bytes than it has", id="entries over each other"),
        pytest.param(other_method, "neither stored nor deflated", id="other compression"),
    ],
)
def test_a_directory_that_lies_is_refused(
    made: Path, tmp_path: Path, change: Callable[[zipfile.ZipFile], object], reason: str
) -> None:
    with pytest.raises(SessionError, match=reason):
        unpacked(patched(made, tmp_path, change), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_one_that_was_compressed_anew_is_as_good_and_damage_in_it_is_found(
    made: Path, tmp_path: Path
) -> None:
    path = tmp_path / "small.zip"
    with zipfile.ZipFile(made / "one.zip") as one, zipfile.ZipFile(path, "w") as small:
        for name in one.namelist():
            small.writestr(name, one.read(name), zipfile.ZIP_DEFLATED)
        place = small.getinfo("one/data/session/frames/000003.dng").header_offset
    assert digests(unpacked(path, tmp_path / "out") / "session") == digests(made / "session")
    content = bytearray(path.read_bytes())
    content[place + 100 : place + 200] = bytes(100)
    path.write_bytes(content)
    with pytest.raises(SessionError, match="000003"):
        unpacked(path, tmp_path / "again")
    assert not (tmp_path / "again").exists()


@pytest.mark.parametrize("part", [0.1, 0.5, 0.9, 0.999])
def test_half_a_file_is_one_message(made: Path, tmp_path: Path, part: float) -> None:
    content = (made / "one.zip").read_bytes()
    (tmp_path / "half.zip").write_bytes(content[: int(part * len(content))])
    with pytest.raises(SessionError, match=r"half\.zip"):
        unpacked(tmp_path / "half.zip", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "name",
    [
        "-x.zip",
        "\u00dcbung 3 \u2013 Kopie.zip",
        ".zip",
        "..x.zip",
        "a" * 200 + ".zip",
        "\u5149.zip",
    ],
)
def test_whatever_the_file_is_called_it_can_be_unpacked(
    made: Path, tmp_path: Path, name: str
) -> None:
    folder = tmp_path / "mit Leerzeichen \u00fc"
    folder.mkdir()
    bag.pack({"session": made / "session"}, folder / name, nothing)
    out = unpacked(folder / name, folder / "zur\u00fcck 1")
    assert digests(out / "session") == digests(made / "session")


def test_what_nobody_could_unpack_is_not_packed(made: Path, tmp_path: Path) -> None:
    shutil.copytree(made / "session", tmp_path / "s")
    (tmp_path / "s" / "profiles").mkdir()
    (tmp_path / "s" / "profiles" / "mein Profil.json").write_text("{}")
    with pytest.raises(SessionError, match=r"mein Profil\.json has a name"):
        bag.pack({"session": tmp_path / "s"}, tmp_path / "x.zip", nothing)
    assert not (tmp_path / "x.zip").exists()
