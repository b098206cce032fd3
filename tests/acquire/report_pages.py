"""A report read as a stranger's program would: tags, addresses, pictures and text."""

from __future__ import annotations

import base64
import io
from html.parser import HTMLParser

import numpy as np
from PIL import Image

from acquire.report import write_report
from acquire.report.page import percent
from acquire.result import Result

HOSTILE = "<script>alert('x')</script>\"><img src=https://example.org/x onerror=alert(1)>"
LOADING = {"src", "href", "srcset", "action", "data", "poster", "background", "formaction"}


class Page(HTMLParser):
    """Tags, loaded addresses, event handlers and text of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.addresses: list[str] = []
        self.handlers: list[str] = []
        self.images: dict[str, str] = {}
        self.csp = ""
        self.scripts: list[str] = []
        self._words: list[str] = []
        self._style = False
        self.feed(text)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self._words).split())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        values = {name: value or "" for name, value in attrs}
        self.addresses += [value for name, value in values.items() if name in LOADING]
        self.handlers += [name for name in values if name.startswith("on")]
        if tag == "img":
            self.images[values["alt"]] = values["src"]
        if values.get("http-equiv") == "Content-Security-Policy":
            self.csp = values["content"]
        self._style = tag in {"style", "script"}
        if tag == "script":
            self.scripts.append(values.get("type", ""))

    def handle_data(self, data: str) -> None:
        if not self._style:
            self._words.append(data)

    def pixels(self, alt: str) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
        data = base64.b64decode(self.images[alt].partition(",")[2])
        return np.asarray(Image.open(io.BytesIO(data)))


def said(fraction: float) -> str:
    """A percentage as `Page.text` has it, every space plain."""
    return percent(fraction).replace("\u202f", " ")


def page_of(result: Result) -> Page:
    return Page(write_report(result).read_text("utf-8"))
