from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from acquire.cli.main import app
from acquire.errors import LumisplitError
from acquire.pipeline import METHODS
from acquire.plan_file import example_text
from drivers.errors import DriverError
from tests.acquire.captures import SMALL_PLAN

BENCH = 'kind = "sim"\n[sim]\nscene = "board"\ncamera_px = [24, 32]\nprojector_px = [96, 128]\n'


@pytest.fixture
def desk(tmp_path: Path) -> Path:
    """A folder with a plan, a bench and a table."""
    (tmp_path / "plan.toml").write_text(SMALL_PLAN)
    (tmp_path / "bench.toml").write_text(BENCH)
    (tmp_path / "wide.toml").write_text("[pattern]\npitch_px = [8, 4000]\n")
    (tmp_path / "broken.toml").write_text("[pattern\n")
    (tmp_path / "empty.csv").write_text("file,role\n")
    return tmp_path


def run(desk: Path, *words: str) -> Result:
    return CliRunner().invoke(app, [word.format(desk=desk) for word in words])


def ran(desk: Path, *words: str) -> str:
    result = run(desk, *words)
    assert result.exit_code == 0, (result.output, result.exception)
    return result.output


def lumisplit(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "acquire", *words], check=False, capture_output=True, text=True
    )


def test_the_whole_way(desk: Path) -> None:
    ran(desk, "capture", "{desk}/plan.toml", "--bench", "{desk}/bench.toml", "--out", "{desk}/s")
    assert "complete, every digest is right" in ran(desk, "verify", "{desk}/s")
    output = ran(desk, "process", "{desk}/s", "--out", "{desk}/r", "--components", "2")
    assert "report.html" in output
    table = ran(desk, "evaluate", "{desk}/r", "--truth", "{desk}/s/truth.npz")
    assert "direct" in table
    judged = ("evaluate", "{desk}/r", "--truth", "{desk}/s/truth.npz", "--json", "--quiet")
    rows = json.loads(ran(desk, *judged))["rows"]
    assert {"truth", "estimate", "matching", "error", "error_after_gains"} == set(rows[0])
    (desk / "r" / "report.html").unlink()
    ran(desk, "report", "{desk}/r")
    assert (desk / "r" / "report.html").exists()


def test_plan_says_what_it_costs(desk: Path) -> None:
    output = ran(desk, "plan", "{desk}/plan.toml")
    assert "frames   18" in output
    assert "time     about 0 min 4 s" in output
    assert "disk" in output


def test_the_example_is_a_plan(desk: Path) -> None:
    (desk / "example.toml").write_text(ran(desk, "plan", "--example"))
    assert (desk / "example.toml").read_text() == example_text()
    assert "frames   838" in ran(desk, "plan", "{desk}/example.toml")


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        pytest.param(["plan"], "Name a plan", id="no plan"),
        pytest.param(["plan", "{desk}/none.toml"], "Cannot read the plan", id="plan missing"),
        pytest.param(["plan", "{desk}/broken.toml"], "not valid TOML", id="plan broken"),
        pytest.param(["plan", "{desk}/wide.toml"], "pitch_px", id="pitch too wide"),
        pytest.param(["plan", "{desk}"], "Cannot read the plan", id="plan is a folder"),
        pytest.param(
            ["capture", "{desk}/wide.toml", "--out", "{desk}/s"], "pitch_px", id="capture too wide"
        ),
        pytest.param(
            ["capture", "{desk}/plan.toml", "--out", "{desk}"], "not an empty folder", id="taken"
        ),
        pytest.param(
            ["capture", "{desk}/plan.toml", "--out", "{desk}/plan.toml"],
            "not an empty folder",
            id="out is a file",
        ),
        pytest.param(
            ["capture", "{desk}/plan.toml", "--out", "{desk}/plan.toml/s"],
            "Not a directory",
            id="out below a file",
        ),
        pytest.param(
            ["capture", "{desk}/plan.toml", "--out", "{desk}/s", "--bench", "x.toml"],
            "There is no bench",
            id="bench missing",
        ),
        pytest.param(
            ["import", "{desk}/none.csv", "--out", "{desk}/s"], "no such file", id="table missing"
        ),
        pytest.param(
            ["import", "{desk}/empty.csv", "--out", "{desk}/s"], "pattern", id="table columns"
        ),
        pytest.param(["verify", "{desk}/none"], "no session at", id="session missing"),
        pytest.param(["verify", "{desk}"], "not a session", id="no session"),
        pytest.param(
            ["process", "{desk}", "--out", "{desk}/r"], "not a session", id="process nothing"
        ),
        pytest.param(
            ["evaluate", "{desk}", "--truth", "{desk}/t.npz"], "not a result", id="no result"
        ),
        pytest.param(["report", "{desk}"], "not a result", id="report nothing"),
    ],
)
def test_every_mistake_is_one_message(desk: Path, words: Sequence[str], reason: str) -> None:
    result = run(desk, *words)
    assert isinstance(result.exception, (LumisplitError, DriverError)), result.exception
    assert reason in str(result.exception)
    assert not (desk / "s").exists()


