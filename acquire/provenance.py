"""What every file made from a result says about itself."""

from __future__ import annotations

import json
from collections.abc import Mapping

from pydantic import JsonValue

from acquire.result import Result


def description(result: Result) -> dict[str, JsonValue]:
    """Where numbers come from and what they mean."""
    record = result.record
    return {
        "software": f"lumisplit {record.versions.get('lumisplit', 'of unknown version')}",
        "color_space": "linear RGB of the camera, without white balance or matrix",
        "unit": "fraction of the sensor's range for white less black light",
        "not_measured": "NaN where saturated, 0 where unlit",
        "method": record.method,
        "components": list(record.components),
        "result_sha256": result.sha256,
        "plan_sha256": record.plan_sha256,
        "versions": dict(record.versions),
    }


def description_text(said: Mapping[str, JsonValue]) -> str:
    """As JSON in ASCII, which every container can carry."""
    return json.dumps(said)
