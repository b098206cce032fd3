"""Calibrations: each a plan for the ordinary capture, a fit of `calibration`, and a profile.

plan → capture → frames → fit → `Finding` → profile file and page. A calibration that has to look
before it can ask goes through several short plans.
"""

from acquire.calibrating.catalogue import CALIBRATIONS, calibration_named
from acquire.calibrating.run import Calibrated, calibrate, recorded_sessions

__all__ = ["CALIBRATIONS", "Calibrated", "calibrate", "calibration_named", "recorded_sessions"]
