"""The X server as a projector's window sees it: monitors, gamma ramps, the screen saver.

It is spoken to over a connection of its own, apart from the one that draws: what is asked here is
answered also when the graphics driver hangs. libxcb and its binding are loaded on connecting.
"""

from __future__ import annotations

import os
import struct
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TypeAlias

from drivers.errors import ProjectorError
from drivers.monitors import Monitor

Ramp: TypeAlias = tuple[tuple[int, ...], tuple[int, ...], tuple[int, ...]]

LEAVING_S = 2.0  # a killed program's window takes a moment to go
_INTERLACED, _DOUBLE_SCAN = 0x10, 0x20
_QUARTER_TURNS = 2 | 8
_IDENTITY = (65536, 0, 0, 0, 65536, 0, 0, 0, 65536)


class XServer:
    """A connection to the X server that ``DISPLAY`` names.

    Raises
    ------
    ProjectorError
        There is no X server that lets windows cover a monitor exactly.
    """

    def __init__(self) -> None:
        _refuse_wayland()
        try:
            import xcffib  # noqa: PLC0415 - loads libxcb, which only a projector needs
            import xcffib.randr  # noqa: PLC0415
            import xcffib.screensaver  # noqa: PLC0415
            import xcffib.xproto  # noqa: PLC0415
        except (ImportError, OSError) as error:
            raise ProjectorError(
                f"The library that speaks to the X server cannot be loaded ({error}). "
                "Install it with `sudo apt install libxcb1` and `pip install xcffib`."
            ) from error
        self._x: Any = xcffib
        try:
            self._connection: Any = self._x.connect()
        except xcffib.ConnectionException as error:
            raise ProjectorError(
                f"The X server {os.environ['DISPLAY']!r} cannot be reached. Run this in a "
                "terminal of the lab PC's desktop, as the user who is logged in there."
            ) from error
        with self._mapped():
            self._root = self._connection.get_setup().roots[0].root
            if self._core.QueryExtension(len("XWAYLAND"), "XWAYLAND").reply().present:
                raise ProjectorError(_WAYLAND)
            self._randr = self._connection(xcffib.randr.key)
            self._randr.QueryVersion(1, 5).reply()

    @property
    def _core(self) -> Any:
        return self._connection.core

    def close(self) -> None:
        """Disconnect; what was held or suspended for this connection is let go by the server."""
        self._connection.disconnect()

    def fileno(self) -> int:
        """Descriptor that becomes readable when the server has something to tell."""
        return int(self._connection.get_file_descriptor())

    @contextmanager
    def _mapped(self) -> Iterator[None]:
        try:
            yield
        except (self._x.XcffibException, struct.error) as error:
            raise ProjectorError(
                f"The X server does not answer as it should ({type(error).__name__}: {error}). "
                "Did the desktop session end? Log in again and repeat the command."
            ) from error

    def monitors(self, probe: bool) -> tuple[Monitor, ...]:
        """Every monitor that is lit, the primary first, then from left to right.

        Parameters
        ----------
        probe
            Ask the connectors anew, which may take a second, instead of what the server knows.
        """
        with self._mapped():
            ask = self._randr.GetScreenResources if probe else self._randr.GetScreenResourcesCurrent
            resources = ask(self._root).reply()
            primary = self._randr.GetOutputPrimary(self._root).reply().output
            modes = {mode.id: mode for mode in resources.modes}
            found = [
                monitor
                for output in resources.outputs
                if (monitor := self._monitor(output, primary, modes, resources.config_timestamp))
            ]
        return tuple(sorted(found, key=lambda m: (not m.primary, m.position_px[::-1], m.connector)))

    def _monitor(
        self, output: int, primary: int, modes: dict[int, Any], time: int
    ) -> Monitor | None:
        info = self._randr.GetOutputInfo(output, time).reply()
        if info.connection == self._x.randr.Connection.Disconnected or not info.crtc:
            return None
        crtc = self._randr.GetCrtcInfo(info.crtc, time).reply()
        mode = modes.get(crtc.mode)
        if mode is None:
            return None
        connector = bytes(info.name).decode("utf-8", "replace")
        lit = mode.height, mode.width
        transform = self._randr.GetCrtcTransform(info.crtc).reply().current_transform
        matrix = tuple(getattr(transform, f"matrix{i}{j}") for i in "123" for j in "123")
        return Monitor(
            connector=connector,
            name=self._model(output) or connector,
            size_px=(crtc.height, crtc.width),
            position_px=(crtc.y, crtc.x),
            refresh_hz=_refresh_hz(mode),
            size_mm=(info.mm_height, info.mm_width),
            primary=output == primary,
            exact=matrix == _IDENTITY
            and (crtc.height, crtc.width) == (lit[::-1] if crtc.rotation & _QUARTER_TURNS else lit),
        )

    def _model(self, output: int) -> str:
        """The monitor's name in its EDID (VESA E-EDID A2, 3.10.3: descriptor 0xFC)."""
        atom = self._core.InternAtom(0, len("EDID"), "EDID").reply().atom
        reply = self._randr.GetOutputProperty(output, atom, 0, 0, 32, 0, 0).reply()
        edid = bytes(reply.data)
        for start in range(54, min(len(edid), 126), 18):
            block = edid[start : start + 18]
            if block[:4] == b"\0\0\0\xfc":
                return block[5:].split(b"\n")[0].decode("ascii", "replace").strip()
        return ""

    def _crtc(self, connector: str) -> int:
        resources = self._randr.GetScreenResourcesCurrent(self._root).reply()
        for output in resources.outputs:
            info = self._randr.GetOutputInfo(output, resources.config_timestamp).reply()
            if bytes(info.name) == connector.encode():
                return int(info.crtc)
        return 0

    def gamma_ramp(self, connector: str) -> Ramp:
        """Red, green and blue gamma ramps of a monitor, 0 to 65535; empty if it has none."""
        with self._mapped():
            crtc = self._crtc(connector)
            if not crtc:
                return (), (), ()
            reply = self._randr.GetCrtcGamma(crtc).reply()
            return tuple(reply.red), tuple(reply.green), tuple(reply.blue)

    def set_gamma_ramp(self, connector: str, ramp: Ramp) -> None:
        """Set the gamma ramps of a monitor; nothing happens if it is gone or has none."""
        with self._mapped():
            crtc = self._crtc(connector)
            if crtc and ramp[0]:
                self._randr.SetCrtcGamma(crtc, len(ramp[0]), *ramp, is_checked=True).check()

    def stay_awake(self) -> None:
        """Suspend the screen saver and display sleep until this connection ends."""
        with self._mapped():
            name = "MIT-SCREEN-SAVER"
            if self._core.QueryExtension(len(name), name).reply().present:
                saver = self._connection(self._x.screensaver.key)
                saver.Suspend(1, is_checked=True).check()

    def stir(self) -> None:
        """Count as activity, so that the desktop's own idle timers start anew."""
        with self._mapped():
            self._core.ForceScreenSaver(self._x.xproto.ScreenSaver.Reset, is_checked=True).check()

    def exempt(self, window: int) -> None:
        """Take a window that is not yet shown out of the window manager's hands, black at first."""
        with self._mapped():
            mask = self._x.xproto.CW.BackPixel | self._x.xproto.CW.OverrideRedirect
            self._core.ChangeWindowAttributes(window, mask, [0, 1], is_checked=True).check()

    def claim(self, connector: str, window: int) -> None:
        """Have a monitor to oneself as long as `window` exists; refused if another has it."""
        with self._mapped():
            name = f"_LUMISPLIT_{connector}"
            atom = self._core.InternAtom(0, len(name), name).reply().atom
            deadline_s = time.monotonic() + LEAVING_S
            while (taken := self._core.GetSelectionOwner(atom).reply().owner) and (
                time.monotonic() < deadline_s
            ):
                time.sleep(LEAVING_S / 50)
            if taken:
                raise ProjectorError(
                    f"Another lumisplit is showing on {connector}. Wait for it or close it first; "
                    "`pgrep -af lumisplit` finds it."
                )
            self._core.SetSelectionOwner(window, atom, 0, is_checked=True).check()

    def watch(self, window: int) -> None:
        """Have `changed` tell of monitors that change and of windows that cover `window`."""
        with self._mapped():
            notify = self._x.randr.NotifyMask
            mask = notify.ScreenChange | notify.CrtcChange | notify.OutputChange
            self._randr.SelectInput(self._root, mask, is_checked=True).check()
            events = self._x.xproto.EventMask.VisibilityChange
            self._core.ChangeWindowAttributes(
                window, self._x.xproto.CW.EventMask, [events], is_checked=True
            ).check()

    def covered(self, before: bool) -> bool:
        """Whether other windows cover the watched one.

        Parameters
        ----------
        before
            The answer of the last time; the server tells only of changes.
        """
        with self._mapped():
            covered = before
            while (event := self._connection.poll_for_event()) is not None:
                if isinstance(event, self._x.xproto.VisibilityNotifyEvent):
                    covered = event.state != self._x.xproto.Visibility.Unobscured
            return covered

    def lift(self, window: int) -> None:
        """Raise a window over all others."""
        with self._mapped():
            mask, above = self._x.xproto.ConfigWindow.StackMode, self._x.xproto.StackMode.Above
            self._core.ConfigureWindow(window, mask, [above], is_checked=True).check()

    def take_down(self, window: int) -> None:
        """Unmap a window: it is on no screen any more when this returns."""
        with self._mapped():
            self._core.UnmapWindow(window, is_checked=True).check()


