"""A bench before its devices are opened, and where a capture on it begins."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from pydantic import JsonValue

from acquire.plan import Plan
from acquire.session import FrameRecord
from drivers.protocols import Devices

Truth = Mapping[str, NDArray[np.float64]]


@dataclass(frozen=True, slots=True)
class Resumption:
    """Where a capture goes on.

    Parameters
    ----------
    plan
        The plan that is captured.
    taken
        Every exposure that the session holds already, in order.
    last_file
        Bytes of the last of them; None at the start.
    """

    plan: Plan
    taken: Sequence[FrameRecord] = ()
    last_file: bytes | None = None


Connect = Callable[[Resumption, ExitStack], Devices]


@dataclass(frozen=True, slots=True)
class Bench:
    """A bench that has been found but not opened.

    Parameters
    ----------
    name
        As it is called in messages.
    description
        What a session records of it; the same bench has the same description.
    resolution
        (height, width) of the projector in pixels.
    frame_bytes, frame_s
        Size of one frame on the disk, and its time beside settling and exposure.
    closes_when_complete
        A bench that is held open should be let go when a plan is complete: its lamp goes off then.
    """

    name: str
    description: dict[str, JsonValue]
    resolution: tuple[int, int]
    frame_bytes: int
    frame_s: float
    _connect: Connect
    _truth: Callable[[Plan], Truth] | None = None
    _connect_to_aim: Connect | None = None
    _hold: Callable[[Plan, ExitStack], tuple[Connect, Connect]] | None = None
    closes_when_complete: bool = False

    @contextmanager
    def open(self, resumption: Resumption) -> Iterator[Devices]:
        """Open the devices; on every way out the projector is blanked before all else."""
        with ExitStack() as closing:
            yield self._connect(resumption, closing)

    @contextmanager
    def aim(self, resumption: Resumption) -> Iterator[Devices]:
        """Open the devices for looking and aiming: the lamp stays on afterwards."""
        connect = self._connect_to_aim or self._connect
        with ExitStack() as closing:
            yield connect(resumption, closing)

    @contextmanager
    def held(self, plan: Plan) -> Iterator[Bench]:
        """The bench with its devices open, for turns of aiming and capturing one plan.

        What is opened on it are the same devices every time; between the turns and at the end the
        projector is black. A bench without devices that matter, a computed or recorded one, is
        opened anew each time.
        """
        if self._hold is None:
            yield self
            return
        with ExitStack() as closing:
            capturing, aiming = self._hold(plan, closing)
            yield replace(self, _connect=capturing, _connect_to_aim=aiming, _hold=None)

    def truth(self, plan: Plan) -> Truth | None:
        """The parts of light of a simulated scene, exposed as the plan says."""
        return self._truth(plan) if self._truth else None


def closed_with(devices: Devices, closing: ExitStack) -> Devices:
    """Close the camera, and before it the projector, when `closing` ends."""
    closing.callback(devices.camera.close)
    closing.callback(devices.projector.close)
    return devices
