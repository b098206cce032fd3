"""USB containers to and from bytes.

After the USB Still Image Capture Device definition 1.0; everything is little-endian. Data phases
are not gathered here: `transaction` streams them.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TypeAlias

from drivers.ptp.codes import UNDEFINED_LENGTH, ContainerType
from drivers.ptp.errors import PtpProtocolError

HEADER_BYTES = 12  # of a USB container
MAX_PARAMETERS = 5
MAX_CONTAINER_BYTES = HEADER_BYTES + 4 * MAX_PARAMETERS  # of any but a data container
# A raw of the largest medium-format backs takes 0.3 GB.
MAX_DATA_BYTES = 1 << 30

_KINDS = frozenset(ContainerType)

Bytes: TypeAlias = bytes | bytearray | memoryview


@dataclass(frozen=True, slots=True)
class Header:
    """The first 12 bytes of a USB container.

    Parameters
    ----------
    length
        Bytes of the whole container; `UNDEFINED_LENGTH` when only a short packet ends it.
    kind
        What it is.
    code, transaction
        Operation, response or event; the transaction that it belongs to.
    """

    length: int
    kind: ContainerType
    code: int
    transaction: int

    @classmethod
    def decode(cls, data: Bytes) -> Header:
        """From exactly 12 bytes."""
        length, kind, code, transaction = struct.unpack("<IHHI", data)
        if kind not in _KINDS:
            raise PtpProtocolError(
                f"a container of type {kind}, which does not exist: the stream is out of step"
            )
        header = cls(length, ContainerType(kind), code, transaction)
        if kind == ContainerType.DATA:
            if not HEADER_BYTES <= length <= MAX_DATA_BYTES and length != UNDEFINED_LENGTH:
                raise PtpProtocolError(f"a data container of {length} bytes")
        elif not HEADER_BYTES <= length <= MAX_CONTAINER_BYTES or length % 4:
            raise PtpProtocolError(f"a {header.kind.name.lower()} container of {length} bytes")
        return header

    def encode(self) -> bytes:
        """As it travels."""
        return struct.pack("<IHHI", self.length, self.kind, self.code, self.transaction)


@dataclass(frozen=True, slots=True)
class Container:
    """A whole USB container.

    Parameters
    ----------
    kind, code, transaction
        As in `Header`.
    payload
        The parameters, 4 bytes each, or the data.
    """

    kind: ContainerType
    code: int
    transaction: int
    payload: Bytes = b""

    @classmethod
    def with_parameters(
        cls, kind: ContainerType, code: int, transaction: int, parameters: tuple[int, ...] = ()
    ) -> Container:
        """A command, response or event with up to five parameters."""
        return cls(kind, code, transaction, parameters_bytes(parameters))

    @property
    def parameters(self) -> tuple[int, ...]:
        """The payload of a command, response or event."""
        return decode_parameters(self.payload)

    def encode(self) -> bytes:
        """As it travels."""
        length = HEADER_BYTES + len(self.payload)
        return b"".join(
            (Header(length, self.kind, self.code, self.transaction).encode(), self.payload)
        )

    @classmethod
    def decode(cls, data: Bytes) -> Container:
        """From the bytes of one container and no others."""
        if len(data) < HEADER_BYTES:
            raise PtpProtocolError(f"a container of {len(data)} bytes, at least {HEADER_BYTES}")
        header = Header.decode(data[:HEADER_BYTES])
        if header.length not in {len(data), UNDEFINED_LENGTH}:
            raise PtpProtocolError(f"a container of {len(data)} bytes claims {header.length}")
        return cls(header.kind, header.code, header.transaction, bytes(data[HEADER_BYTES:]))


def parameters_bytes(parameters: tuple[int, ...]) -> bytes:
    """Parameters of 32 bits as they travel."""
    if len(parameters) > MAX_PARAMETERS or any(not 0 <= p < 1 << 32 for p in parameters):
        raise ValueError(f"up to {MAX_PARAMETERS} parameters of 32 bits, not {parameters}")
    return struct.pack(f"<{len(parameters)}I", *parameters)


def decode_parameters(data: Bytes) -> tuple[int, ...]:
    """Parameters from all of `data`."""
    if len(data) % 4 or len(data) > 4 * MAX_PARAMETERS:
        raise PtpProtocolError(f"{len(data)} bytes are not up to {MAX_PARAMETERS} parameters")
    return struct.unpack(f"<{len(data) // 4}I", data)
