"""A whole session of 16-megapixel raws, processed, against unpacking the same files alone.

    python -m benchmarks.session --pitches 4
    python -m benchmarks.session --pitches 23 --folder DIR      # the paper's, 830 frames, 15 GB

Writes a session as a capture would: losslessly compressed raws of 16 million photosites of a scene
with texture, global light, and shot noise, under the paper's patterns. Then takes turns, each in a
process of its own: rawpy's `unpack` of all frames in as many threads as decode a session, and
`acquire.pipeline.process` from the session to its result. The first use compiles; a small session
is processed before.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import multiprocessing
import shutil
import statistics
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from acquire.frames import DECODERS
from acquire.pipeline import Options, process
from acquire.plan import CameraPlan, Plan
from acquire.session import FrameRecord, Session, SessionRecord
from acquire.session.records import frame_path, host, versions
from benchmarks.raw_decoding import HEIGHT, WIDTH, compressed, unpack
from benchmarks.rendered_captures import papers_patterns
from drivers.protocols import CameraSettings
from drivers.sim.dng import BLACK_LEVEL, MEDIA_TYPE, WHITE_LEVEL, encode_dng
from processing.patterns import Family, Pattern

PROJECTOR_PX = 1080, 1920
FULL_WELL_E = 20_000.0
SETTINGS = CameraSettings(exposure_s=0.1, aperture=8.0, iso=200)
TARGETS = {"iva": 1.25, "ranges": 2.0}
METHODS = tuple(TARGETS)


@dataclass(frozen=True, slots=True)
class Scenery:
    """What the camera sees: places on the projector, direct and global light at each photosite."""

    right_px: NDArray[np.float32]
    down_px: NDArray[np.float32]
    direct: NDArray[np.float32]
    spread: NDArray[np.float32]
    noise: NDArray[np.float32]

    @classmethod
    def of(cls, shape: tuple[int, int]) -> Scenery:
        """A curved wall with texture, for a mosaic of (height, width) photosites."""
        height, width = shape
        down, right = (axis.astype(np.float32) for axis in np.mgrid[:height, :width])
        y, x = down / height, right / width
        bend = 12 * np.sin(3 * y + 2 * x)
        rng = np.random.default_rng(3)
        grain = cv2.resize(
            rng.random((height // 40 + 2, width // 40 + 2), np.float32), (width, height)
        )
        colour = np.ones(shape, np.float32)
        colour[::2, ::2], colour[1::2, 1::2] = 0.8, 0.6
        direct = colour * (0.25 + 0.3 * grain) * (1 + 0.3 * np.sin(40 * x) * np.sin(31 * y))
        return cls(
            right_px=20 + (PROJECTOR_PX[1] - 60) * x + bend,
            down_px=20 + (PROJECTOR_PX[0] - 60) * y + bend,
            direct=direct,
            spread=colour * 0.2 * (1 + x * y),
            noise=rng.standard_normal(shape, np.float32),
        )

    def counts(self, pattern: Pattern, index: int) -> NDArray[np.uint16]:
        """One exposure."""
        raster = pattern.raster(PROJECTOR_PX).astype(np.float32) / 255
        lit = cv2.remap(raster, self.right_px, self.down_px, cv2.INTER_LINEAR)
        light = self.direct * lit + self.spread * np.float32(raster.mean())
        noise = np.roll(self.noise, (37 * index, 101 * index), (0, 1))
        light += noise * np.sqrt(light / FULL_WELL_E + (5 / FULL_WELL_E) ** 2)
        counts = np.rint(BLACK_LEVEL + (WHITE_LEVEL - BLACK_LEVEL) * light)
        return np.asarray(counts.clip(0, WHITE_LEVEL), np.uint16)


def first_pitches(pitches: int) -> tuple[Pattern, ...]:
    """White, black and the first of the paper's pitches."""
    patterns = papers_patterns()
    wanted = sorted({pattern.pitch_px for pattern in patterns})[:pitches]
    references = Pattern(Family.WHITE), Pattern(Family.BLACK)
    return references + tuple(pattern for pattern in patterns if pattern.pitch_px in wanted)


def write_session(folder: Path, pitches: int, shape: tuple[int, int]) -> Session:
    """A complete session in `folder`."""
    plan = Plan(
        camera=CameraPlan(exposure_s=0.1, aperture=8.0, iso=200), patterns=first_pitches(pitches)
    )
    bench = {"kind": "benchmark", "projector_px": list(PROJECTOR_PX)}
    record = SessionRecord(plan_sha256=plan.sha256, bench=bench, versions=versions(), host=host())
    session = Session.create(folder, plan, record)
    scenery = Scenery.of(shape)

    def exposed(step: int) -> bytes:
        return compressed(encode_dng(scenery.counts(plan.patterns[step], step), SETTINGS))

    with ThreadPoolExecutor(2) as threads:
        for step, data in enumerate(threads.map(exposed, range(len(plan)))):
            session.store(_line(step, plan.patterns[step], data), data)
    return session


