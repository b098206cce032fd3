"""Random misbehaviour of a network camera over a long capture; no frame may be lost or wrong.

    python -m benchmarks.soak_network [--frames 830] [--seed 1] [--every 10]

The camera is the simulated one behind a real TCP port, driven by the program's own driver. Its
misbehaviours, all kinds in turn at random places, come from the seed. When it pulls its cable it
comes back after a while at another port. A run that ends is begun again, as a person would. In
the end the session is verified and every frame compared with what the scene gives for its pattern.
Prints a table; exits with 1 if anything is wrong.
"""

from __future__ import annotations

import argparse
import random
import re
import sys
import tempfile
import threading
from collections import Counter
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from pydantic import JsonValue

from acquire.plan import Plan
from acquire.plan_file import parse_plan
from acquire.recording import record
from acquire.rig import Bench, Resumption
from acquire.rig.bench import closed_with
from acquire.sequencer import Outcome
from acquire.session import Session
from acquire.session.verification import problems
from drivers.clock import SystemClock
from drivers.errors import DriverError
from drivers.protocols import CameraSettings, Devices
from drivers.ptp.discovery import open_camera
from drivers.sim.devices import SimulatedBench, SimulatedProjector, SimulationConfig, build
from drivers.sim.ptp_responder.misbehaviour import Misbehaviour, Name
from drivers.sim.ptp_responder.responder import Responder
from drivers.sim.ptp_responder.server import PtpIpServer
from tests.acquire.captures import Notes
from tests.raws import counts

PITCHES_PX = tuple(range(4, 97, 4))
RESOLUTION = (96, 128)
KINDS = (*(name for name in Name if name is not Name.UNPLUG), Name.UNPLUG)
MOST_RUNS = 200


def plan_of(n_frames: int) -> Plan:
    """As many pitches of 36 checkers as come nearest."""
    pitches = PITCHES_PX[: max(1, round(n_frames / 36))]
    text = f"[pattern]\npitch_px = {list(pitches)}\nshifts = [6, 6]\n[camera]\nexposure_s = 0.005\n"
    return parse_plan(text, "the soak's plan")


class NetworkCamera:
    """A camera that misbehaves by a script of chance, and comes back when its cable was pulled.

    A stretch holds every kind once, in a random order, and ends with the pulled cable.
    """

    def __init__(self, scene: SimulatedBench, chance: random.Random, every: int) -> None:
        self._scene, self._chance, self._every = scene, chance, every
        self._server: PtpIpServer | None = None
        self._responder: Responder | None = None
        self._script: list[Misbehaviour] = []
        self.happened: Counter[str] = Counter()
        self.put_back = 0

    def plug_in(self, port: int = 0) -> int:
        """Start anew; return the port."""
        kinds = [*KINDS[:-1]]
        self._chance.shuffle(kinds)
        places = [self._chance.randint(1, 2 * self._every) for _ in range(len(kinds) + 1)]
        script = [
            Misbehaviour(kind, skip=int(place))
            for kind, place in zip([*kinds, Name.UNPLUG], np.cumsum(places), strict=True)
        ]
        self._responder = Responder(self._exposed, misbehaviours=script)
        self._script = script
        self._server = PtpIpServer(self._responder, port=port)
        self._server.__enter__()
        return self._server.address[1]

    def pull_out(self) -> None:
        """Stop, and count what happened."""
        if self._server is None or self._responder is None:
            return
        self._server.__exit__(None, None, None)
        left = Counter(str(each.name) for each in self._responder.untaken)
        self.happened += Counter(str(each.name) for each in self._script) - left
        self._server = None

    def mind(self, port: int, over: threading.Event) -> None:
        """While a run goes on: put a pulled cable back at once, or let the run end without."""
        while not over.wait(0.05):
            if self._server is None or self._server.is_plugged_in:
                continue
            if self._chance.random() < 0.5:
                return
            self.pull_out()
            self.plug_in(port)
            self.put_back += 1

    def _exposed(self, settings: CameraSettings) -> tuple[bytes, str]:
        frame = self._scene.camera.capture(settings)
        return frame.data, frame.media_type


def run(folder: Path, plan: Plan, scene: SimulatedBench, camera: NetworkCamera) -> str:
    """One start of the capture, the camera at a new port; why it ended, empty when complete."""
    port = camera.plug_in()
    over = threading.Event()

    def connect(_: Resumption, closing: ExitStack) -> Devices:
        clock = SystemClock()
        ptp = open_camera(f"ptpip:127.0.0.1:{port}", clock)
        projector = SimulatedProjector(scene.stage, 0.0)
        return closed_with(Devices(projector, ptp, clock, (), ptp.body), closing)

    lab: dict[str, JsonValue] = {"kind": "lab", "camera": f"ptpip:127.0.0.1:{port}"}
    bench = Bench("the network camera", lab, RESOLUTION, 3000, 0.0, connect)
    minder = threading.Thread(target=camera.mind, args=(port, over))
    minder.start()
    try:
        _, outcome = record(plan, bench, folder, Notes(), threading.Event())
    except DriverError as error:
        return str(error)
    finally:
        over.set()
        minder.join()
        camera.pull_out()
    return "" if outcome is Outcome.COMPLETE else str(outcome)


def wrong_frames(session: Session, scene: SimulatedBench) -> list[int]:
    """Steps whose photosites are not those that the scene gives for their pattern."""
    found = []
    for number, frame in enumerate(session.frames):
        step = session.plan.step(number)
        scene.projector.show(session.plan.projector.raster(step.pattern, RESOLUTION))
        expected = scene.camera.capture(step.settings).data
        if counts(session.read(frame)) != counts(expected):
            found.append(number)
    return found


def main() -> None:
    """Soak and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=830)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--every", type=int, default=10, help="frames from one to the next, mean")
    options = parser.parse_args()
    scene = build(SimulationConfig("board", camera_px=(16, 20), projector_px=RESOLUTION))
    plan = plan_of(options.frames)
    chance = random.Random(options.seed)  # noqa: S311 - no secrets here
    camera = NetworkCamera(scene, chance, options.every)
    ends: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "s"
        while len(ends) < MOST_RUNS and (why := run(path, plan, scene, camera)):
            ends.append(re.sub(r":\d+", "", why))
        session = Session.open(path)
        wrong = wrong_frames(session, scene)
        complaints = [problem for problem in problems(session) if problem]
    for name in KINDS:
        print(f"{name:<20}{camera.happened[str(name)]:>6}")
    print(
        f"{'all':<20}{camera.happened.total():>6}\n\n{len(session.frames)} of {len(plan)} frames, "
        f"{len(session.lines)} exposures kept, {len(ends) + 1} runs, {camera.put_back} cables put "
        f"back in time"
    )
    for why, times in Counter(ends).items():
        print(f"{times} runs ended: {why}")
    print(f"wrong frames: {wrong or 'none'}; verify: {complaints or 'sound'}")
    if wrong or complaints or not session.complete:
        sys.exit(1)


if __name__ == "__main__":
    main()
