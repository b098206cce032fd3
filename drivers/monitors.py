"""Monitors, and which of them is the projector."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from drivers.errors import ProjectorError


@dataclass(frozen=True, slots=True)
class Monitor:
    """A monitor or projector that is connected and lit.

    Parameters
    ----------
    connector
        Where it is plugged in, as the X server calls it: ``HDMI-1``.
    name
        The name that it gives itself (EDID); the connector where it gives none.
    size_px
        (height, width).
    position_px
        (top, left) of its upper left corner on the desktop.
    refresh_hz
        Pictures a second.
    size_mm
        (height, width); zeros where it does not say, as most projectors do not.
    primary
        The desktop calls it the main monitor: the operator's.
    exact
        One pixel of the desktop is one pixel of the monitor: no scaling, no other transform.
    """

    connector: str
    name: str
    size_px: tuple[int, int]
    position_px: tuple[int, int]
    refresh_hz: float
    size_mm: tuple[int, int]
    primary: bool
    exact: bool

    @property
    def geometry(self) -> str:
        """Size, position and rate: ``1280x800+1920+0 at 60.00 Hz``."""
        (height, width), (top, left) = self.size_px, self.position_px
        return f"{width}x{height}{left:+d}{top:+d} at {self.refresh_hz:.2f} Hz"

    def __str__(self) -> str:
        name = "" if self.name == self.connector else f" ({self.name})"
        return f"{self.connector}{name} {self.geometry}{', primary' if self.primary else ''}"

    def overlaps(self, other: Monitor) -> bool:
        """Whether part of the desktop is on both: they are mirrored."""
        return all(
            start < other_start + other_size and other_start < start + size
            for start, size, other_start, other_size in zip(
                self.position_px, self.size_px, other.position_px, other.size_px, strict=True
            )
        )


def choose_monitor(monitors: Sequence[Monitor], name: str | None) -> Monitor:
    """The monitor to project on.

    Parameters
    ----------
    monitors
        As `drivers.xserver.list_monitors` gives them.
    name
        Connector (``HDMI-1``) or name of the monitor. None: the only one besides the operator's;
        the operator's own is taken only by its name.

    Raises
    ------
    ProjectorError
        It is missing, ambiguous, mirrored or scaled.
    """
    chosen = _only_other(monitors) if name is None else _named(monitors, name)
    twin = next((other for other in monitors if other != chosen and chosen.overlaps(other)), None)
    if twin is not None:
        raise ProjectorError(
            f"{chosen.connector} and {twin.connector} show the same part of the desktop: the "
            "displays are mirrored. Extend the desktop instead: "
            f"`xrandr --output {chosen.connector} --auto --right-of {twin.connector}`, or Join "
            "Displays in the desktop's settings."
        )
    if not chosen.exact:
        raise ProjectorError(
            f"The desktop scales the picture of {chosen.connector}, so its pixels are not the "
            f"projector's. Turn scaling off: `xrandr --output {chosen.connector} --auto "
            "--scale 1x1`, or 100 % in the desktop's display settings."
        )
    return chosen


def _named(monitors: Sequence[Monitor], name: str) -> Monitor:
    wanted = name.casefold()
    found = [m for m in monitors if m.connector.casefold() == wanted] or [
        m for m in monitors if m.name.casefold() == wanted
    ]
    if len(found) == 1:
        return found[0]
    if found:
        connectors = " or ".join(monitor.connector for monitor in found)
        raise ProjectorError(f"Several monitors are called {name!r}: name one as {connectors}.")
    raise ProjectorError(
        f"There is no monitor {name!r}. {_inventory(monitors)} Is the projector plugged in, "
        "switched on, and turned on in the desktop's display settings?"
    )


def _only_other(monitors: Sequence[Monitor]) -> Monitor:
    others = [monitor for monitor in monitors if not monitor.primary]
    if len(monitors) > 1 and len(others) == 1:
        return others[0]
    if len(monitors) > 1:
        raise ProjectorError(f"Which of them is the projector? {_inventory(monitors)} Name it.")
    raise ProjectorError(
        f"There is no second monitor to project on. {_inventory(monitors)} Plug the projector in, "
        "switch it on and extend the desktop to it; `xrandr` lists what the computer sees."
    )


def _inventory(monitors: Sequence[Monitor]) -> str:
    if not monitors:
        return "No monitor is lit."
    return f"Lit {'is' if len(monitors) == 1 else 'are'}: {'; '.join(map(str, monitors))}."
