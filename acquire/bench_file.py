"""The bench as a person describes it in TOML."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, TypeAdapter, ValidationError

from acquire.errors import BenchError
from acquire.validation import StrictModel, explain

MAX_BENCH_BYTES = 1_000_000
Probability = Annotated[float, Field(ge=0, le=1)]
Pixels = Annotated[int, Field(ge=16, le=8192)]


class SimSection(StrictModel):
    """`[sim]`: the scene, the devices and what is wrong with them, each defect off by default.

    With `real_time` settling and exposing take as long as on a real bench.
    """

    scene: Literal[
        "corner", "groove", "board",
        "chessboard-1", "chessboard-2", "chessboard-3", "chessboard-4", "chessboard-5",
        "chessboard-6",
    ] = "corner"  # fmt: skip
    seed: int = Field(default=0, ge=0, lt=2**63)
    camera_px: tuple[Pixels, Pixels] = (96, 96)
    projector_px: tuple[Pixels, Pixels] = (288, 384)
    gamma: float = Field(default=1.0, ge=0.1, le=10)
    black_level: float = Field(default=0.0, ge=0, lt=1)
    blur_px: float = Field(default=0.0, ge=0, le=100)
    latency_s: float = Field(default=0.0, ge=0, le=60)
    late: Probability = 0.0
    dropped: Probability = 0.0
    swapped: Probability = 0.0
    timeouts: Probability = 0.0
    torn: Probability = 0.0
    full_well_e: float | None = Field(default=None, ge=10, le=1e9)
    read_noise_e: float = Field(default=0.0, ge=0, le=1e6)
    drift: float = Field(default=0.0, gt=-1, le=10)
    flicker: float = Field(default=0.0, ge=0, le=1)
    ambient: float = Field(default=0.0, ge=0, le=10)
    move_px: float = Field(default=0.0, ge=-1000, le=1000)
    shade: float = Field(default=0.0, ge=0, lt=1)
    slip_px: int = Field(default=0, ge=-8192, le=8192)
    zoom: float = Field(default=1.0, ge=-20, le=20)
    iso_turned: int | None = Field(default=None, ge=25, le=51200)
    real_time: bool = False


class SimBench(StrictModel):
    """A bench that is computed."""

    kind: Literal["sim"] = "sim"
    sim: SimSection = SimSection()


class ProjectorSection(StrictModel):
    """`[projector]`: the monitor; without a name the only one besides the operator's."""

    monitor: str | None = None


class CameraSection(StrictModel):
    """`[camera]`: which one, and what a frame costs for the estimates of `lumisplit plan`.

    `address` is a serial number or its end, ``usb:BUS,DEVICE`` or ``ptpip:HOST[:PORT]``; without
    it the only camera on the USB.
    """

    address: str | None = None
    frame_mb: float = Field(default=25.0, gt=0, le=1000)
    transfer_s: float = Field(default=1.0, ge=0, le=3600)


class FolderSection(StrictModel):
    """`[folder]`: a camera without PTP, released by a trigger box, its files picked up here.

    Its exposure is set by hand to what the plan says.
    """

    path: Path
    trigger_port: str
    pulse_s: float = Field(default=0.1, ge=0.001, le=3600)
    arrival_limit_s: float = Field(default=30.0, gt=0, le=3600)
    quiet_s: float = Field(default=1.0, gt=0, le=60)


class LampSection(StrictModel):
    """`[lamp]`: the projector's serial port."""

    port: str
    commands: Literal["pjlink-serial", "benq"]
    baud: int | None = Field(default=None, ge=300, le=4_000_000)
    input: str | None = None
    warm_up_s: float = Field(default=300.0, ge=0, le=7200)
    on_limit_s: float = Field(default=180.0, gt=0, le=3600)
    off_afterwards: bool = False


class LabBench(StrictModel):
    """A bench of real devices."""

    kind: Literal["lab"] = "lab"
    projector: ProjectorSection = ProjectorSection()
    camera: CameraSection = CameraSection()
    folder: FolderSection | None = None
    lamp: LampSection | None = None


BenchFile = Annotated[SimBench | LabBench, Field(discriminator="kind")]


def read_bench(path: Path) -> SimBench | LabBench:
    """Read and validate a bench file; raises `BenchError` naming the key and the reason."""
    try:
        if path.stat().st_size > MAX_BENCH_BYTES:
            raise BenchError(f"{path} is {path.stat().st_size} bytes: no bench file is that long.")
        content = tomllib.loads(path.read_text(encoding="utf-8"))
        return TypeAdapter[SimBench | LabBench](BenchFile).validate_python(content)
    except OSError as error:
        raise BenchError(
            f"There is no bench {str(path)!r} ({error.strerror}). --bench takes `sim`, `lab`, "
            "`replay:SESSION` or the path of a bench file in TOML."
        ) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise BenchError(f"{path} is not valid TOML: {error}.") from error
    except ValidationError as error:
        raise BenchError(f"{path} cannot be used:\n{explain(error)}") from error