def list_monitors() -> tuple[Monitor, ...]:
    """Every monitor that is lit, the primary first, then from left to right.

    Raises
    ------
    ProjectorError
        There is no display, or one on which exact pixels cannot be had.
    """
    server = XServer()
    try:
        return server.monitors(probe=True)
    finally:
        server.close()


def colour_casts() -> dict[str, float]:
    """How far each lit monitor's gamma ramps are from neutral, by connector (see `cast`)."""
    server = XServer()
    try:
        lit = server.monitors(probe=False)
        return {each.connector: cast(server.gamma_ramp(each.connector)) for each in lit}
    finally:
        server.close()


def cast(ramp: Ramp) -> float:
    """Largest difference between the three ramps at one step, as a fraction of full light.

    0 for neutral ones, whatever their curve; a night light's 4000 K take blue down by a third.
    """
    return max((max(step) - min(step) for step in zip(*ramp, strict=True)), default=0) / 65535


def linear(ramp: Ramp) -> Ramp:
    """The linear gamma ramp of the same length."""
    last = max(len(ramp[0]) - 1, 1)
    line = tuple(round(65535 * step / last) for step in range(len(ramp[0])))
    return line, line, line


def _refresh_hz(mode: Any) -> float:
    lines = mode.vtotal * (2 if mode.mode_flags & _DOUBLE_SCAN else 1)
    dots = mode.htotal * lines / (2 if mode.mode_flags & _INTERLACED else 1)
    return float(mode.dot_clock / dots) if dots else 0.0


_WAYLAND = (
    "This is a Wayland session: its compositor may scale pixels and shift colours, and programs "
    "can neither see nor stop that. Log out and choose an Xorg (X11) session at the login screen "
    "(the gear wheel beside the password). Where none is offered: `sudo apt install xserver-xorg "
    "xinit`, change to a text console with Ctrl+Alt+F3, log in and start the same command under "
    "an X server of its own: `xinit $(command -v lumisplit) ARGUMENTS -- :1`."
)


def _refuse_wayland() -> None:
    if os.environ.get("WAYLAND_DISPLAY"):
        raise ProjectorError(_WAYLAND)
    if not os.environ.get("DISPLAY"):
        raise ProjectorError(
            "There is no display: DISPLAY is not set. Run this in a terminal of the lab PC's "
            "desktop; over ssh, as the user who is logged in there, put DISPLAY=:0 before the "
            "command."
        )
