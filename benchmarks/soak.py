"""Random faults over a long capture; what comes out must be what an undisturbed one gives.

    python -m benchmarks.soak [--frames 3000] [--seed 1] [--every 25]

Sessions of a simulated bench whose projector and camera fail too (late, dropped, swapped and torn
frames, time-outs) are captured by `lumisplit capture`, disturbed every few dozen frames, verified
after each fault and gone on with. In the end each is verified, packed, unpacked and processed, and
compared bit for bit with one that nothing disturbed. Every choice comes from the seed; the moment
that a fault hits does not repeat. Prints a
table; exits with 1 if anything differed.

The processes are forked from one that has imported everything. Full and read-only disks need
Linux's user namespaces and are left out without.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import random
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from acquire.proof import read_proofs
from benchmarks.mischief import DONE, FAULTS, Fault, Scene
from tests.nursery import Child, Nursery, can_mount
from tests.processes import lines

PITCHES = tuple(range(8, 100, 4))
SHIFTS = 36
MOST_FRAMES = 830
BENCH = """kind = "sim"
[sim]
seed = {seed}
camera_px = [16, 20]
projector_px = [96, 128]
full_well_e = 20000
read_noise_e = 5
late = 0.01
dropped = 0.01
swapped = 0.01
torn = 0.01
timeouts = 0.01
"""
DISK_BYTES = 256 << 20
PROCESSING_LIMIT_S = 1800
UNSTEADY = {"session.json", "log.jsonl", "proof.jsonl", ".lock"}


@dataclass
class Tally:
    """What was done and what became of it."""

    injected: Counter[str] = field(default_factory=Counter)
    survived: Counter[str] = field(default_factory=Counter)
    lost: Counter[str] = field(default_factory=Counter)
    late: int = 0
    failures: list[str] = field(default_factory=list)
    frames: int = 0
    exposures: int = 0
    starts: int = 0

    def print(self) -> None:
        """The table."""
        print(f"\n{'fault':<40}{'injected':>9}{'survived':>9}{'frames lost':>12}")
        for fault in FAULTS:
            name = fault.name
            print(
                f"{name:<40}{self.injected[name]:>9}{self.survived[name]:>9}{self.lost[name]:>12}"
            )
        total, well = self.injected.total(), self.survived.total()
        print(f"{'all':<40}{total:>9}{well:>9}{self.lost.total():>12}")
        print(
            f"\n{self.frames} frames ({self.exposures} exposures) in {self.starts} runs; "
            f"{self.late} faults came after the last frame and do not count"
        )
        sys.stdout.flush()
        for failure in self.failures:
            print(f"FAILED: {failure}", flush=True)


def content(folder: Path, leave: frozenset[str] | set[str] = frozenset()) -> dict[str, str]:
    """Digest of every file in a folder."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name not in leave
    }


def disturb(scene: Scene, fault: Fault, tally: Tally) -> None:
    """One fault, and whether the session is what it should be after it."""
    before = lines(scene.session)
    child = fault.act(scene)
    tally.starts += 1
    if child.returncode == DONE:
        tally.late += 1
        return
    tally.injected[fault.name] += 1
    complaint = _complaint(scene, fault, child, before)
    if complaint:
        tally.failures.append(f"{fault.name}: {complaint}")
        return
    tally.survived[fault.name] += 1
    tally.lost[fault.name] += _missing(scene)


def _complaint(scene: Scene, fault: Fault, child: Child, before: int) -> str:
    if child.returncode not in fault.ends:
        return f"exit status {child.returncode}: {child.output}"
    if "Traceback" in child.output:
        return child.output
    if lines(scene.session) < before:
        return f"{before} lines before, {lines(scene.session)} after"
    verified = scene.nursery.run("verify", str(scene.disk / "s"), "--json")
    report = json.loads(verified.output[verified.output.index("{") :])
    if not report["runs"]:
        return "verify does not say what happened"
    if report["problems"] and not fault.loses:
        return f"verify: {report['problems']}"
    return ""


def _missing(scene: Scene) -> int:
    """Frames that the disk had confirmed and does not hold."""
    count = 0
    for line in (scene.session / "frames.jsonl").read_bytes().split(b"\n")[:-1]:
        if not line.startswith(b"\0"):
            record = json.loads(line)
            path = scene.session / record["file"]
            count += not path.exists() or path.stat().st_size != record["size_bytes"]
    return count