@pytest.mark.parametrize(
    ("words", "status", "said"),
    [
        pytest.param(["plan", "none.toml"], 1, "lumisplit: Cannot read", id="error"),
        pytest.param(["capture"], 2, "Missing argument", id="usage"),
        pytest.param(["no-such-command"], 2, "No such command", id="command"),
        pytest.param(["--version"], 0, "lumisplit 0.", id="version"),
    ],
)
def test_exit_status_and_no_traceback(words: Sequence[str], status: int, said: str) -> None:
    done = lumisplit(*words)
    assert done.returncode == status
    assert said in done.stdout + done.stderr
    assert "Traceback" not in done.stderr


def test_what_verify_finds_fails_the_command(desk: Path) -> None:
    ran(desk, "capture", "{desk}/plan.toml", "--bench", "{desk}/bench.toml", "--out", "{desk}/s")
    (desk / "s" / "frames" / "000002.dng").write_bytes(b"")
    result = run(desk, "verify", "{desk}/s")
    assert result.exit_code == 1
    assert "000002.dng" in result.output


def test_progress_off_a_terminal_is_plain_lines(desk: Path) -> None:
    words = ["capture", f"{desk}/plan.toml", "--bench", f"{desk}/bench.toml", "--out"]
    loud = lumisplit(*words, f"{desk}/a")
    assert loud.stderr.splitlines()[0] == "capturing: 18 to do"
    assert "\x1b" not in loud.stderr + loud.stdout
    quiet = lumisplit(*words, f"{desk}/b", "--quiet")
    assert quiet.stderr == ""
    assert quiet.stdout.splitlines() == [f"18 frames in {desk}/b"]


def test_the_command_line_waits_for_no_library_that_only_some_commands_need() -> None:
    program = "import sys, acquire.cli; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    loaded = {name.partition(".")[0] for name in done.stdout.split()}
    assert {"acquire", "typer"} <= loaded
    assert not loaded & {"matplotlib", "scipy", "numba", "cv2", "rawpy", "PIL"}


def test_the_help_names_every_method() -> None:
    help_text = CliRunner().invoke(app, ["process", "--help"], env={"COLUMNS": "200"}).output
    assert f"One of: {', '.join(METHODS)}." in help_text


def test_scripts_get_json_and_nothing_else(desk: Path) -> None:
    bench = ["--bench", "{desk}/bench.toml"]
    plan = json.loads(ran(desk, "plan", "{desk}/plan.toml", *bench, "--json"))
    assert (plan["frames"], plan["projector_px"]) == (18, [96, 128])
    assert plan["time_s"] == pytest.approx(18 * 0.25)
    words = ["capture", f"{desk}/plan.toml", "--bench", f"{desk}/bench.toml", "--out", f"{desk}/s"]
    captured = json.loads(lumisplit(*words, "--json", "--page", "--quiet").stdout)
    assert captured["outcome"] == "complete"
    assert (captured["frames"], captured["total"]) == (18, 18)
    assert captured["plan_sha256"] == plan["plan_sha256"]
    command = ["process", f"{desk}/s", "--out", f"{desk}/r", "--method", "iva", "--json"]
    (processed,) = json.loads(lumisplit(*command, "--quiet").stdout)
    assert processed["result"] == f"{desk}/r"
    assert (desk / "r" / "report.html").samefile(processed["report"])
    assert isinstance(json.loads(ran(desk, "camera", "list", "--json")), list)


