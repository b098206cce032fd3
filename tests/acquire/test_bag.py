"""A session in one file: what comes out is what went in, and nothing else comes out."""

from __future__ import annotations

import hashlib
import stat
import subprocess
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from acquire import bag
from acquire.errors import SessionError
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
