"""The simulated camera's memories: a card with folders, and the SDRAM that holds one shot."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.ptp.codes import Format, ResponseCode
from drivers.ptp.datasets import ObjectInfo, Picture, StorageInfo
from drivers.sim.ptp_responder.answer import RefusalError
from drivers.sim.ptp_responder.source import THUMBNAIL_PX

STORAGE = 0x00010001
SDRAM_HANDLE = 0xFFFF0001
EVERY = 0xFFFFFFFF
ROOT = 0xFFFFFFFF  # as a parent: only what lies in no folder

_DCIM, _FOLDER, _FIRST_IMAGE = 1, 2, 3
_CAPACITY_BYTES = 32 << 30
_FORMATS = {"image/jpeg": Format.EXIF_JPEG, "image/tiff": Format.TIFF}
_SUFFIXES = {Format.EXIF_JPEG: "JPG", Format.TIFF: "TIF", Format.UNDEFINED: "NEF"}


@dataclass(frozen=True, slots=True)
class StoredObject:
    """A file in the camera."""

    info: ObjectInfo
    data: bytes
    media_type: str


class Store:
    """What the camera has taken and nobody has deleted.

    Parameters
    ----------
    max_images
        That the card holds; 0 for no card.
    """

    def __init__(self, max_images: int) -> None:
        self._max_images = max_images
        self._count = 0
        self._card: dict[int, StoredObject] = {}
        self._sdram: dict[int, StoredObject] = {}
        if max_images:
            for handle, name, parent in ((_DCIM, "DCIM", 0), (_FOLDER, "100ND4S", _DCIM)):
                info = ObjectInfo(
                    STORAGE, Format.ASSOCIATION, 0, name, parent=parent, association_type=1
                )
                self._card[handle] = StoredObject(info, b"", "")

    @property
    def has_card(self) -> bool:
        """Whether there is a card."""
        return self._max_images > 0

    @property
    def free_images(self) -> int:
        """Number of images that the card still takes."""
        used = sum(o.info.object_format != Format.ASSOCIATION for o in self._card.values())
        return self._max_images - used

    @property
    def holds_sdram_image(self) -> bool:
        """Whether the last shot has not been fetched and deleted."""
        return bool(self._sdram)

    def add(self, data: bytes, media_type: str, captured_at: str, to_sdram: bool) -> int:
        """Keep a file; its handle."""
        self._count += 1
        object_format = _FORMATS.get(media_type, Format.UNDEFINED)
        info = ObjectInfo(
            0 if to_sdram else STORAGE,
            object_format,
            len(data),
            f"DSC_{self._count:04d}.{_SUFFIXES[object_format]}",
            captured_at,
            thumbnail=Picture(Format.EXIF_JPEG, 0, THUMBNAIL_PX[1], THUMBNAIL_PX[0]),
            parent=0 if to_sdram else _FOLDER,
            modified_at=captured_at,
        )
        memory = self._sdram if to_sdram else self._card
        first = SDRAM_HANDLE if to_sdram else _FIRST_IMAGE
        handle = max((first - 1, *memory)) + 1
        memory[handle] = StoredObject(info, data, media_type)
        return handle

    def get(self, handle: int) -> StoredObject:
        """An object in the card or the SDRAM."""
        found = self._card.get(handle) or self._sdram.get(handle)
        if found is None:
            raise RefusalError(ResponseCode.INVALID_OBJECT_HANDLE)
        return found

    def delete(self, handle: int) -> None:
        """Delete an image, or with `EVERY` all images on the card; folders stay."""
        if handle == EVERY:
            for each in self.handles(0, 0):
                if self._card[each].info.object_format != Format.ASSOCIATION:
                    del self._card[each]
            return
        if self.get(handle).info.object_format == Format.ASSOCIATION:
            raise RefusalError(ResponseCode.OBJECT_WRITE_PROTECTED)
        (self._sdram if handle in self._sdram else self._card).pop(handle)

    def empty_sdram(self) -> None:
        """Forget the last shot."""
        self._sdram.clear()

    def handles(self, object_format: int, parent: int) -> tuple[int, ...]:
        """Handles on the card.

        Parameters
        ----------
        object_format
            Only these; 0 for all.
        parent
            Only what lies in this folder; `ROOT` for what lies in none, 0 for all.
        """
        folder = 0 if parent == ROOT else parent
        return tuple(
            handle
            for handle, each in self._card.items()
            if object_format in {0, each.info.object_format}
            and (parent == 0 or each.info.parent == folder)
        )

    def storage_info(self) -> StorageInfo:
        """Of the card."""
        share = self.free_images / self._max_images
        return StorageInfo(
            4, 3, 0, _CAPACITY_BYTES, int(share * _CAPACITY_BYTES), self.free_images, "CARD 1"
        )
