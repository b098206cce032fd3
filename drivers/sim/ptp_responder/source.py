"""Where the simulated camera's pictures come from, and who makes a JPEG of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeAlias

from drivers.protocols import CameraSettings
from drivers.ptp.codes import ResponseCode
from drivers.sim.ptp_responder.answer import RefusalError

# (the file's bytes, its media type) of one exposure.
ImageSource: TypeAlias = Callable[[CameraSettings], tuple[bytes, str]]

THUMBNAIL_PX = (120, 160)
JPEG = "image/jpeg"


class Developer(Protocol):
    """What makes a picture to look at of a file.

    Who reads raw files takes long to import, and a camera that is only asked for them needs none.
    """

    def jpeg(self, data: bytes, media_type: str) -> bytes:
        """The file as a JPEG."""
        ...

    def thumbnail(self, data: bytes, media_type: str) -> bytes:
        """The file as a JPEG of `THUMBNAIL_PX`."""
        ...


class NoDeveloper:
    """Of a body that makes no JPEG of a raw file: it refuses where one is asked for."""

    def jpeg(self, data: bytes, media_type: str) -> bytes:
        """A JPEG as it is."""
        if media_type != JPEG:
            raise RefusalError(ResponseCode.GENERAL_ERROR)
        return data

    def thumbnail(self, data: bytes, media_type: str) -> bytes:  # noqa: ARG002 - see Developer
        """None of any file."""
        raise RefusalError(ResponseCode.NO_THUMBNAIL_PRESENT)
