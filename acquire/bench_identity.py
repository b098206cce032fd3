"""Whether two descriptions of benches are of the same one."""

from __future__ import annotations

from collections.abc import Mapping

from pydantic import JsonValue

from acquire.session.records import CAMERA_BODY

Description = Mapping[str, JsonValue]

# What of a simulated bench makes its devices, apart from the scene and what befalls a run.
_SIM_DEVICES = (
    "camera_px", "projector_px", "gamma", "black_level", "blur_px", "latency_s", "full_well_e",
    "read_noise_e",
)  # fmt: skip


def is_same_bench(one: Description, other: Description) -> bool:
    """Whether one session may have frames of both.

    Where a camera is reached may change: a network gives it another address, a cable put back
    another device number. Its maker's number does not, and is compared where both know it.
    """
    bodies, numbers = ({bench.get(CAMERA_BODY) for bench in (one, other)}, _numbers(one, other))
    return (
        _apart_from_camera(one) == _apart_from_camera(other)
        and len(bodies - {None}) <= 1
        and len(numbers) <= 1
    )


def are_same_devices(one: Description, other: Description) -> bool:
    """Whether what was calibrated on one holds for the other."""
    one, other = _played(one), _played(other)
    if one.get("kind") == other.get("kind") == "sim":
        return _simulated(one) == _simulated(other)
    return is_same_bench(one, other)


def _played(bench: Description) -> Description:
    played = bench.get("of")
    if bench.get("kind") == "replay" and isinstance(played, dict):
        return _played(played)
    return bench


def _simulated(bench: Description) -> dict[str, JsonValue]:
    simulation = bench.get("sim")
    return (
        {key: simulation.get(key) for key in _SIM_DEVICES} if isinstance(simulation, dict) else {}
    )


def _apart_from_camera(bench: Description) -> dict[str, JsonValue]:
    """All but which camera it is, where it is and how long a frame of it takes."""
    rest = {key: value for key, value in bench.items() if key not in {"camera", CAMERA_BODY}}
    lab = bench.get("lab")
    if isinstance(lab, dict):
        rest["lab"] = {key: value for key, value in lab.items() if key != "camera"}
    return rest


def _numbers(*benches: Description) -> set[str]:
    """The cameras' serial numbers, as far as they were named by them and not by an address."""
    named = (bench.get("camera") for bench in benches)
    return {
        name.lstrip("0") for name in named if isinstance(name, str) and name and ":" not in name
    }
