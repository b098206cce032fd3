"""What befalls a capture in a soak: each at a random moment, seen from outside the program."""

from __future__ import annotations

import os
import random
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tests.nursery import PATIENCE_S, Child, Nursery
from tests.processes import lines

KILLED, STOPPED, FAILED, DONE = -signal.SIGKILL, 130, 1, 0
MOST_FILES_LOST = 3


@dataclass
class Scene:
    """A capture under way, and the means to disturb it.

    Parameters
    ----------
    nursery, chance
        Where processes come from; the only source of randomness.
    words
        The command.
    disk
        The small file system that holds the session, as the capture sees it.
    every
        At most so many frames are captured before the next fault.
    """

    nursery: Nursery
    chance: random.Random
    words: tuple[str, ...]
    disk: Path
    every: int

    @property
    def session(self) -> Path:
        """The session's folder as we see it."""
        return self.nursery.seen(self.disk) / "s"

    def start(self) -> Child:
        """Start the capture and let it take some frames."""
        wanted = lines(self.session) + self.chance.randint(1, self.every)
        child = self.nursery.start(*self.words)
        deadline_s = time.monotonic() + PATIENCE_S
        while lines(self.session) < wanted and child.poll() is None:
            if time.monotonic() > deadline_s:
                raise TimeoutError(child.output)
            time.sleep(0.002)
        time.sleep(self.chance.uniform(0, 0.02))
        return child

    def killed(self) -> Child:
        """A capture that died in the middle of something."""
        child = self.start()
        child.send_signal(signal.SIGKILL)
        child.finish()
        return child


def kill(scene: Scene) -> Child:
    """The program is killed."""
    return scene.killed()


def torn_line(scene: Scene) -> Child:
    """Power cut: the next line of frames.jsonl is there in part."""
    child = scene.killed()
    if child.returncode != KILLED:
        return child
    with (scene.session / "frames.jsonl").open("ab") as file:
        file.write(
            b'{"step":12345,"pattern":"checker:8:0,0","settings":{"ex'[
                : scene.chance.randint(1, 50)
            ]
        )
    return child


def zeros(scene: Scene) -> Child:
    """Power cut: the files that were appended to end in zeros."""
    child = scene.killed()
    if child.returncode != KILLED:
        return child
    for name in ("frames.jsonl", "proof.jsonl", "log.jsonl"):
        path = scene.session / name
        if path.exists():
            with path.open("ab") as file:
                file.write(bytes(scene.chance.randint(1, 5000)) + b"\n")
    return child


def torn_file(scene: Scene) -> Child:
    """Power cut: a part of the next frame's file, and the whole of one without its line."""
    child = scene.killed()
    if child.returncode != KILLED:
        return child
    number = lines(scene.session)
    frames = scene.session / "frames"
    (frames / f".{number:06d}.dng.part").write_bytes(scene.chance.randbytes(999))
    # Where frames were taken again there are fewer steps than lines: an earlier name is taken.
    steps = {path.stem for path in frames.glob("[0-9]*.dng")}
    following = max((int(stem[:6]) for stem in steps), default=-1) + 1
    (frames / f"{following:06d}.dng").write_bytes(scene.chance.randbytes(999))
    return child


def lying_disk(scene: Scene) -> Child:
    """Power cut, and the disk had not written the last files that it had confirmed."""
    child = scene.killed()
    if child.returncode != KILLED:
        return child
    files = sorted(
        (scene.session / "frames").glob("[0-9]*.dng"), key=lambda path: path.stat().st_mtime_ns
    )
    for path in files[-scene.chance.randint(1, MOST_FILES_LOST) :]:
        match scene.chance.choice(["empty", "zeros", "gone"]):
            case "empty":
                os.truncate(path, 0)
            case "zeros":
                path.write_bytes(bytes(99))
            case _:
                path.unlink()
    return child


def _signalled(number: int) -> Callable[[Scene], Child]:
    def act(scene: Scene) -> Child:
        child = scene.start()
        child.send_signal(number)
        child.finish()
        return child

    return act


