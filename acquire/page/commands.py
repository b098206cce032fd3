"""What a browser may ask of the bench; nothing else is understood."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from pydantic import Field, TypeAdapter

from acquire.page.state import Source
from acquire.validation import StrictModel
from drivers.protocols import CameraSettings

MAX_COMMAND_BYTES = 2048
MAX_SIDE_PX = 65_536


class Show(StrictModel):
    """Project ``white``, ``black``, ``chart`` or a pattern."""

    do: Literal["show"]
    what: str = Field(max_length=80)


class Look(StrictModel):
    """Let the camera deliver pictures, or stop it."""

    do: Literal["look"]
    source: Source


class Expose(StrictModel):
    """Settings of the pictures while aiming."""

    do: Literal["expose"]
    exposure_s: float = Field(gt=0, le=3600)
    aperture: float | None = Field(default=None, gt=0, le=1000)
    iso: int | None = Field(default=None, gt=0, le=10_000_000)

    @property
    def settings(self) -> CameraSettings:
        """The settings as a camera takes them."""
        return CameraSettings(self.exposure_s, self.aperture, self.iso)


class Order(StrictModel):
    """One word to the bench: open or let go the devices; the plan's start, rest and end.

    ``start-new`` begins the plan in another folder, whose name the bench chooses.
    """

    do: Literal["aim", "rest", "start", "start-new", "pause", "go-on", "stop"]


class Helm(StrictModel):
    """Who commands: take control when it is free, ask for it, hand it over or keep it."""

    do: Literal["take", "ask", "hand-over", "keep", "leave"]


class Region(StrictModel):
    """The part of the picture that this viewer wants pixel for pixel; None for all of it."""

    do: Literal["region"]
    box: (
        Annotated[tuple[Pixel, Pixel, Pixel, Pixel], Field(description="left, top, width, height")]
        | None
    ) = None


class Ready(StrictModel):
    """The viewer has shown its last picture and can take another."""

    do: Literal["ready"]


Pixel = Annotated[int, Field(ge=0, le=MAX_SIDE_PX)]
BenchCommand = Show | Look | Expose | Order
Command = BenchCommand | Helm | Region | Ready
Region.model_rebuild()

COMMAND: Final = TypeAdapter[Command](Annotated[Command, Field(discriminator="do")])
BENCH_COMMAND: Final = TypeAdapter[BenchCommand](Annotated[BenchCommand, Field(discriminator="do")])
