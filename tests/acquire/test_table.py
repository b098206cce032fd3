"""Importing a stack that somebody else captured: what becomes a session and what is refused."""

from __future__ import annotations

import io
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import cv2
import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray
from PIL import Image, ImageCms

from acquire.errors import LumisplitError, SessionError, StackError
from acquire.session import Session, Transfer
from acquire.session.verification import problems
from acquire.stack import Stack
from acquire.table import import_table
from drivers.protocols import CameraSettings
from drivers.sim.dng import encode_dng

Change: TypeAlias = Callable[[Path], object]

HEADER = "file,role,pattern,pitch_px,shift_y_px,shift_x_px"
ROWS = (
    "w.png,white,,,,",
    "k.png,black,,,,",
    "0.png,pattern,checker,8,0,0",
    "1.png,pattern,checker,8,0,8",
)
FILES = ("w.png", "k.png", "0.png", "1.png")
PIXELS = np.random.default_rng(9).integers(0, 256, (4, 6, 3), np.uint8)


@dataclass
class Progress:
    """An observer that remembers, and may interrupt."""

    interrupt_at: tuple[str, int] | None = None
    stages: dict[str, list[int]] = field(default_factory=dict)
    _name: str = ""

    def stage(self, name: str, total: int) -> None:
        self._name = name
        self.stages[name] = [0, total]

    def advance(self) -> None:
        self.stages[self._name][0] += 1
        if (self._name, self.stages[self._name][0]) == self.interrupt_at:
            raise KeyboardInterrupt


def png(pixels: NDArray[Any] = PIXELS) -> bytes:
    return cv2.imencode(".png", pixels)[1].tobytes()


def tiff(pixels: NDArray[Any], **options: Any) -> bytes:
    buffer = io.BytesIO()
    tifffile.imwrite(buffer, pixels, photometric="rgb", **options)
    return buffer.getvalue()


def pillow(kind: str, **options: Any) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(PIXELS).save(buffer, kind, **options)
    return buffer.getvalue()


def dng() -> bytes:
    return encode_dng(np.full((32, 48), 4000, np.uint16), CameraSettings(0.1))