def paused(scene: Scene) -> Child:
    """The process is stopped for a while and goes on; then it is asked to end."""
    child = scene.start()
    child.send_signal(signal.SIGSTOP)
    time.sleep(scene.chance.uniform(0.01, 0.5))
    child.send_signal(signal.SIGCONT)
    time.sleep(scene.chance.uniform(0.01, 0.2))
    child.send_signal(signal.SIGTERM)
    child.finish()
    return child


def full_disk(scene: Scene) -> Child:
    """Another program fills the disk, and makes room again."""
    child = scene.start()
    scene.nursery.run("-c", f"cat /dev/zero > {scene.disk}/ballast", program="sh")
    child.finish()
    scene.nursery.run(f"{scene.disk}/ballast", program="rm")
    return child


def read_only(scene: Scene) -> Child:
    """The file system becomes read-only, and writable again."""
    child = scene.start()
    script = f"mount --bind {scene.disk} {scene.disk} && mount -o remount,bind,ro {scene.disk}"
    scene.nursery.run("-c", script, program="sh")
    child.finish()
    scene.nursery.run(str(scene.disk), program="umount")
    return child


def moved(scene: Scene) -> Child:
    """The folder is moved away, and back."""
    child = scene.start()
    away = scene.session.with_name("away")
    scene.session.rename(away)
    child.finish()
    away.rename(scene.session)
    return child


def second(scene: Scene) -> Child:
    """Somebody gives the same command once more meanwhile."""
    child = scene.start()
    child.send_signal(signal.SIGSTOP)
    other = scene.nursery.run(*scene.words)
    child.send_signal(signal.SIGCONT)
    # Unless the first had ended before it could be stopped.
    if "Another lumisplit" not in other.output and child.returncode is None:
        raise AssertionError(f"two captures wrote to one session: {other.output}")
    child.send_signal(signal.SIGTERM)
    child.finish()
    return child


def edited(scene: Scene) -> Child:
    """The plan is edited between two runs: refused, nothing changed."""
    child = scene.start()
    child.send_signal(signal.SIGTERM)
    child.finish()
    plan = Path(scene.words[1])
    text = plan.read_text()
    other = plan.with_name("edited.toml")
    other.write_text(text + "\n[projector]\nsettle_s = 0.123\n")
    words = (scene.words[0], str(other), *scene.words[2:])
    refused = scene.nursery.run(*words)
    if refused.returncode != FAILED or "another plan" not in refused.output:
        raise AssertionError(f"an edited plan was not refused: {refused.output}")
    return child


@dataclass(frozen=True, slots=True)
class Fault:
    """One kind of mischief.

    `ends` are the exit statuses that the capture may have (also 0: it was done before). `loses`
    is whether frames that were confirmed may have to be taken again.
    """

    name: str
    act: Callable[[Scene], Child]
    ends: frozenset[int]
    loses: bool = False
    mounts: bool = False


FAULTS = (
    Fault("killed", kill, frozenset({KILLED})),
    Fault("power cut, torn line", torn_line, frozenset({KILLED})),
    Fault("power cut, zeros at the end of logs", zeros, frozenset({KILLED})),
    Fault("power cut, torn frame file", torn_file, frozenset({KILLED})),
    Fault("power cut, disk lost confirmed files", lying_disk, frozenset({KILLED}), loses=True),
    Fault("Ctrl-C", _signalled(signal.SIGINT), frozenset({STOPPED})),
    Fault("terminated", _signalled(signal.SIGTERM), frozenset({STOPPED})),
    Fault("terminal closed", _signalled(signal.SIGHUP), frozenset({STOPPED})),
    Fault("process stopped and continued", paused, frozenset({STOPPED})),
    Fault("disk full", full_disk, frozenset({FAILED}), mounts=True),
    Fault("disk read-only", read_only, frozenset({FAILED}), mounts=True),
    Fault("folder moved away and back", moved, frozenset({FAILED})),
    Fault("second capture started", second, frozenset({STOPPED})),
    Fault("plan edited in between", edited, frozenset({STOPPED})),
)
