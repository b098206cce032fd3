"""What goes wrong between here and a PTP camera.

CameraError
└── PtpError
    ├── PtpProtocolError        the device sent bytes that are not PTP; reset it
    ├── PtpRefusedError         it answered, and the answer was no
    └── PtpTransportError       the bytes did not get through
        ├── PtpTimeoutError     (also a CameraTimeoutError) silence
        ├── PtpStalledError     a USB endpoint is halted
        └── PtpDisconnectedError  cable, power or sleep: the device is gone
"""

from __future__ import annotations

from drivers.errors import CameraError, CameraTimeoutError
from drivers.ptp.codes import operation_name, response_name


class PtpError(CameraError):
    """A camera on PTP failed; the message says what, why and what to do."""


class PtpProtocolError(PtpError):
    """The device sent something that is not PTP, or not at this point."""


class PtpRefusedError(PtpError):
    """The device answered an operation with another code than OK.

    Parameters
    ----------
    operation, code
        The operation and the response code, 16 bits each.
    advice
        What to do about it, if that is known; ends the message.
    """

    def __init__(self, operation: int, code: int, advice: str = "") -> None:
        self.operation = operation
        self.code = code
        message = f"the camera refused {operation_name(operation)}: {response_name(code)}"
        super().__init__(f"{message}; {advice}" if advice else message)


class PtpTransportError(PtpError):
    """The bytes did not get through."""


class PtpTimeoutError(PtpTransportError, CameraTimeoutError):
    """The device is silent."""


class PtpStalledError(PtpTransportError):
    """The device halted a USB endpoint."""


class PtpDisconnectedError(PtpTransportError):
    """The device is gone: unplugged, switched off, asleep, or the connection was closed."""
