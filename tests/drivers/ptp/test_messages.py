"""What a person reads when a camera says no."""

from __future__ import annotations

import pytest

from drivers.errors import CameraError, CameraTimeoutError
from drivers.ptp.errors import (
    PtpDisconnectedError,
    PtpError,
    PtpProtocolError,
    PtpRefusedError,
    PtpStalledError,
    PtpTimeoutError,
    PtpTransportError,
)

REFUSALS = {
    "standard": (
        PtpRefusedError(0x100E, 0x200C, "delete some images"),
        "the camera refused initiate capture (0x100E): store full (0x200C); delete some images",
    ),
    "Nikon": (
        PtpRefusedError(0x9207, 0xA002),
        "the camera refused initiate capture rec in media (0x9207): nikon out of focus (0xA002)",
    ),
    "unknown": (PtpRefusedError(0x9999, 0x2999), "the camera refused 0x9999: 0x2999"),
}


@pytest.mark.parametrize("name", REFUSALS)
def test_a_refusal_names_the_operation_and_the_answer(name: str) -> None:
    error, message = REFUSALS[name]
    assert str(error) == message


def test_every_error_is_a_cameras_and_only_silence_is_worth_another_try() -> None:
    errors = (
        *(PtpError, PtpProtocolError, PtpRefusedError, PtpTransportError, PtpTimeoutError),
        *(PtpStalledError, PtpDisconnectedError),
    )
    assert all(issubclass(error, CameraError) for error in errors)
    assert [e for e in errors if issubclass(e, CameraTimeoutError)] == [PtpTimeoutError]
