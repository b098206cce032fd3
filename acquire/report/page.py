"""The result as one HTML file that needs nothing else: no network and no other file."""

from __future__ import annotations

import base64
import hashlib
import math
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Protocol

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from acquire.report.content import Content, content_of, images_read
from acquire.result import Result
from acquire.session.folder import write_durably

PAGE = "report.html"
SCRIPTS = ("light.js", "mixer.js", "remix.js", "probe.js", "scrubber.js", "page.js")


@dataclass(frozen=True, slots=True)
class Script:
    """The only script that the page may run.

    Parameters
    ----------
    text
        All of `SCRIPTS`, in order.
    hash
        What the page's content security policy calls it.
    """

    text: str
    hash: str

    @classmethod
    def read(cls) -> Script:
        """Join the scripts that the package brings."""
        folder = files("acquire.report") / "templates"
        joined = "\n".join((folder / name).read_text("utf-8") for name in SCRIPTS)
        # Not a module: those wait until the whole page was read.
        text = f'(() => {{\n"use strict";\n{joined}}})();'
        digest = hashlib.sha256(text.encode()).digest()
        return cls(text, f"sha256-{base64.b64encode(digest).decode()}")


class Observer(Protocol):
    """Hears of the writing as it goes on."""

    def stage(self, name: str, total: int) -> None:
        """A stage of `total` units begins."""

    def advance(self) -> None:
        """One unit of the stage is done."""


def write_report(result: Result, observer: Observer | None = None) -> Path:
    """Write report.html into the result folder; the same result gives the same bytes."""
    path = result.folder / PAGE
    if observer is None:
        content = content_of(result)
    else:
        observer.stage("writing page", images_read(result.record))
        content = content_of(result, observer.advance)
    write_durably(path, render(content).encode())
    return path


def render(content: Content) -> str:
    """Put the content into the report's template."""
    return render_page("report.html.jinja", content)


def render_page(template: str, content: object) -> str:
    """Put the content of a page into its template; every text is escaped."""
    environment = Environment(
        loader=PackageLoader("acquire.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["percent"] = percent
    environment.filters["factor"] = factor
    return environment.get_template(template).render(page=content, page_script=Script.read())


def percent(fraction: float) -> str:
    """Write 0.0123 as 1.23 %; not a number as a dash."""
    if not math.isfinite(fraction):
        return "–"
    value = 100 * fraction
    digits = f"{value:.1f}" if abs(value) >= 9.95 else _plain(value)
    return digits.replace("-", "−") + "\u202f%"


def _plain(value: float) -> str:
    return np.format_float_positional(value, precision=2, fractional=False, trim="-")


def factor(gain: float) -> str:
    """Write a display gain as ×2.1."""
    return f"×{gain:.3g}"
