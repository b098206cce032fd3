"""A GLFW window that covers one monitor and shows rasters on it, pixel for pixel.

The window is not GLFW's full-screen one: when that one's monitor is unplugged, GLFW itself moves
it into the corner of the desktop, on the operator's screen. This window is taken out of the
window manager's hands instead, so that nothing moves, covers, decorates or minimises it.

Imported by `drivers.window_process` only; that process has a display.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import glfw
import moderngl

from drivers.errors import ProjectorError
from drivers.monitors import Monitor
from drivers.xserver import XServer

_DITHER = 0x0BD0
_VERTEX = """
#version 330 core
void main() {
    vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1);
    gl_Position = vec4(4.0 * corner - 1.0, 0.0, 1.0);
}
"""
# texelFetch takes the very pixel: no filter, no interpolated coordinate that could round wrongly.
_FRAGMENT = """
#version 330 core
uniform sampler2D raster;
out vec4 light;
void main() {
    ivec2 place = ivec2(gl_FragCoord.xy);
    int top = textureSize(raster, 0).y - 1;
    light = vec4(texelFetch(raster, ivec2(place.x, top - place.y), 0).rgb, 1.0);
}
"""
_HINTS = {
    glfw.VISIBLE: False,
    glfw.DECORATED: False,
    glfw.RESIZABLE: False,
    glfw.FOCUSED: False,
    glfw.FOCUS_ON_SHOW: False,
    glfw.SCALE_TO_MONITOR: False,
    glfw.SRGB_CAPABLE: False,
    glfw.SAMPLES: 0,
    glfw.RED_BITS: 8,
    glfw.GREEN_BITS: 8,
    glfw.BLUE_BITS: 8,
    glfw.ALPHA_BITS: 0,
    glfw.DEPTH_BITS: 0,
    glfw.STENCIL_BITS: 0,
    glfw.CONTEXT_VERSION_MAJOR: 3,
    glfw.CONTEXT_VERSION_MINOR: 3,
    glfw.OPENGL_PROFILE: glfw.OPENGL_CORE_PROFILE,
    glfw.OPENGL_FORWARD_COMPAT: True,
}


class Canvas:
    """Open black on a monitor (see the module).

    Parameters
    ----------
    monitor
        The monitor to cover.
    server
        Connection over which the window is freed from the window manager.
    """

    def __init__(self, monitor: Monitor, server: XServer) -> None:
        self._monitor = monitor
        glfw.ERROR_REPORTING = "raise"
        with _mapped():
            glfw.init_hint(glfw.PLATFORM, glfw.PLATFORM_X11)
            glfw.init()
            height, width = monitor.size_px
            for hint, value in _HINTS.items():
                glfw.window_hint(hint, value)
            self._window: Any = glfw.create_window(width, height, "lumisplit", None, None)
            self.handle = int(glfw.get_x11_window(self._window))
            server.claim(monitor.connector, self.handle)
            server.exempt(self.handle)
            server.watch(self.handle)
            top, left = monitor.position_px
            glfw.set_window_pos(self._window, left, top)
            glfw.set_input_mode(self._window, glfw.CURSOR, glfw.CURSOR_HIDDEN)
            glfw.set_window_refresh_callback(self._window, lambda _: self._present())
            glfw.make_context_current(self._window)
            self._prepare(width, height)
            self.black()
            glfw.show_window(self._window)
            server.lift(self.handle)
            # Some drivers tie the interval to the monitor that the window was on when it was set.
            glfw.swap_interval(1)
        self.black()

    def _prepare(self, width: int, height: int) -> None:
        self._gl = moderngl.create_context(require=330)
        self._gl.disable_direct(_DITHER)
        self._gl.disable(moderngl.BLEND | moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        self._textures = {
            channels: self._gl.texture((width, height), channels, alignment=1)
            for channels in (1, 3)
        }
        self._textures[1].swizzle = "RRR1"
        program = self._gl.program(vertex_shader=_VERTEX, fragment_shader=_FRAGMENT)
        self._triangle = self._gl.vertex_array(program, [])
        self._lit: moderngl.Texture | None = None

    def show(self, data: bytes, channels: int) -> None:
        """Show a raster and return when it is on the screen.

        Parameters
        ----------
        data
            height x width x channels bytes, row 0 on top.
        channels
            1 (grey) or 3.
        """
        with _mapped():
            self._lit = self._textures[channels]
            self._lit.write(data)
            self._present()

    def black(self) -> None:
        """Show black."""
        with _mapped():
            self._lit = None
            self._present()

    def _present(self) -> None:
        """Draw twice: the second swap waits for the first, and no buffer keeps older light."""
        height, width = self._monitor.size_px
        for _ in range(2):
            self._gl.screen.use()
            self._gl.viewport = (0, 0, width, height)
            self._gl.clear(0.0, 0.0, 0.0, 1.0)
            if self._lit is not None:
                self._lit.use(0)
                self._triangle.render(moderngl.TRIANGLES, vertices=3)
            glfw.swap_buffers(self._window)
            self._gl.finish()
        self._check_place()  # also the round trip after which the server has drawn it

    def _check_place(self) -> None:
        left, top = glfw.get_window_pos(self._window)
        width, height = glfw.get_framebuffer_size(self._window)
        if (top, left) != self._monitor.position_px or (height, width) != self._monitor.size_px:
            raise ProjectorError(
                f"The window lies at {width}x{height}{left:+d}{top:+d}, not on the projector at "
                f"{self._monitor.geometry}: the desktop moved it. Turn off tiling or window "
                "rules, or use a plain X session."
            )

    def wait(self, limit_s: float) -> None:
        """Handle window events until `wake` or for `limit_s` seconds."""
        with _mapped():
            glfw.wait_events_timeout(limit_s)

    @staticmethod
    def wake() -> None:
        """End a `wait`; may be called from any thread."""
        glfw.post_empty_event()

    @staticmethod
    def close() -> None:
        """Destroy the window."""
        glfw.terminate()


@contextmanager
def _mapped() -> Iterator[None]:
    try:
        yield
    except ProjectorError:
        raise
    # moderngl raises bare Exception, or its own Error which derives from it.
    except Exception as error:
        raise ProjectorError(
            f"The window cannot be drawn ({error}). It needs OpenGL 3.3: install the graphics "
            "card's driver, or `sudo apt install libgl1 libgl1-mesa-dri` for Mesa's, and check "
            "with `glxinfo -B`."
        ) from error
