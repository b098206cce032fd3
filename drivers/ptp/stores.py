"""How much room the camera's cards have."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from drivers.ptp.codes import Operation
from drivers.ptp.datasets import StorageInfo, decode_handles
from drivers.ptp.errors import PtpProtocolError, PtpRefusedError
from drivers.ptp.session import PtpSession

READ_WRITE = 0
UNKNOWN = 0xFFFFFFFF
# Of a whole store in bytes, as some cameras say that they do not know.
UNKNOWN_BYTES = 0xFFFFFFFFFFFFFFFF


@dataclass(frozen=True, slots=True)
class Room:
    """What the cards that can be written to still take, together; None where they do not say."""

    images: int | None
    size_bytes: int | None

    @property
    def is_full(self) -> bool:
        """Whether there is surely no room for another picture."""
        return self.images == 0 or (self.images is None and self.size_bytes == 0)


def room(session: PtpSession, operations: Collection[int]) -> Room | None:
    """Room on the camera's cards; None where it has none or does not tell.

    A slot without a card is a store of logical number 0 (ISO 15740:2013, 7.2.1).
    """
    if not {Operation.GET_STORAGE_IDS, Operation.GET_STORAGE_INFO} <= frozenset(operations):
        return None
    try:
        stores = decode_handles(session.ask(Operation.GET_STORAGE_IDS).data)
        told = [
            StorageInfo.decode(session.ask(Operation.GET_STORAGE_INFO, store).data)
            for store in stores
            if store & 0xFFFF
        ]
    except (PtpRefusedError, PtpProtocolError):
        return None
    writable = [store for store in told if store.access == READ_WRITE]
    if not writable:
        return None
    images = [store.free_images for store in writable]
    sizes = [store.free_bytes for store in writable]
    return Room(
        None if UNKNOWN in images else sum(images),
        None if UNKNOWN_BYTES in sizes else sum(sizes),
    )
