"""A camera that is only triggered; its files are picked up from a folder that they come into.

For cameras without PTP: the maker's own program, a Wi-Fi card or a card reader puts the files into
the folder, and a `drivers.trigger.TriggerBox` or anything else that can be called releases the
shutter.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from stat import S_ISREG
from typing import TypeAlias

from drivers.errors import CameraError, CameraTimeoutError, DecodeError, SettingsError
from drivers.media import PICTURE_TYPES, media_type
from drivers.protocols import CameraSettings, Clock, RawFrame

POLL_S = 0.05
_TEMPORARY = (".tmp", ".part", ".partial", ".crdownload", ".filepart")

Sizes: TypeAlias = dict[Path, tuple[int, int]]


class FolderCamera:
    """A triggered camera with settings fixed by hand (see `drivers.protocols.Camera`).

    Parameters
    ----------
    trigger
        Releases the shutter once. Its errors pass through.
    folder
        Where the camera's files arrive; what is there already is left alone.
    settings
        What the camera is set to by hand. Nothing can be read back from such a camera: these are
        reported with every frame, and other ones that are asked for are refused.
    arrival_limit_s
        For a file to begin to arrive after the trigger.
    quiet_s
        A file is whole, and the only one, when nothing in the folder changed for so long.
    clock
        The bench's clock.
    """

    def __init__(
        self,
        trigger: Callable[[], None],
        folder: Path,
        settings: CameraSettings,
        arrival_limit_s: float,
        quiet_s: float,
        clock: Clock,
    ) -> None:
        if not folder.is_dir():
            raise CameraError(
                f"There is no folder {folder} to watch for the camera's files. Create it and set "
                "the program that receives them to put them there."
            )
        self._trigger, self._folder, self._settings = trigger, folder, settings
        self._arrival_limit_s, self._quiet_s, self._clock = arrival_limit_s, quiet_s, clock
        self._known: set[Path] | None = None
        self._open = True

    def capture(self, settings: CameraSettings) -> RawFrame:
        """Release the shutter and deliver the one file that comes, or the raw one of a pair."""
        if not self._open:
            raise CameraError("the camera is closed; open it again")
        if settings != self._settings:
            raise SettingsError(
                f"The camera is set by hand to {self._settings}, asked for is {settings}. Set "
                "both the camera and the bench file to what the plan asks for."
            )
        known = self._existing()
        started_s = self._clock.now()
        self._known = None  # whatever ends this capture early may leave a file on its way
        self._trigger()
        arrived = self._arrivals(known)
        data, kind = _frame_file(arrived)
        self._known = known | set(arrived)
        return RawFrame(data, kind, self._settings, started_s, self._clock.now())

    def close(self) -> None:
        """Stop watching."""
        self._open = False

    def _existing(self) -> set[Path]:
        existing = set(self._sizes())
        if self._known is not None and existing - self._known:
            names = ", ".join(sorted(path.name for path in existing - self._known))
            raise CameraError(
                f"{names} came into {self._folder} after the last frame had been picked up. Did "
                "somebody else release the shutter, or does the camera's second file come late? "
                "Set it to raw only, or give its files more time in the bench file, and take the "
                "frame again."
            )
        return existing

    def _arrivals(self, known: set[Path]) -> list[Path]:
        """New files once nothing changes any more."""
        deadline_s = self._clock.monotonic() + self._arrival_limit_s
        changed_s = self._clock.monotonic()
        last: Sizes = {}
        while True:
            new = {path: size for path, size in self._sizes().items() if path not in known}
            if new != last:
                changed_s, last = self._clock.monotonic(), new
            waited_s = self._clock.monotonic() - changed_s
            if any(size for size, _ in new.values()) and waited_s >= self._quiet_s:
                return sorted(new)
            if self._clock.monotonic() >= deadline_s and waited_s >= self._quiet_s:
                raise CameraTimeoutError(
                    f"No file came into {self._folder} within {self._arrival_limit_s:g} s after "
                    "the trigger. Is the camera awake and its autofocus off, is the release cable "
                    "plugged in, and does the program that receives its files run?"
                )
            self._clock.sleep(POLL_S)

    def _sizes(self) -> Sizes:
        sizes: Sizes = {}
        try:
            for path in self._folder.iterdir():
                if path.name.startswith(".") or path.suffix.lower() in _TEMPORARY:
                    continue
                # Between the two calls a file may have been given its final name.
                with suppress(FileNotFoundError):
                    status = path.stat()
                    if S_ISREG(status.st_mode):
                        sizes[path] = status.st_size, status.st_mtime_ns
        except OSError as error:
            raise CameraError(
                f"The folder {self._folder} cannot be read ({error.strerror}). Is its drive still "
                "connected?"
            ) from error
        return sizes


def _frame_file(arrived: list[Path]) -> tuple[bytes, str]:
    """Content and media type of the frame among the files that came."""
    found = []
    for path in arrived:
        try:
            data = path.read_bytes()
            found.append((data, media_type(data)))
        except (OSError, DecodeError) as error:
            raise CameraError(f"{path.name} arrived but is no frame: {error}.") from error
    raws = [entry for entry in found if entry[1] not in PICTURE_TYPES]
    is_pair = len(found) == 2 and len({path.stem.lower() for path in arrived}) == 1
    if len(found) == 1:
        return found[0]
    if is_pair and len(raws) == 1:
        return raws[0]
    names = ", ".join(path.name for path in arrived)
    raise CameraError(
        f"{len(found)} files came for one exposure: {names}. Turn off bracketing, burst and second "
        "formats other than JPEG, and see that nothing else writes into the folder."
    )
