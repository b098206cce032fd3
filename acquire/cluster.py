"""Pitches decoded and separated by the workers of a Dask cluster.

A task is one pitch: the worker opens the session by its path on the shared file system, reads the
pitch's frames, and parks a few images in the result folder. Nothing but paths, names and numbers
goes through the scheduler, and nothing that a session holds is executed. Each attempt parks in a
folder of its own: what a worker that was thought dead still writes reaches no result.
"""

from __future__ import annotations

import uuid
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from acquire.errors import StackError
from acquire.frames import Reading
from acquire.gathering import GatheredPitch, LocalGatherer
from acquire.references import Levels
from acquire.session import Session
from acquire.session.folder import storage
from acquire.stack import Stack
from processing.frames.drift import Drift
from processing.frames.frame_noise import FrameSample
from processing.frames.harmonics import PitchDesign, PitchHarmonics
from processing.frames.separation import Separation
from processing.patterns import Pattern

if TYPE_CHECKING:
    from distributed import Client

PARKED = ".parked"
WAIT_S = 10.0
Image: TypeAlias = NDArray[np.float32]


class Cluster(Protocol):
    """Runs functions elsewhere."""

    def results(
        self, function: Callable[..., str], tasks: Sequence[tuple[object, ...]]
    ) -> Iterator[str]:
        """The value of the function for each task, in order; all are begun at once."""
        ...


class DaskCluster:
    """An existing scheduler and its workers."""

    def __init__(self, client: Client) -> None:
        self._client = client

    def results(
        self, function: Callable[..., str], tasks: Sequence[tuple[object, ...]]
    ) -> Iterator[str]:
        """See `Cluster.results`."""
        from distributed import KilledWorker  # noqa: PLC0415 - an extra

        futures = [self._client.submit(function, *task, pure=False) for task in tasks]
        try:
            for future in futures:
                yield str(future.result())
        except KilledWorker as error:
            raise StackError(
                f"Workers died over and over at one and the same pitch: {error}. Is there memory "
                "enough for a frame times ten on each?"
            ) from error
        finally:
            self._client.cancel(futures)  # type: ignore[no-untyped-call]


@contextmanager
def connected(address: str, wait_s: float = WAIT_S) -> Iterator[DaskCluster]:
    """Connect to a scheduler, such as ``tcp://127.0.0.1:8786``; waits so long for an answer."""
    try:
        from distributed import Client  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise StackError(
            "--scheduler needs Dask: install lumisplit with its extra, `lumisplit[cluster]`, here "
            "and where the workers run."
        ) from error
    scheme, _, rest = address.rpartition("://")
    if scheme not in {"", "tcp", "tls"} or not rest.rpartition(":")[2].isdigit():
        raise StackError(f"{address!r} is no scheduler: give tcp://HOST:PORT.")
    try:
        client = Client(address, timeout=wait_s, set_as_default=False)  # type: ignore[no-untyped-call]
    except (OSError, TimeoutError, ValueError) as error:
        raise StackError(
            f"No scheduler answers at {address}: {error}. `dask scheduler` starts one."
        ) from error
    with client:
        try:
            client.wait_for_workers(1, timeout=wait_s)
        except TimeoutError as error:
            raise StackError(
                f"The scheduler at {address} has no workers. `dask worker {address}` adds one, on "
                "a machine where lumisplit is installed and the session's path is the same."
            ) from error
        yield DaskCluster(client)


