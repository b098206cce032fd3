from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from acquire.errors import SessionError
from acquire.session import Session
from acquire.session.verification import happenings, problems
from tests.acquire.captures import Notes, captured, recorded_bytes


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    captured(tmp_path / "session")
    return tmp_path / "session"


def found(folder: Path) -> list[str]:
    return [problem for problem in problems(Session.open(folder)) if problem is not None]


def edit_line(folder: Path, number: int, **changes: object) -> None:
    lines = (folder / "frames.jsonl").read_text().splitlines()
    lines[number] = json.dumps(json.loads(lines[number]) | changes)
    (folder / "frames.jsonl").write_text("\n".join(lines) + "\n")


def test_a_sound_session_has_no_problems(folder: Path) -> None:
    session = Session.open(folder)
    assert session.complete
    assert found(folder) == []


def flip(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def replace_by_link(path: Path) -> None:
    path.rename(path.parent.parent.parent / "elsewhere.dng")
    path.symlink_to(path.parent.parent.parent / "elsewhere.dng")


def replace_by_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def replace_by_pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


@pytest.mark.parametrize(
    ("damage", "reason"),
    [
        pytest.param(flip, "digest differs", id="one bit flipped"),
        pytest.param(lambda path: path.write_bytes(b""), "digest differs", id="emptied"),
        pytest.param(lambda path: os.truncate(path, 10**9), "make sense", id="grown to 1 GB"),
        pytest.param(Path.unlink, "No such file", id="gone"),
        pytest.param(replace_by_link, "it is a link", id="a link out of the folder"),
        pytest.param(replace_by_pipe, "not a plain file", id="a pipe"),
        pytest.param(replace_by_folder, "not a plain file", id="a folder"),
    ],
)
def test_verify_names_a_damaged_frame(
    folder: Path, damage: Callable[[Path], object], reason: str
) -> None:
    damage(folder / "frames" / "000003.dng")
    (problem,) = found(folder)
    assert "000003.dng" in problem
    assert reason in problem


def test_verify_names_strangers_and_a_torn_line(folder: Path) -> None:
    (folder / "frames" / "999999.dng").write_bytes(b"x")
    (folder / "notes.txt").write_text("x")
    with (folder / "frames.jsonl").open("ab") as lines:
        lines.write(b'{"step":')
    problem_list = "\n".join(found(folder))
    assert "999999.dng belongs to no line" in problem_list
    assert "notes.txt is not part" in problem_list
    assert "unfinished" not in problem_list
    assert any("is unfinished" in line for line in happenings(Session.open(folder)))


@pytest.mark.parametrize(
    "name",
    [
        "../../etc/passwd",
        "/etc/passwd",
        "frames/../plan.json",
        "frames/000003.dng/..",
        "frames/",
        "",
    ],
)
def test_no_path_leads_out(folder: Path, name: str) -> None:
    edit_line(folder, 3, file=name)
    with pytest.raises(SessionError, match="line 4"):
        Session.open(folder)


@pytest.mark.parametrize(
    "changes",
    [
        pytest.param({"step": 5}, id="another step"),
        pytest.param({"step": -1}, id="negative step"),
        pytest.param({"pattern": "white"}, id="another pattern"),
        pytest.param({"pattern": "checker:99999999999:0,0"}, id="absurd pitch"),
        pytest.param({"size_bytes": 2**40}, id="absurd size"),
        pytest.param({"sha256": "abc"}, id="no digest"),
        pytest.param({"started_s": float("nan")}, id="nan time"),
        pytest.param(
            {"settings": {"exposure_s": float("inf"), "aperture": 8.0, "iso": 200}},
            id="endless exposure",
        ),
        pytest.param({"extra": 1}, id="unknown key"),
        pytest.param({"media_type": "text/html"}, id="no picture"),
        pytest.param({"media_type": "image/" + "x" * 5000}, id="endless line"),
    ],
)
def test_hostile_lines_are_refused(folder: Path, changes: dict[str, object]) -> None:
    edit_line(folder, 3, **changes)
    with pytest.raises(SessionError, match="line 4"):
        Session.open(folder)


@pytest.mark.parametrize(
    ("damage", "reason"),
    [
        pytest.param(lambda f: (f / "plan.json").write_text("{}"), "cannot be used", id="no plan"),
        pytest.param(
            lambda f: (f / "plan.json").write_text(
                (f / "plan.json").read_text().replace('"iso": 200', '"iso": 400')
            ),
            "was changed after",
            id="plan edited",
        ),
        pytest.param(
            lambda f: (f / "session.json").write_bytes(b"[" * 100_000),
            "cannot be used",
            id="deep nesting",
        ),
        pytest.param(
            lambda f: os.truncate(f / "session.json", 10**10), "make sense", id="10 GB record"
        ),
        pytest.param(
            lambda f: os.truncate(f / "frames.jsonl", 10**10), "make sense", id="10 GB of lines"
        ),
        pytest.param(lambda f: (f / "session.json").unlink(), "not a session", id="no record"),
        pytest.param(
            lambda f: (f / "frames.jsonl").write_bytes(b"\x01\xff\n"), "line 1", id="noise"
        ),
        pytest.param(
            lambda f: ((f / "frames").rename(f / "x"), (f / "frames").symlink_to(f / "x")),
            "folder of its own",
            id="frames is a link",
        ),
    ],
)
def test_a_damaged_folder_is_one_message(
    folder: Path, damage: Callable[[Path], object], reason: str
) -> None:
    damage(folder)
    with pytest.raises(SessionError, match=reason):
        Session.open(folder)


def leave_torn_line(folder: Path) -> None:
    path = folder / "frames.jsonl"
    os.truncate(path, path.stat().st_size - 20)


def leave_file_without_line(folder: Path) -> None:
    lines = (folder / "frames.jsonl").read_bytes().splitlines(keepends=True)
    (folder / "frames.jsonl").write_bytes(b"".join(lines[:-1]))


def leave_half_a_file(folder: Path) -> None:
    leave_file_without_line(folder)
    last = max((folder / "frames").iterdir())
    last.rename(last.with_name(f".{last.name}.part"))
    os.truncate(last.with_name(f".{last.name}.part"), 100)


@pytest.mark.parametrize(
    "crash", [leave_torn_line, leave_file_without_line, leave_half_a_file], ids=lambda f: f.__name__
)
def test_every_crash_state_is_gone_on_from(tmp_path: Path, crash: Callable[[Path], None]) -> None:
    captured(tmp_path / "whole")
    stop = Notes(stop_after=7)
    captured(tmp_path / "crashed", notes=stop)
    crash(tmp_path / "crashed")
    captured(tmp_path / "crashed")
    assert recorded_bytes(tmp_path / "crashed") == recorded_bytes(tmp_path / "whole")
    assert found(tmp_path / "crashed") == []


def test_a_capture_that_died_before_its_first_frame(tmp_path: Path) -> None:
    (tmp_path / "s" / "frames").mkdir(parents=True)
    (tmp_path / "s" / ".plan.json.part").write_bytes(b"{")
    captured(tmp_path / "s")
    (tmp_path / "s" / ".plan.json.part").unlink(missing_ok=True)
    assert Session.open(tmp_path / "s").complete


def test_one_writer_at_a_time(folder: Path) -> None:
    with Session.locked(folder), pytest.raises(SessionError, match="Another lumisplit"):
        captured(folder)


def test_a_folder_with_other_things_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("ten years")
    with pytest.raises(SessionError, match="not an empty folder"):
        captured(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize("name", [".session.json.part", ".lock", "frames/.000005.dng.part"])
def test_a_planted_link_is_not_followed(tmp_path: Path, name: str) -> None:
    folder, victim = tmp_path / "s", tmp_path / "victim"
    victim.write_text("precious")
    captured(folder, notes=Notes(stop_after=4))
    (folder / name).unlink(missing_ok=True)
    (folder / name).symlink_to(victim)
    with contextlib.suppress(SessionError):
        captured(folder)
    assert victim.read_text() == "precious"


def test_a_carriage_return_is_no_end_of_a_line(folder: Path) -> None:
    content = (folder / "frames.jsonl").read_bytes()
    (folder / "frames.jsonl").write_bytes(content.replace(b",", b",\r", 3))
    assert Session.open(folder).complete


def test_a_line_that_does_not_fit_is_taken_back(tmp_path: Path) -> None:
    path = tmp_path / "lines"
    script = (
        "import resource, signal, sys; from pathlib import Path;"
        "from acquire.errors import StorageError;"
        "from acquire.session.folder import append_durably;"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN);"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (150, 150));"
        "path = Path(sys.argv[1]);"
        "append_durably(path, b'x' * 99 + b'\\n', make=True)\n"
        "try: append_durably(path, b'y' * 99 + b'\\n')\n"
        "except StorageError as error: print(error)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, str(path)], check=True, capture_output=True, text=True
    )
    assert "The disk is full" in done.stdout
    assert path.read_bytes() == b"x" * 99 + b"\n"


def test_an_impossible_name_is_one_message(tmp_path: Path) -> None:
    with pytest.raises(SessionError, match="too long"):
        captured(tmp_path / ("x" * 300))
