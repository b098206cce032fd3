"""A real browser on a page, listening for complaints and requests."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

from playwright.sync_api import Page, Playwright

ARGUMENTS = (
    "--headless",
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
# WebGL2 computed by the processor, the same on every machine.
SOFTWARE_GRAPHICS = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
NO_GRAPHICS = ("--disable-gpu", "--disable-3d-apis")


@dataclass
class Visit:
    """A page that is open, what it complained of and what it asked for."""

    page: Page
    complaints: list[str] = field(default_factory=list)
    requested: list[str] = field(default_factory=list)


@contextmanager
def opened(
    playwright: Playwright,
    executable: str,
    uri: str,
    graphics: Sequence[str] = SOFTWARE_GRAPHICS,
) -> Iterator[Visit]:
    """Open a report and wait until its scripts have started."""
    browser = playwright.chromium.launch(executable_path=executable, args=[*ARGUMENTS, *graphics])
    try:
        visit = Visit(browser.new_page(viewport={"width": 1280, "height": 800}))
        visit.page.on("console", lambda message: visit.complaints.append(message.text))
        visit.page.on("pageerror", lambda error: visit.complaints.append(str(error)))
        visit.page.on("request", lambda request: visit.requested.append(request.url))
        visit.page.goto(uri)
        visit.page.wait_for_function("document.documentElement.dataset.live")
        yield visit
    finally:
        browser.close()
