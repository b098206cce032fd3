"""Whether a session gives the same result, bit for bit, where processors can do less.

    python -m benchmarks.same_bits [--settings all] [--cases ranges iva]

Small simulated sessions are captured and calibrated, then processed in processes of their own:
natively, with one thread, and with each library held to what an x86-64 of 2009 can do (no fused
multiplication, no wide registers). Prints what differs in the results; exits with 1 if anything
does. The first run compiles everything anew for the lesser processor.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import tifffile

# What each library takes for a request to leave out what not every x86-64 has.
NUMBA = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
OPENBLAS = {"OPENBLAS_CORETYPE": "Nehalem"}
NUMPY = {"NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR"}
GLIBC = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX512F"}
OPENCV = {"OPENCV_CPU_DISABLE": "AVX512-SKX,AVX2,FP16,AVX"}
# As many as a larger computer would use; the program asks for one.
THREADS = {"OPENBLAS_NUM_THREADS": "4"}
ONE_THREAD = {"NUMBA_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
SETTINGS: dict[str, dict[str, str]] = {
    "one thread": ONE_THREAD,
    "numba": NUMBA,
    "OpenBLAS": OPENBLAS,
    "numpy": NUMPY,
    "glibc": GLIBC,
    "OpenCV": OPENCV,
    "all": NUMBA | OPENBLAS | NUMPY | GLIBC | OPENCV | ONE_THREAD,
}
BENCH = """kind = "sim"
[sim]
seed = 5
camera_px = [32, 40]
projector_px = [96, 128]
full_well_e = 20000
read_noise_e = 5
blur_px = 0.7
gamma = 2.2
black_level = 0.01
drift = 0.03
"""
CHECKERS = """[pattern]
pitch_px = [4, 6, 8, 12, 16]
shifts = [4, 4]
[references]
every_frames = 40
"""
SINUSOIDS = """[pattern]
family = "sinusoid-columns"
pitch_px = [4, 6, 8, 12]
shifts = [1, 8]
[references]
every_frames = 16
[calibration]
response = "response.json"
"""
PROFILES = ("--profile", "noise.json", "--profile", "board.json")
CASES: dict[str, tuple[str, ...]] = {
    "ranges": ("checkers",),
    "ranges with profiles": ("checkers", *PROFILES),
    "iva": ("checkers", "--method", "iva"),
    "iva with profiles": ("checkers", "--method", "iva", *PROFILES),
    "ranges of sinusoids": ("sinusoids",),
    "iva of sinusoids": ("sinusoids", "--method", "iva"),
}
# Of when and by what a result was made, not what it is.
ABOUT = re.compile(r"versions|created|seconds|sha256|files|host")


def run(folder: Path, *words: str, settings: Mapping[str, str] | None = None) -> None:
    """Run `lumisplit` in a folder, in a process of its own."""
    done = subprocess.run(  # noqa: S603 - this program with words of this module
        [sys.executable, "-m", "acquire", *words, "--quiet"],
        cwd=folder,
        env={**os.environ, **(settings or {})},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(f"{' '.join(words)}: {done.stderr[-2000:]}")


def differences(ours: Path, theirs: Path) -> Iterator[str]:
    """What differs between two results, in words: pictures, then numbers of the record."""
    names = {path.relative_to(ours) for path in ours.rglob("*.tiff")}
    for name in sorted(names | {path.relative_to(theirs) for path in theirs.rglob("*.tiff")}):
        if not ((ours / name).exists() and (theirs / name).exists()):
            yield f"{name}: one result has it, the other has not"
        elif (ours / name).read_bytes() != (theirs / name).read_bytes():
            one, other = tifffile.imread(ours / name), tifffile.imread(theirs / name)
            count = np.count_nonzero(~np.isclose(one, other, 0, 0, equal_nan=True))
            most = np.nanmax(np.abs(one.astype(float) - other))
            yield f"{name}: {count} of {one.size} values, by up to {most:.1e}"
    first, second = (_numbers(folder) for folder in (ours, theirs))
    for key in sorted(first.keys() | second.keys()):
        if first.get(key) != second.get(key) and not ABOUT.search(key):
            yield f"result.json{key}: {first.get(key)} and {second.get(key)}"


def _numbers(folder: Path) -> dict[str, object]:
    return dict(_flat(json.loads((folder / "result.json").read_text())))


def _flat(values: Any, name: str = "") -> Iterator[tuple[str, object]]:
    if isinstance(values, dict):
        for key, value in values.items():
            yield from _flat(value, f"{name}.{key}")
    elif isinstance(values, list):
        for number, value in enumerate(values):
            yield from _flat(value, f"{name}[{number}]")
    else:
        yield name, values


def make_sessions(room: Path) -> None:
    """The sessions and profiles that the cases name."""
    (room / "bench.toml").write_text(BENCH)
    (room / "checkers.toml").write_text(CHECKERS)
    (room / "sinusoids.toml").write_text(SINUSOIDS)
    for kind in ("response", "noise", "board"):
        run(room, "calibrate", kind, "--bench", "bench.toml", "--out", f"{kind}.json")
    for name in ("checkers", "sinusoids"):
        run(room, "capture", f"{name}.toml", "--bench", "bench.toml", "--out", name)


def main() -> int:
    """Process, compare, print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--settings", nargs="+", choices=SETTINGS, default=list(SETTINGS))
    parser.add_argument("--cases", nargs="+", choices=CASES, default=list(CASES))
    given = parser.parse_args()
    odd = 0
    with tempfile.TemporaryDirectory() as folder:
        room = Path(folder)
        make_sessions(room)
        for case in given.cases:
            run(room, "process", *CASES[case], "--out", "native", settings=THREADS)
            for name in given.settings:
                run(room, "process", *CASES[case], "--out", "other", settings=SETTINGS[name])
                found = list(differences(room / "native", room / "other"))
                odd += bool(found)
                print(f"{case:<22}{name:<12}{'differs' if found else 'same bits'}", flush=True)
                for line in found[:20]:
                    print(f"    {line}", flush=True)
    return 1 if odd else 0


if __name__ == "__main__":
    sys.exit(main())
