"""What a session folder says about itself, validated as it is read."""

from __future__ import annotations

import math
import platform
from enum import StrEnum
from importlib import metadata
from typing import Annotated, Literal

from pydantic import AfterValidator, BeforeValidator, Field, JsonValue

from acquire.plan import MAX_STEPS, PatternText
from acquire.validation import StrictModel
from drivers.protocols import CameraSettings, RawFrame

Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
FramePath = Annotated[str, Field(pattern=r"^frames/[0-9]{6}(-[0-9]{1,3})?\.[a-z0-9]{1,5}$")]
MAX_ATTEMPTS = 1000
CAMERA_BODY = "camera_body"  # in what is recorded of a bench, once its camera was open
MAX_FRAME_BYTES = 1 << 30

SUFFIXES = {
    "image/x-adobe-dng": "dng",
    "image/x-nikon-nef": "nef",
    "image/x-canon-cr2": "cr2",
    "image/x-canon-cr3": "cr3",
    "image/x-canon-crw": "crw",
    "image/x-sony-arw": "arw",
    "image/x-fuji-raf": "raf",
    "image/x-olympus-orf": "orf",
    "image/x-panasonic-rw2": "rw2",
    "image/x-pentax-pef": "pef",
    "image/tiff": "tiff",
    "image/png": "png",
    "image/jpeg": "jpg",
}


def _finite(settings: CameraSettings) -> CameraSettings:
    numbers = (settings.exposure_s, settings.aperture or 1.0, settings.iso or 1)
    if not all(math.isfinite(number) and number > 0 for number in numbers):
        raise ValueError(f"no camera exposes with {settings}")
    return settings


class Transfer(StrEnum):
    """How the numbers of a picture relate to light."""

    RAW = "raw"
    LINEAR = "linear"
    SRGB = "srgb"


class FrameRecord(StrictModel):
    """One line of frames.jsonl.

    A frame that was found not to show its pattern is taken again: a later line of the same step,
    its `attempt` one higher, takes its place.
    """

    step: int = Field(ge=0, lt=MAX_STEPS)
    attempt: int = Field(default=0, ge=0, lt=MAX_ATTEMPTS)
    pattern: PatternText
    settings: Annotated[CameraSettings, AfterValidator(_finite)] | None
    raster_sha256: Sha256 | None
    file: FramePath
    sha256: Sha256
    size_bytes: int = Field(ge=1, le=MAX_FRAME_BYTES)
    media_type: str = Field(pattern=r"^image/[a-z0-9.+-]{1,40}$")
    started_s: float | None
    finished_s: float | None
    monotonic_s: float | None = None

    @classmethod
    def of(
        cls,
        step: int,
        attempt: int,
        pattern: PatternText,
        raster_sha256: str,
        frame: RawFrame,
        sha256: str,
    ) -> FrameRecord:
        """The line for a frame that a camera delivered."""
        return cls(
            step=step,
            attempt=attempt,
            pattern=pattern,
            settings=frame.settings,
            raster_sha256=raster_sha256,
            file=frame_path(step, frame.media_type, attempt),
            sha256=sha256,
            size_bytes=len(frame.data),
            media_type=frame.media_type,
            started_s=frame.started_s,
            finished_s=frame.finished_s,
            monotonic_s=frame.monotonic_s,
        )

    def to_line(self) -> bytes:
        """The line as it is written; a first attempt does not mention that it is one."""
        unsaid = {"attempt"} if self.attempt == 0 else set()
        unsaid |= {"monotonic_s"} if self.monotonic_s is None else set()
        return self.model_dump_json(exclude=unsaid).encode() + b"\n"


class RunRecord(StrictModel):
    """One start of the capture: a session that was interrupted has several."""

    started_s: float
    first_step: int = Field(ge=0, le=MAX_STEPS)
    finished_s: float | None = None
    outcome: Literal["running", "complete", "stopped", "failed", "interrupted"] = "running"
    reason: str = ""


Sentences = Annotated[str, Field(pattern=r"(?s)^\S.*[.]$")]


class Caution(StrictModel):
    """A warning that tells a person all three: what was found, what it means, what to do."""

    what: Sentences
    meaning: Sentences
    remedy: Sentences

    @property
    def text(self) -> str:
        """All of it, as one paragraph."""
        return f"{self.what} {self.meaning} {self.remedy}"


def _with_its_parts(note: object) -> object:
    """A note of earlier versions, which was one text."""
    if not isinstance(note, str):
        return note
    what = note.strip() or "An empty note."
    return {
        "what": what if what.endswith(".") else f"{what}.",
        "meaning": "What that means was not written down when the frames were imported.",
        "remedy": "Import them again, if it matters.",
    }


class SourceRecord(StrictModel):
    """Where imported frames came from, how their numbers were read, and what to know of that."""

    table: str
    table_sha256: Sha256
    transfer: Transfer
    notes: tuple[Annotated[Caution, BeforeValidator(_with_its_parts)], ...] = ()


class SessionRecord(StrictModel):
    """session.json."""

    format: Literal[1] = 1
    plan_sha256: Sha256
    bench: dict[str, JsonValue]
    source: SourceRecord | None = None
    versions: dict[str, str]
    host: dict[str, str]
    runs: tuple[RunRecord, ...] = ()


def frame_path(step: int, media_type: str, attempt: int = 0) -> str:
    """The only name that the file of a step can have, relative to the session."""
    again = f"-{attempt}" if attempt else ""
    return f"frames/{step:06d}{again}.{SUFFIXES.get(media_type, 'bin')}"


def versions() -> dict[str, str]:
    """Versions of the program and of what it computes with."""
    names = ("lumisplit", "numpy", "scipy", "numba", "rawpy", "tifffile", "opencv-python-headless")
    return {"python": platform.python_version()} | {name: metadata.version(name) for name in names}


def host() -> dict[str, str]:
    """The kind of computer, without its name or its user's."""
    return {"system": platform.platform(), "machine": platform.machine()}
