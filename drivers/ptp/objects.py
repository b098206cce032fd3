"""Pictures in the camera: what they are, fetching them whole, deleting them."""

from __future__ import annotations

import io
from collections.abc import Collection, Iterable
from dataclasses import dataclass

from drivers.ptp.codes import Format, Operation, ResponseCode
from drivers.ptp.datasets import ObjectInfo, decode_handles
from drivers.ptp.errors import PtpProtocolError, PtpRefusedError
from drivers.ptp.session import PtpSession
from drivers.ptp.wire import MAX_DATA_BYTES

ALL_STORES = 0xFFFFFFFF
# A part is asked for anew when it is cut; at 8 MiB the round trips cost less than 0.1 %.
PART_BYTES = 8 << 20
FETCH_TRIES = 3
DATA_TIMEOUT_S = 10.0
_NO_PARTS = frozenset({ResponseCode.OPERATION_NOT_SUPPORTED, ResponseCode.PARAMETER_NOT_SUPPORTED})


@dataclass(frozen=True, slots=True)
class CameraFile:
    """A picture as it came out of the camera.

    Parameters
    ----------
    filename, object_format
        What the camera calls it, and its format code.
    data
        The bytes, whole.
    """

    filename: str
    object_format: int
    data: bytes


def handles(session: PtpSession) -> tuple[int, ...]:
    """All objects in all stores, folders included."""
    return decode_handles(session.ask(Operation.GET_OBJECT_HANDLES, ALL_STORES, 0, 0).data)


def info(session: PtpSession, handle: int) -> ObjectInfo:
    """What an object is."""
    return ObjectInfo.decode(session.ask(Operation.GET_OBJECT_INFO, handle).data)


def is_jpeg(about: ObjectInfo | CameraFile) -> bool:
    """The lesser one of a pair; whatever else a camera takes is its raw format."""
    name = about.filename.lower()
    return about.object_format == Format.EXIF_JPEG or name.endswith((".jpg", ".jpeg"))


def pictures(session: PtpSession, added: Iterable[int]) -> list[tuple[int, ObjectInfo]]:
    """Those of some new objects that are pictures, raw ones first.

    Cameras announce a new folder as they announce a picture, and what is gone again.
    """
    found = []
    for handle in added:
        try:
            about = info(session, handle)
        except PtpRefusedError as error:
            if error.code != ResponseCode.INVALID_OBJECT_HANDLE:
                raise
        else:
            if about.object_format != Format.ASSOCIATION:
                found.append((handle, about))
    return sorted(found, key=lambda picture: is_jpeg(picture[1]))


def download(
    session: PtpSession, handle: int, about: ObjectInfo, operations: Collection[int]
) -> CameraFile:
    """Fetch an object, a large one in parts where the camera can do that.

    Parameters
    ----------
    session
        With the camera.
    handle, about
        The object.
    operations
        What the camera can do.
    """
    if about.size > MAX_DATA_BYTES:
        raise PtpProtocolError(
            f"{about.filename} has {about.size} bytes, at most {MAX_DATA_BYTES} are taken"
        )
    data = None
    if about.size > PART_BYTES and Operation.GET_PARTIAL_OBJECT in operations:
        data = _in_parts(session, handle, about)
    if data is None:
        data = _whole(session, handle, about)
    return CameraFile(about.filename, about.object_format, data)


def read_parts(
    session: PtpSession, operation: int, handle: int, size: int, part_bytes: int
) -> bytes:
    """Fetch `size` bytes with an operation that takes handle, offset and length."""
    buffer = io.BytesIO(bytes(size))
    received = failures = 0
    while received < size:
        due = min(part_bytes, size - received)
        with buffer.getbuffer() as room:
            reply = session.ask(
                operation,
                handle,
                received,
                due,
                into=room[received : received + due],
                timeout_s=DATA_TIMEOUT_S,
            )
        received += reply.size
        failures = 0 if reply.size else failures + 1
        if failures == FETCH_TRIES:
            raise _cut(received, size)
    return buffer.getvalue()


def delete(session: PtpSession, handle: int) -> None:
    """Delete an object; one that is gone already is as good as deleted."""
    session.ask(
        Operation.DELETE_OBJECT,
        handle,
        0,
        accept=(ResponseCode.INVALID_OBJECT_HANDLE, ResponseCode.STORE_NOT_AVAILABLE),
    )


def _in_parts(session: PtpSession, handle: int, about: ObjectInfo) -> bytes | None:
    """None when the camera does not do for this object what it claims to do."""
    try:
        return read_parts(session, Operation.GET_PARTIAL_OBJECT, handle, about.size, PART_BYTES)
    except PtpRefusedError as error:
        if error.code in _NO_PARTS:
            return None
        raise


def _whole(session: PtpSession, handle: int, about: ObjectInfo) -> bytes:
    """One transfer, tried again if it is cut short."""
    for _ in range(FETCH_TRIES):
        reply = session.ask(Operation.GET_OBJECT, handle, timeout_s=DATA_TIMEOUT_S)
        if reply.is_whole and reply.size >= about.size and reply.size:
            return reply.data
    raise _cut(reply.size, about.size)


def _cut(received: int, size: int) -> PtpProtocolError:
    return PtpProtocolError(
        f"the camera cut a picture off after {received} of {size} bytes, {FETCH_TRIES} times; "
        "check cable and card"
    )
