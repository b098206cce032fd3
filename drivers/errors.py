"""Everything that a driver raises for reasons outside the program.

DriverError
├── ProjectorError
├── CameraError
│   ├── CameraTimeoutError   no frame came; another try may succeed
│   └── SettingsError        the camera cannot be set as asked
├── SerialError              the device on the serial line does not answer as it should
├── ReplayError              the recording does not hold what was asked of it
└── DecodeError              the bytes are not a picture that can be measured
"""

from __future__ import annotations


class DriverError(Exception):
    """A device or its data failed; the message says what, why and what to do."""


class ProjectorError(DriverError):
    """The projector cannot show what it was given."""


class CameraError(DriverError):
    """The camera cannot deliver."""


class CameraTimeoutError(CameraError):
    """No frame arrived in time; the exposure may be tried again."""


class SettingsError(CameraError):
    """The camera does not take the settings that were asked for."""


class SerialError(DriverError):
    """The serial port cannot be opened, or what hangs on it is silent or unintelligible."""


class ReplayError(DriverError):
    """The recording has no frame for this raster and these settings."""


class DecodeError(DriverError):
    """The bytes are no picture, or none whose values can be trusted."""