@dataclass(frozen=True, slots=True)
class RemoteGatherer:
    """Has the pitches of a session gathered by a cluster.

    Parameters
    ----------
    cluster
        Where.
    session, folder
        Session and result folder, on a file system that the workers share.
    reading
        How raw frames become pixels.
    leak
        As in `acquire.pipeline.Options`.
    with_harmonics
        Whether they are wanted.
    frame_done
        Called for each frame, a pitch's at once.
    """

    cluster: Cluster
    session: Session
    folder: Path
    reading: Reading
    leak: float
    with_harmonics: bool
    frame_done: Callable[[], None]

    def gather(self, stack: Stack, levels: Levels) -> Iterator[GatheredPitch]:
        """See `acquire.gathering.Gatherer.gather`."""
        parked = self.folder.resolve() / PARKED
        with storage(parked):
            parked.mkdir()
            for name, image in (("dark", levels.dark), ("lit", levels.lit)):
                if image is not None:
                    np.save(parked / f"{name}.npy", image)
        place = str(self.session.folder.resolve()), str(parked)
        how = self.reading, self.leak, self.with_harmonics, levels.drift, levels.gains
        tasks = [(*place, k, *how) for k in range(len(stack.groups))]
        done = self.cluster.results(gather_pitch, tasks)
        for group, name in zip(stack.groups, done, strict=True):
            patterns = [frame.pattern for frame in group.frames]
            with storage(parked / name), np.load(parked / name, allow_pickle=False) as file:
                yield self._taken(stack, patterns, dict(file))
            (parked / name).unlink()
            for _ in patterns:
                self.frame_done()

    def _taken(
        self, stack: Stack, patterns: list[Pattern], images: dict[str, Image]
    ) -> GatheredPitch:
        saturated = images["saturated"].astype(np.bool_)
        if stack.saturated is not None and saturated.shape != stack.saturated.shape:
            raise StackError(
                f"{self.session.folder}: frames of {patterns[0].family} {patterns[0].pitch_px} are "
                f"{saturated.shape}, those before {stack.saturated.shape} (height, width)."
            )
        stack.saturated = saturated if stack.saturated is None else stack.saturated | saturated
        harmonics = None
        if self.with_harmonics:
            sums = (images[name] for name in ("harmonics", "total", "null"))
            harmonics = PitchHarmonics.whole(PitchDesign.of(patterns), *sums)
        return GatheredPitch(
            images["total"],
            Separation(images["direct"], images["global_"]),
            FrameSample.whole(patterns, images["sample"]),
            harmonics,
        )


def gather_pitch(
    session: str,
    parked: str,
    index: int,
    reading: Reading,
    leak: float,
    with_harmonics: bool,
    drift: Drift | None,
    gains: dict[int, tuple[float, ...]] | None,
) -> str:
    """Decode and separate one pitch, on a worker.

    Parameters
    ----------
    session, parked
        Folders: the session, and where dark and lit frames lie and the pitch is parked.
    index
        Of the pitch among the stack's groups.
    reading, leak
        As in `RemoteGatherer`.
    with_harmonics
        Whether they are wanted.
    drift, gains
        To be taken off every frame, and what some are divided by; see `acquire.references.Levels`.

    Returns
    -------
    Name of the file in `parked`.
    """
    stack = Stack(Session.open(Path(session)), reading)
    group = stack.groups[index]
    folder = Path(parked)
    dark, lit = (_parked_image(folder / f"{name}.npy") for name in ("dark", "lit"))
    gatherer = LocalGatherer(leak, with_harmonics, lambda: None)
    (found,) = gatherer.gather_groups(stack, [group], Levels(dark, lit, drift, gains))
    images: dict[str, NDArray[np.generic]] = {
        "total": found.total,
        "direct": found.separation.direct_light,
        "global_": found.separation.global_light,
        "sample": found.sample.frames.astype(np.float32),
        "saturated": np.asarray(stack.saturated),
    }
    if found.harmonics is not None:
        images |= {"harmonics": found.harmonics.harmonics, "null": found.harmonics.null}
    name = f"{index:04d}-{uuid.uuid4().hex}.npz"
    with storage(folder / name):
        np.savez(folder / name, allow_pickle=False, **images)
    return name


def _parked_image(path: Path) -> Image | None:
    if not path.exists():
        return None
    image: Image = np.load(path, allow_pickle=False)
    return image