def compare(scene: Scene, undisturbed: Path, tally: Tally, *, processing: bool) -> None:
    """Verify, pack, unpack, process; every bit against the undisturbed capture."""
    disk = scene.disk
    steps = [
        ("verify", str(disk / "s")),
        ("pack", str(disk / "s"), "--out", str(disk / "s.zip")),
        ("verify", str(disk / "s.zip")),
        ("unpack", str(disk / "s.zip"), "--out", str(disk / "un")),
    ]
    if processing:
        steps += [
            ("process", str(disk / "un" / "session"), "--out", str(disk / "result")),
            ("process", str(undisturbed), "--out", str(disk / "expected")),
        ]
    for words in steps:
        # Afresh: threads that compute do not survive a fork.
        child = scene.nursery.run(
            "-m", "acquire", *words, program=sys.executable, patience_s=PROCESSING_LIMIT_S
        )
        if child.returncode != 0:
            tally.failures.append(f"{' '.join(words)}: {child.output}")
            return
    seen = scene.nursery.seen
    session = seen(disk / "un" / "session")
    ours, theirs = content(session, UNSTEADY), content(undisturbed, UNSTEADY)
    odd = sorted(name for name in ours.keys() | theirs.keys() if ours.get(name) != theirs.get(name))
    if odd:
        tally.failures.append(f"the session differs from the undisturbed one: {odd}")
    # Frames that had to be taken again were judged twice: the last judgement counts.
    judged, expected = read_proofs(session), read_proofs(undisturbed)
    if judged != expected:
        exposures = sorted(judged.keys() | expected.keys())
        first = next(key for key in exposures if judged.get(key) != expected.get(key))
        tally.failures.append(
            f"step and attempt {first}: {judged.get(first)} instead of {expected.get(first)}"
        )
    if not processing:
        return
    results = [
        {name: digest for name, digest in content(seen(disk / which)).items() if "tiff" in name}
        for which in ("result", "expected")
    ]
    if results[0] != results[1] or not results[0]:
        tally.failures.append("the results differ from those of the undisturbed session")


def soak(folder: Path, frames: int, seed: int, every: int, *, processing: bool = True) -> Tally:
    """Capture at least so many frames in sessions of up to 830, disturbed at most `every` frames.

    Without `processing` the sessions are compared, but not what is made of them.
    """
    tally, chance = Tally(), random.Random(seed)  # noqa: S311 - chance, not secrecy
    faults = [fault for fault in FAULTS if can_mount() or not fault.mounts]
    while tally.frames < frames:
        room = folder / f"{seed}-{tally.frames}"
        room.mkdir()
        wanted = min(MOST_FRAMES, frames - tally.frames)
        pitches = sorted(chance.sample(PITCHES, max(1, min(len(PITCHES), round(wanted / SHIFTS)))))
        (room / "plan.toml").write_text(f"[pattern]\npitch_px = {pitches}\n")
        (room / "bench.toml").write_text(BENCH.format(seed=chance.randrange(2**31)))
        words = ("capture", str(room / "plan.toml"), "--bench", str(room / "bench.toml"), "--out")
        undisturbed, disk = room / "undisturbed", room / "disk"
        disk.mkdir()
        nursery = Nursery(room, *words, str(undisturbed), can_mount=can_mount())
        try:
            if can_mount():
                size = f"size={DISK_BYTES}"
                nursery.run("-t", "tmpfs", "-o", size, "tmpfs", str(disk), program="mount")
            scene = Scene(nursery, chance, (*words, str(disk / "s")), disk, every)
            _one_session(scene, undisturbed, faults, tally)
            if not tally.failures:
                compare(scene, undisturbed, tally, processing=processing)
        finally:
            nursery.close()
        tally.print()
        if tally.failures:
            break
    return tally


def _one_session(scene: Scene, undisturbed: Path, faults: list[Fault], tally: Tally) -> None:
    scene.nursery.run("--version")  # the parent has captured the undisturbed session by then
    whole = lines(undisturbed)
    while lines(scene.session) < whole and not tally.failures:
        # Rarely, a fault that is due comes too late; the kinds come equally often.
        least = min(tally.injected[fault.name] for fault in faults)
        due = [fault for fault in faults if tally.injected[fault.name] <= least + 1]
        disturb(scene, scene.chance.choice(due), tally)
    last = scene.nursery.run(*scene.words)
    tally.starts += 1
    if last.returncode != DONE:
        tally.failures.append(f"the last run: {last.output}")
    tally.exposures += lines(scene.session)
    tally.frames += len(json.loads((undisturbed / "plan.json").read_text())["patterns"])


def main() -> int:
    """Run, print, judge."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--frames", type=int, default=3000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--every", type=int, default=25, help="frames between faults, at most")
    given = parser.parse_args()
    started_s = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        tally = soak(Path(folder), given.frames, given.seed, given.every)
    print(f"{time.monotonic() - started_s:.0f} s")
    return 1 if tally.failures else 0


if __name__ == "__main__":
    sys.exit(main())
