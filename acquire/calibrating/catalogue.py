"""The calibrations that there are."""

from __future__ import annotations

from acquire.calibrating.board import BoardCalibration
from acquire.calibrating.exposure import ExposureCalibration
from acquire.calibrating.finding import Calibration
from acquire.calibrating.geometry import GeometryCalibration
from acquire.calibrating.latency import LatencyCalibration
from acquire.calibrating.projector import LeakCalibration, ResponseCalibration
from acquire.calibrating.sensor import DarkCalibration, NoiseCalibration

CALIBRATIONS: tuple[Calibration, ...] = (
    DarkCalibration(),
    NoiseCalibration(),
    ResponseCalibration(),
    LeakCalibration(),
    ExposureCalibration(),
    LatencyCalibration(),
    BoardCalibration(),
    GeometryCalibration(),
)


def calibration_named(kind: str) -> Calibration:
    """The calibration of that kind."""
    return next(one for one in CALIBRATIONS if one.kind == kind)
