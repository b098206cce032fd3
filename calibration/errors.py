"""What a calibration refuses.

CalibrationError
└── UnsupportedError     the data cannot support the result: what, why, what to do
"""

from __future__ import annotations


class CalibrationError(Exception):
    """A calibration cannot be had."""


class UnsupportedError(CalibrationError):
    """The data cannot support the result; the message says why and what to do."""