def test_verbose_says_every_frame(desk: Path) -> None:
    words = ["capture", f"{desk}/plan.toml", "--bench", f"{desk}/bench.toml", "--out", f"{desk}/s"]
    lines = lumisplit(*words, "--verbose").stderr.splitlines()
    said = [line for line in lines if " s, " in line]
    assert len(said) == 18
    assert said[0].startswith("capturing: 1 of 18")
    assert said[0].endswith("white")


def test_bash_completes_commands_and_options() -> None:
    def completed(words: str) -> set[str]:
        environment = os.environ | {
            "_LUMISPLIT_COMPLETE": "complete_bash",
            "COMP_WORDS": words,
            "COMP_CWORD": str(len(words.split()) - (not words.endswith(" "))),
        }
        program = "from acquire.cli.main import app; app(prog_name='lumisplit')"
        done = subprocess.run(
            [sys.executable, "-c", program],
            capture_output=True,
            text=True,
            check=False,
            env=environment,
        )
        return set(done.stdout.split())

    assert {"calibrate", "camera", "capture"} <= completed("lumisplit ca")
    assert completed("lumisplit camera ") == {"list", "shoot", "simulate"}
    assert "--page" in completed("lumisplit capture --pa")


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_other_shells_are_told_the_same(shell: str) -> None:
    """What their completion scripts ask the program for, as they ask it."""

    def told(words: str) -> str:
        environment = os.environ | {
            "_LUMISPLIT_COMPLETE": f"complete_{shell}",
            "_TYPER_COMPLETE_ARGS": words,
            "_TYPER_COMPLETE_FISH_ACTION": "get-args",
        }
        program = "from acquire.cli.main import app; app(prog_name='lumisplit')"
        command = [sys.executable, "-c", program]
        return subprocess.run(
            command, capture_output=True, text=True, check=False, env=environment
        ).stdout

    said = told("lumisplit ca")
    assert all(name in said for name in ("calibrate", "camera", "capture"))
    assert "process" not in said
    assert "--pitches" in told("lumisplit export r --pi")


def test_report_and_evaluate_tell_their_progress(desk: Path) -> None:
    plan = ("capture", "{desk}/plan.toml", "--bench", "{desk}/bench.toml")
    ran(desk, *plan, "--out", "{desk}/s", "--quiet")
    ran(desk, "process", "{desk}/s", "--out", "{desk}/r", "--method", "iva", "--quiet")
    lines = lumisplit("report", f"{desk}/r", "--verbose").stderr.splitlines()
    (total,) = (int(line.split()[2]) for line in lines if line.endswith("to do"))
    assert len([line for line in lines if f" of {total}, " in line]) == total
    assert any("writing page: done in" in line for line in lines)
    truth = ("evaluate", f"{desk}/r", "--truth", f"{desk}/s/truth.npz")
    assert "comparing: 4 of 4, " in lumisplit(*truth, "--verbose").stderr
    assert lumisplit(*truth, "--quiet").stderr == ""
    assert lumisplit("report", f"{desk}/r", "--quiet").stderr == ""


def test_no_colour_where_it_is_not_wanted() -> None:
    environment = os.environ | {"NO_COLOR": "1", "TERM": "xterm-256color"}
    script = f"{sys.executable} -m acquire capture"
    done = subprocess.run(
        ["script", "-qec", script, "/dev/null"],
        capture_output=True,
        text=True,
        check=False,
        env=environment,
    )
    assert "Missing argument" in done.stdout
    assert "\x1b[3" not in done.stdout