def _line(step: int, pattern: Pattern, data: bytes) -> FrameRecord:
    return FrameRecord(
        step=step,
        pattern=pattern,
        settings=SETTINGS,
        raster_sha256=None,
        file=frame_path(step, MEDIA_TYPE),
        sha256=hashlib.sha256(data).hexdigest(),
        size_bytes=len(data),
        media_type=MEDIA_TYPE,
        started_s=float(step),
        finished_s=step + 0.1,
    )


@dataclass(slots=True)
class Stages:
    """Observes a run: seconds of each stage."""

    seconds: dict[str, float] = field(default_factory=dict)
    _name: str = "opening"
    _since_s: float = field(default_factory=time.perf_counter)

    def stage(self, name: str, total: int) -> None:  # noqa: ARG002 (an observer's)
        """The stage before has ended."""
        now_s = time.perf_counter()
        self.seconds[self._name] = now_s - self._since_s
        self._name, self._since_s = name, now_s

    def advance(self) -> None:
        """Stages are timed as a whole."""


@dataclass(frozen=True, slots=True)
class Run:
    """One run: seconds in all, of processor time, and by stage; peaks in MB."""

    seconds: float
    processor_s: float
    stages: dict[str, float]
    own_mb: float
    resident_mb: float


def _status_mb() -> tuple[float, float]:
    """Memory of the process's own, and all that is resident, files mapped included."""
    lines = Path("/proc/self/status").read_text().splitlines()
    kilobytes = {line.split(":")[0]: line.split()[1] for line in lines if line.endswith(" kB")}
    return float(kilobytes["RssAnon"]) / 1e3, float(kilobytes["VmRSS"]) / 1e3


@contextlib.contextmanager
def watched() -> Iterator[list[float]]:
    """Peaks of both, sampled every 20 ms while the block runs."""
    peaks, done = [0.0, 0.0], threading.Event()

    def watch() -> None:
        while not done.wait(0.02):
            for k, value in enumerate(_status_mb()):
                peaks[k] = max(peaks[k], value)

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield peaks
    finally:
        done.set()
        watcher.join()


def unpacked(session: str, _scratch: str) -> Run:
    """All files read and unpacked."""
    frames = Session.open(Path(session)).frames
    started_s = time.perf_counter()
    with watched() as peaks, ThreadPoolExecutor(DECODERS) as threads:
        list(threads.map(lambda f: unpack((Path(session) / f.file).read_bytes()), frames))
    return Run(time.perf_counter() - started_s, time.process_time(), {}, *peaks)


def processed(session: str, scratch: str, method: str) -> Run:
    """From the session to its result."""
    stages, folder = Stages(), Path(scratch) / method
    shutil.rmtree(folder, ignore_errors=True)
    started_s = time.perf_counter()
    with watched() as peaks:
        process(Session.open(Path(session)), folder, Options(method=method), stages)
    stages.stage("", 0)
    return Run(time.perf_counter() - started_s, time.process_time(), stages.seconds, *peaks)


def for_iva(session: str, scratch: str) -> Run:
    """The paper's method."""
    return processed(session, scratch, "iva")


def for_ranges(session: str, scratch: str) -> Run:
    """The default method."""
    return processed(session, scratch, "ranges")


def in_child(run: Callable[[str, str], Run], session: Path, scratch: Path) -> Run:
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as child:
        return child.submit(run, str(session), str(scratch)).result()


def compare(session: Path, frames: int, scratch: Path, rounds: int) -> None:
    """Take turns and print every run."""
    runs = {"iva": for_iva, "ranges": for_ranges}
    ratios: dict[str, list[float]] = {method: [] for method in runs}
    for _ in range(rounds):
        alone = in_child(unpacked, session, scratch)
        print(
            f"unpacking {alone.seconds:.1f} s ({alone.processor_s:.1f} s of processor time), "
            f"{1e3 * alone.seconds / frames:.0f} ms a frame"
        )
        for method, run in runs.items():
            found = in_child(run, session, scratch)
            ratios[method].append(found.seconds / alone.seconds)
            stages = ", ".join(f"{name} {s:.1f}" for name, s in found.stages.items())
            print(
                f"{method}: {found.seconds:.1f} s ({stages}), {ratios[method][-1]:.2f} times, "
                f"{found.processor_s / alone.processor_s:.2f} of processor time; "
                f"peak {found.own_mb:.0f} MB of its own, {found.resident_mb:.0f} MB resident",
                flush=True,
            )
    for method, found_ratios in ratios.items():
        print(f"{method}: median {statistics.median(found_ratios):.2f}, target {TARGETS[method]}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pitches", type=int, default=4)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--folder", type=Path, help="where the session is kept for another run")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        kept: Path = options.folder or Path(temporary)
        small, large = Path(temporary) / "small", kept / f"session-{options.pitches}"
        write_session(small, 4, (96, 128))
        for run in (for_iva, for_ranges):
            in_child(run, small, Path(temporary))
        if not Session.exists(large):
            write_session(large, options.pitches, (HEIGHT, WIDTH))
        session = Session.open(large)
        size_mb = sum(frame.size_bytes for frame in session.frames) / 1e6
        print(f"{len(session.frames)} frames of {HEIGHT} x {WIDTH} photosites, {size_mb:.0f} MB")
        compare(large, len(session.frames), kept, options.rounds)


if __name__ == "__main__":
    main()