def write_stack(folder: Path, data: bytes | None = None, rows: tuple[str, ...] = ROWS) -> Path:
    folder.mkdir(exist_ok=True)
    for number, name in enumerate(FILES):
        (folder / name).write_bytes(png(PIXELS // (number + 1)) if data is None else data)
    (folder / "table.csv").write_text("\n".join((HEADER, *rows)) + "\n")
    return folder / "table.csv"


def imported(table: Path, out: Path, **options: Any) -> Session:
    return import_table(table, out, progress=Progress(), **options)


def notes_of(session: Session) -> str:
    assert session.record.source is not None
    return "\n".join(note.text for note in session.record.source.notes)


def test_files_become_a_session_byte_for_byte(tmp_path: Path) -> None:
    table, progress = write_stack(tmp_path / "stack"), Progress()
    import_table(table, tmp_path / "session", progress=progress)
    session = Session.open(tmp_path / "session")
    assert session.complete
    assert not any(problems(session))
    assert [session.read(frame) for frame in session.frames] == [
        (table.parent / name).read_bytes() for name in FILES
    ]
    assert [str(frame.pattern) for frame in session.frames] == [
        "white",
        "black",
        "checker:8:0,0",
        "checker:8:0,8",
    ]
    assert all(frame.settings is None for frame in session.frames)
    assert session.record.bench == {"kind": "import"}
    assert [run.outcome for run in session.record.runs] == ["complete"]
    assert progress.stages == {"checking": [4, 4], "copying": [4, 4]}


KINDS = {
    "png-8": (
        png(),
        "auto",
        Transfer.SRGB,
        "The 8-bit pictures were linearised with",
    ),
    "png-8-linear": (png(), "linear", Transfer.LINEAR, "8-bit pictures were taken as linear"),
    "jpeg": (pillow("JPEG"), "auto", Transfer.SRGB, "The pictures are JPEG files."),
    "tiff-8": (tiff(PIXELS), "auto", Transfer.SRGB, "sRGB curve"),
    "png-16": (png(PIXELS * np.uint16(257)), "auto", Transfer.LINEAR, "16-bit pictures were taken"),
    "png-16-srgb": (png(PIXELS * np.uint16(257)), "srgb", Transfer.SRGB, "16-bit pictures were li"),
    "tiff-16": (tiff(PIXELS * np.uint16(257)), "auto", Transfer.LINEAR, "highest code"),
    "tiff-float": (tiff(PIXELS / np.float32(255)), "auto", Transfer.LINEAR, "no white level"),
    "dng": (dng(), "auto", Transfer.RAW, "exposures are unknown"),
}


@pytest.mark.parametrize(("data", "wanted", "transfer", "note"), KINDS.values(), ids=KINDS)
def test_kinds_of_files_and_how_their_numbers_are_read(
    tmp_path: Path, data: bytes, wanted: str, transfer: Transfer, note: str
) -> None:
    session = imported(write_stack(tmp_path / "stack", data), tmp_path / "out", transfer=wanted)
    assert session.record.source is not None
    assert session.record.source.transfer is transfer
    assert note in notes_of(session)
    assert ("sRGB curve" in notes_of(session)) == (transfer is Transfer.SRGB)
    assert ("no white level" in notes_of(session)) == (data == KINDS["tiff-float"][0])
    assert session.read(session.frames[0]) == data


def test_an_imported_stack_decodes_to_linear_light(tmp_path: Path) -> None:
    codes = np.full((4, 6, 3), 188, np.uint8)
    session = imported(write_stack(tmp_path / "stack", png(codes)), tmp_path / "out")
    ((_, image),) = Stack(session).images(session.frames[:1])
    np.testing.assert_allclose(image.values, 0.502886458, rtol=1e-6)


SPELLINGS = {
    "byte-order mark": lambda text: "\ufeff" + text,
    "Windows line ends": lambda text: text.replace("\n", "\r\n"),
    "quoted": lambda text: text.replace("checker", '"checker"'),
    "capitals and blanks": lambda text: text.replace("white", " White").replace("file,", "File ,"),
    "numbers with a point": lambda text: text.replace(",8,0,", ",8.0,0.0,"),
    "blank lines": lambda text: text.replace("\n", "\n\n"),
    "no empty cells at the end": lambda text: text.replace("white,,,,", "white"),
    "a folder for the files": lambda text: text.replace("w.png", "./w.png"),
    "columns in another order and more of them": lambda text: "\n".join(
        ",".join([*reversed(line.split(",")), "x"]) for line in text.splitlines()
    ),
}


@pytest.mark.parametrize("spell", SPELLINGS.values(), ids=SPELLINGS)
def test_spellings_of_the_same_table(tmp_path: Path, spell: Callable[[str], str]) -> None:
    table = write_stack(tmp_path / "stack")
    plan = imported(table, tmp_path / "plain").plan
    table.write_bytes(spell(table.read_text()).encode())
    assert imported(table, tmp_path / "other").plan == plan


def row(number: int, text: str) -> Change:
    """Replace a line of the table (2 is the first frame)."""

    def change(table: Path) -> None:
        lines = table.read_text().splitlines()
        lines[number - 1] = text
        table.write_text("\n".join(lines) + "\n")

    return change


def added(*rows: str) -> Change:
    return lambda table: table.write_text(table.read_text() + "\n".join(rows) + "\n")


def content(data: bytes) -> Change:
    return lambda table: table.write_bytes(data)


def picture(name: str, data: bytes) -> Change:
    return lambda table: (table.parent / name).write_bytes(data)


def remove(table: Path) -> None:
    table.unlink()


def replace_by_folder(table: Path) -> None:
    table.unlink()
    table.mkdir()


def lose_two(table: Path) -> None:
    (table.parent / "0.png").unlink()
    (table.parent / "k.png").unlink()


def link_out(table: Path) -> None:
    (table.parent.parent / "secret.png").write_bytes(png())
    (table.parent / "0.png").unlink()
    (table.parent / "0.png").symlink_to(table.parent.parent / "secret.png")


def link_round(table: Path) -> None:
    (table.parent / "0.png").unlink()
    (table.parent / "0.png").symlink_to("0.png")


def make_folder(table: Path) -> None:
    (table.parent / "0.png").unlink()
    (table.parent / "0.png").mkdir()


def make_pipe(table: Path) -> None:
    (table.parent / "0.png").unlink()
    os.mkfifo(table.parent / "0.png")


def no_pictures(table: Path) -> None:
    table.write_text("\n".join((HEADER, *ROWS[:2])) + "\n")


SMALLER = png(PIXELS[:2])
WRONG: dict[str, tuple[Change, tuple[str, ...]]] = {
    "no table": (remove, ("table.csv", "no such file")),
    "table is a folder": (replace_by_folder, ("table.csv", "not a plain file")),
    "empty table": (content(b""), ("line 1", "lacks file, role, pattern")),
    "not UTF-8": (content(b"\xff\xfe" + HEADER.encode("utf-16-le")), ("UTF-8",)),
    "unfinished quote": (content(f'{HEADER}\n"w.png,white'.encode()), ("not valid CSV",)),
    "absurdly long": (lambda table: os.truncate(table, 1 << 40), ("no table of frames",)),
    "column missing": (row(1, "file,role,pattern,pitch_px"), ("line 1", "shift_y_px, shift_x_px")),
    "semicolons": (row(1, HEADER.replace(",", ";")), ("line 1", "separated by commas")),
    "column twice": (row(1, HEADER + ",role"), ("line 1", "role more than once")),
    "too many values": (row(4, "a,b.png,pattern,checker,8,0,0"), ("line 4", "7 values")),
    "unknown role": (row(4, "0.png,flash,checker,8,0,0"), ("line 4", "role", "'flash'", "white")),
    "no file": (row(4, ",pattern,checker,8,0,0"), ("line 4", "column file", "''")),
    "control character": (row(4, "a\0.png,pattern,checker,8,0,0"), ("line 4", "column file")),
    "unknown pattern": (row(4, "0.png,pattern,dots,8,0,0"), ("line 4", "'dots'", "stripes-rows")),
    "reference as pattern": (row(4, "0.png,pattern,white,,,"), ("line 4", "'white' is unknown")),
    "white with a pattern": (row(2, "w.png,white,checker,8,0,0"), ("line 2", "column pattern")),
    "white with a pitch": (row(2, "w.png,white,,8,0,0"), ("line 2", "column pitch_px", "'8'")),
    "no pitch": (row(4, "0.png,pattern,checker,,0,0"), ("line 4", "column pitch_px", "''")),
    "pitch in words": (row(4, "0.png,pattern,checker,eight,0,0"), ("line 4", "'eight'", "whole")),
    "half a pixel": (row(4, "0.png,pattern,checker,8,0.5,0"), ("line 4", "shift_y_px", "'0.5'")),
    "negative shift": (row(4, "0.png,pattern,checker,8,0,-1"), ("line 4", "shift_x_px", "'-1'")),
    "absurd pitch": (row(4, f"0.png,pattern,checker,{10**30},0,0"), ("line 4", "pitch_px")),
    "shift across": (
        row(4, "0.png,pattern,stripes-rows,8,0,4"),
        ("line 4", "column shift_x_px", "does not vary to the right"),
    ),
    "several at once": (
        lambda table: [change(table) for change in (row(3, "k.png,dark"), row(4, "0.png,?"))],
        ("line 3", "'dark'", "line 4", "'?'"),
    ),
    "more than are listed": (
        added(*(f"{n}.png,dark,,,," for n in range(9))),
        ("line 6", "line 10", "and 4 more"),
    ),
    "file twice": (row(5, "./0.png,pattern,checker,8,0,8"), ("line 5", "line 4", "0.png")),
    "pattern twice": (row(5, "1.png,pattern,checker,8,0,0"), ("line 5", "checker:8:0,0", "line 4")),
    "no patterns": (no_pictures, ("no line with role pattern",)),
    "one shift only": (
        lambda table: table.write_text("\n".join((HEADER, *ROWS[:3])) + "\n"),
        ("line 4", "checker at pitch 8", "1 different shift"),
    ),
    "the same shift by another name": (
        row(5, "1.png,pattern,checker,8,8,8"),
        ("line 4, 5", "1 different shift"),
    ),
    "two phases of a sinusoid": (
        lambda table: [row(n, f"{n - 4}.png,pattern,sinusoid-rows,8,{n},0")(table) for n in (4, 5)],
        ("sinusoid-rows at pitch 8", "2 different shift", "3 are the least"),
    ),
    "missing files": (lose_two, ("line 3", "'k.png'", "line 4", "'0.png'", "no such file")),
    "upward path": (row(4, "../0.png,pattern,checker,8,0,0"), ("line 4", "beside its pictures")),
    "absolute path": (row(4, "/etc/passwd,pattern,checker,8,0,0"), ("line 4", "outside")),
    "drive letter": (row(4, "C:\\0.png,pattern,checker,8,0,0"), ("line 4", "outside")),
    "backslashes": (row(4, "a\\0.png,pattern,checker,8,0,0"), ("line 4", "with / between")),
    "link to outside": (link_out, ("line 4", "outside")),
    "link to itself": (link_round, ("line 4", "cannot be read")),
    "a folder": (make_folder, ("line 4", "not a plain file")),
    "a pipe": (make_pipe, ("line 4", "not a plain file")),
    "a name too long": (row(4, "a" * 300 + ",pattern,checker,8,0,0"), ("line 4", "too long")),
    "empty file": (picture("0.png", b""), ("line 4", "empty")),
    "no picture": (picture("0.png", b"hello"), ("line 4", "neither TIFF, PNG or JPEG")),
    "cut-off picture": (picture("0.png", png()[:-20]), ("line 4", "cut off")),
    "half-transparent picture": (
        picture("0.png", png(np.dstack([PIXELS, PIXELS[..., 0]]))),
        ("line 4", "partly transparent"),
    ),
    "absurd file": (
        lambda table: os.truncate(table.parent / "0.png", 1 << 40),
        ("line 4", "1099511627776 bytes"),
    ),
    "mixed sizes": (picture("0.png", SMALLER), ("line 4", "6 × 2 px", "w.png", "6 × 4 px")),
    "the first one differs": (picture("w.png", SMALLER), ("line 2", "'w.png' is", "6 × 2 px")),
    "mixed formats": (picture("0.png", pillow("JPEG")), ("line 4", "image/jpeg", "image/png")),
    "mixed depths": (picture("0.png", png(PIXELS * np.uint16(257))), ("line 4", "uint16", "uint8")),
    "raws among pictures": (picture("0.png", dng()), ("line 4", "image/x-adobe-dng", "image/png")),
}


@pytest.mark.parametrize(("spoil", "words"), WRONG.values(), ids=WRONG)
def test_a_mistake_is_one_message_and_nothing_is_written(
    tmp_path: Path, spoil: Change, words: tuple[str, ...]
) -> None:
    table = write_stack(tmp_path / "stack")
    spoil(table)
    with pytest.raises(StackError) as caught:
        imported(table, tmp_path / "out")
    message = str(caught.value)
    assert "table.csv" in message
    assert [word for word in words if word not in message] == []
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("data", "words"),
    [(dng(), "raw"), (tiff(PIXELS / np.float32(255)), "floating point")],
    ids=["raw", "float"],
)
def test_the_srgb_curve_is_refused_where_it_cannot_be(
    tmp_path: Path, data: bytes, words: str
) -> None:
    table = write_stack(tmp_path / "stack", data)
    with pytest.raises(StackError, match=f"--transfer srgb: .*{words}"):
        imported(table, tmp_path / "out", transfer="srgb")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("after", [("checking", 2), ("copying", 1), ("copying", 3)], ids=str)
def test_an_interrupted_import_goes_on_to_the_same_session(
    tmp_path: Path, after: tuple[str, int]
) -> None:
    table = write_stack(tmp_path / "stack")
    with pytest.raises(KeyboardInterrupt):
        import_table(table, tmp_path / "out", progress=Progress(interrupt_at=after))
    again = Progress()
    session = import_table(table, tmp_path / "out", progress=again)
    done = after[1] if after[0] == "copying" else 0
    assert again.stages["copying"] == [4 - done, 4 - done]
    assert not any(problems(Session.open(tmp_path / "out")))
    whole = imported(table, tmp_path / "whole")
    assert session.frames == whole.frames
    outcomes = [run.outcome for run in session.record.runs]
    assert outcomes == (["stopped", "complete"] if done else ["complete"])


def test_the_same_import_again_writes_nothing(tmp_path: Path) -> None:
    table = write_stack(tmp_path / "stack")
    imported(table, tmp_path / "out")
    before = (tmp_path / "out" / "session.json").read_bytes()
    assert imported(table, tmp_path / "out").complete
    assert (tmp_path / "out" / "session.json").read_bytes() == before


def test_a_file_that_changes_under_the_import_is_not_taken(tmp_path: Path) -> None:
    table = write_stack(tmp_path / "stack")

    class Meddler(Progress):
        def stage(self, name: str, total: int) -> None:
            super().stage(name, total)
            if name == "copying":
                (table.parent / "0.png").write_bytes(png(255 - PIXELS))

    with pytest.raises(StackError, match=r"0\.png changed while"):
        import_table(table, tmp_path / "out", progress=Meddler())
    session = Session.open(tmp_path / "out")
    assert len(session.frames) == 2
    assert session.record.runs[-1].outcome == "failed"


def occupy(out: Path) -> None:
    out.mkdir()
    (out / "thesis.txt").write_text("mine")


def import_other(out: Path) -> None:
    imported(write_stack(out.parent / "other", png(255 - PIXELS)), out)


@pytest.mark.parametrize("occupied", [occupy, import_other], ids=["files", "another session"])
def test_a_folder_that_holds_something_else_is_left_alone(tmp_path: Path, occupied: Change) -> None:
    out = tmp_path / "out"
    occupied(out)
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    with pytest.raises(SessionError, match="--out"):
        imported(write_stack(tmp_path / "stack"), out)
    after = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    assert {path: after[path] for path in before} == before
    assert {path.name for path in after} - {path.name for path in before} <= {".lock"}


def test_the_disk_is_asked_for_room_first(tmp_path: Path) -> None:
    table = write_stack(tmp_path / "stack")
    with pytest.raises(LumisplitError) as caught:
        imported(table, Path("/proc/out"))
    assert "/proc/out" in str(caught.value)


EXTREMA = "Each pitch has two frames, of which one is nowhere darker than the other."
MISSING = {
    "white": (ROWS[1:], "There is no white frame."),
    "black": (ROWS[:1] + ROWS[2:], "There is no black frame."),
    "shifts": (ROWS, EXTREMA),
    "switching": (
        (*ROWS[:3], "1.png,pattern,checker,8,0,2"),
        "At checker, pitch 8, 75.0% of the projector's pixels are never both lit and dark.",
    ),
}


@pytest.mark.parametrize(("rows", "note"), MISSING.values(), ids=MISSING)
def test_what_is_missing_but_allowed_is_noted(
    tmp_path: Path, rows: tuple[str, ...], note: str
) -> None:
    assert note in notes_of(imported(write_stack(tmp_path / "stack", rows=rows), tmp_path / "out"))


def test_two_positions_are_told_from_extrema(tmp_path: Path) -> None:
    """The second file is half as bright as the first, an extremum; turned over, it is not."""
    table = write_stack(tmp_path / "stack")
    extrema = notes_of(imported(table, tmp_path / "extrema"))
    assert "two shifts only" not in extrema
    (table.parent / "1.png").write_bytes(png(PIXELS[::-1] // 3))
    positions = notes_of(imported(table, tmp_path / "positions"))
    assert "There are two shifts only at checker 8 px." in positions
    assert EXTREMA not in positions


@pytest.mark.parametrize(
    ("depth", "noted"),
    [(np.uint8(1), False), (np.uint16(257), True)],
    ids=["the curve fits", "taken as linear"],
)
def test_a_color_profile_that_was_not_applied_is_noted(
    tmp_path: Path, depth: np.unsignedinteger[Any], noted: bool
) -> None:
    icc = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    data = tiff(PIXELS * depth, iccprofile=icc)
    session = imported(write_stack(tmp_path / "stack", data), tmp_path / "out")
    assert ("colour profile" in notes_of(session)) is noted
