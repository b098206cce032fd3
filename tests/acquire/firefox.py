"""A real Firefox on a page, by WebDriver BiDi (W3C), which it speaks without a driver beside it."""

from __future__ import annotations

import base64
import io
import json
import os
import subprocess
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from websockets.sync.client import ClientConnection, connect

ANNOUNCED = "WebDriver BiDi listening on "
LIMIT_S = 60.0
LIVE = """new Promise((done) => {
  const look = () => {
    const { live } = document.documentElement.dataset;
    if (live) done(live); else setTimeout(look, 20);
  };
  look();
})"""


@dataclass
class FirefoxPage:
    """A page that is open, what it complained of and what it asked for."""

    socket: ClientConnection
    context: str = ""
    sent: int = 0
    complaints: list[str] = field(default_factory=list)
    requested: list[str] = field(default_factory=list)

    def call(self, method: str, **parameters: object) -> Any:
        """Result of a command; what happens meanwhile is noted."""
        self.sent += 1
        message = {"id": self.sent, "method": method, "params": parameters}
        self.socket.send(json.dumps(message))
        while True:
            reply = json.loads(self.socket.recv(timeout=LIMIT_S))
            if reply.get("id") == self.sent:
                if reply["type"] != "success":
                    raise RuntimeError(f"{method}: {reply}")
                return reply["result"]
            self._note(reply)

    def _note(self, event: Any) -> None:
        if event.get("method") == "log.entryAdded":
            self.complaints.append(str(event["params"].get("text")))
        if event.get("method") == "network.beforeRequestSent":
            self.requested.append(event["params"]["request"]["url"])

    def evaluate(self, expression: str) -> Any:
        """A text, number or truth value that a script ends with, or that it promises."""
        target = {"context": self.context}
        result = self.call(
            "script.evaluate", expression=expression, target=target, awaitPromise=True
        )
        if result["type"] != "success":
            raise RuntimeError(str(result["exceptionDetails"]["text"]))
        return result["result"].get("value")

    def photograph(self, width: int, height: int) -> NDArray[np.uint8]:
        """The upper left of what is shown, (height, width, 3)."""
        clip = {"type": "box", "x": 0, "y": 0, "width": width, "height": height}
        result = self.call("browsingContext.captureScreenshot", context=self.context, clip=clip)
        picture = Image.open(io.BytesIO(base64.b64decode(result["data"])))
        return np.asarray(picture.convert("RGB"))


@contextmanager
def opened(
    executable: str, uri: str, profile: Path, environment: Mapping[str, str]
) -> Iterator[FirefoxPage]:
    """Open a report in a Firefox of its own and wait until its scripts have started."""
    profile.mkdir()
    command = (
        *(executable, "--headless", "--no-remote", "--profile", str(profile)),
        *("--remote-debugging-port", "0", "about:blank"),
    )
    said = profile / "said.txt"
    with (
        said.open("w") as file,
        subprocess.Popen(
            command,
            env={**environment, "HOME": str(profile), "MOZ_CRASHREPORTER_DISABLE": "1"},
            stdout=subprocess.DEVNULL,
            stderr=file,
        ) as process,
    ):
        try:
            with connect(f"{_address(process, said)}/session", max_size=None) as socket:
                page = FirefoxPage(socket)
                page.call("session.new", capabilities={})
                tree = page.call("browsingContext.getTree")
                page.context = tree["contexts"][0]["context"]
                events = ["log.entryAdded", "network.beforeRequestSent"]
                page.call("session.subscribe", events=events)
                page.call(
                    "browsingContext.navigate", context=page.context, url=uri, wait="complete"
                )
                page.evaluate(LIVE)
                yield page
                page.call("browser.close")
        finally:
            process.terminate()


def _address(process: subprocess.Popen[bytes], said: Path) -> str:
    deadline_s = time.monotonic() + LIMIT_S
    while time.monotonic() < deadline_s and process.poll() is None:
        for line in said.read_text(errors="replace").splitlines(keepends=True):
            if line.startswith(ANNOUNCED) and line.endswith("\n"):
                return line.removeprefix(ANNOUNCED).strip()
        time.sleep(0.05)
    raise RuntimeError(f"Firefox does not listen:\n{said.read_text(errors='replace')}")


def without_display() -> dict[str, str]:
    """This process's environment on a machine without a screen."""
    return {k: v for k, v in os.environ.items() if k not in {"DISPLAY", "WAYLAND_DISPLAY"}}
