"""Frames a minute of a capture with the page open and three viewers, against without a page.

Both kinds of run are taken in turn on the simulated bench at its real pace. Viewers are clients in
a process of their own that take every picture as fast as it comes, without drawing it. The pace is
that of the files of the session, from the first to the last: starting up does not count.

    python -m benchmarks.page_pace [PAIRS]
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import tempfile
import threading
from pathlib import Path
from urllib.parse import urlsplit

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.typing import Origin

from benchmarks.paged import HOME, start

VIEWERS = 3
PLAN = "[pattern]\npitch_px = [8, 16]\n"


def look(address: str, seen: list[int]) -> None:
    """Be one viewer until the page ends."""
    parts = urlsplit(address)
    origin = Origin(f"http://{parts.netloc}")
    socket = f"ws://{parts.netloc}{parts.path}socket"
    try:
        with connect(socket, origin=origin, max_size=None, proxy=None) as viewer:
            while True:
                message = viewer.recv()
                if isinstance(message, bytes) and len(message) > 10_000:
                    seen.append(len(message))
                    viewer.send(json.dumps({"do": "ready"}))
    except ConnectionClosed:
        return


def run(folder: Path, *, page: bool) -> tuple[float, int]:
    """Frames a minute of one capture, and how many pictures its viewers got."""
    options = ["--page"] if page else []
    process, address = start(folder, PLAN, "capture", *options, has_page=page)
    pictures = 0
    if page:
        viewers = subprocess.run(  # noqa: S603 - this module
            [sys.executable, "-m", "benchmarks.page_pace", "--look", address],
            cwd=HOME,
            capture_output=True,
            text=True,
            check=True,
        )
        pictures = int(viewers.stdout)
    process.communicate()
    assert process.returncode == 0
    times = sorted(path.stat().st_mtime_ns for path in (folder / "s" / "frames").iterdir())
    return 60e9 * (len(times) - 1) / (times[-1] - times[0]), pictures


def main(pairs: int) -> None:
    """Print every pair and the median of their ratios."""
    ratios = []
    for pair in range(pairs):
        paces = {}
        for page in (False, True) if pair % 2 else (True, False):
            with tempfile.TemporaryDirectory() as name:
                paces[page], pictures = run(Path(name), page=page)
                if page:
                    seen = pictures
        ratios.append(paces[True] / paces[False])
        print(
            f"pair {pair + 1}: without {paces[False]:.2f}, with {paces[True]:.2f} frames a minute, "
            f"ratio {ratios[-1]:.4f}; {seen} pictures looked at",
            flush=True,
        )
    print(f"median ratio {statistics.median(ratios):.4f} of {pairs} pairs")


def watch(address: str) -> None:
    """Be all viewers; print how many pictures they got."""
    seen: list[int] = []
    threads = [threading.Thread(target=look, args=(address, seen)) for _ in range(VIEWERS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    print(len(seen))


if __name__ == "__main__":
    if sys.argv[1:2] == ["--look"]:
        watch(sys.argv[2])
    else:
        main(int(sys.argv[1]) if len(sys.argv) > 1 else 5)
