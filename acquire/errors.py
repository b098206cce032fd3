"""Everything foreseeable that ends a command; each message says what, why and what to do.

LumisplitError
├── PlanError       the plan cannot be carried out as written
├── SessionError    the session folder is damaged, foreign or does not fit
│   └── StorageError    the disk did not take a frame
├── BenchError      the bench is unknown, misdescribed or does not fit the plan
├── ProofError      frames do not show what they should
├── StackError      the frames cannot be measured together
├── ResultError     the result folder or truth file cannot be used
└── ProfileError    a calibration cannot be had, read, or used here
"""

from __future__ import annotations


class LumisplitError(Exception):
    """Ends the command with one message and exit status 1."""


class PlanError(LumisplitError):
    """The plan cannot be carried out as written."""


class SessionError(LumisplitError):
    """The session folder cannot be used."""


class StorageError(SessionError):
    """The disk did not take what had to be kept."""


class BenchError(LumisplitError):
    """The bench is unknown, misdescribed or does not fit the plan."""


class ProofError(LumisplitError):
    """Frames do not show what they should, however often they are taken."""


class StackError(LumisplitError):
    """The frames cannot be measured together."""


class ResultError(LumisplitError):
    """The result folder or the truth file cannot be used."""


class ProfileError(LumisplitError):
    """A calibration cannot be had, its profile not be read, or not be used here."""
