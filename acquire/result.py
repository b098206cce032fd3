"""The result folder: what a processed session yields, readable by any program.

    result.json                     names, mixing, shares, convergence, warnings, versions
    components/NAME.tiff            float32, linear, (height, width, 3)
    deviations/NAME.tiff            standard error of the component, where the method knows it
    pitches/direct-0008.tiff        direct light at a pitch, and pitches/global-0008.tiff
    pitches/corrected-0008.tiff     direct light freed from the bias that noise gives max/min, and
    pitches/deviation-0008.tiff     its standard error, where the noise is known
    white.tiff                      the scene under white light less the black reference
    mask.tiff                       uint8: 0 measured, 1 saturated, 2 unlit
    proof/measured-000123-0.tiff    a frame that looked bad, and proof/predicted-…, what it should
                                    show: step and attempt, averaged down, where frames were judged
    report.html                     the page that shows it all

Saturated pixels are NaN in every float image, unlit ones 0.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from enum import IntEnum
from pathlib import Path
from typing import Annotated, Literal, TypeVar

import numpy as np
import tifffile
from numpy.typing import NDArray
from pydantic import ConfigDict, Field, JsonValue, ValidationError

from acquire.errors import ResultError, SessionError
from acquire.exposure_record import ExposureRecord
from acquire.plan import CameraPlan, ProjectorPlan
from acquire.profile_file import ProfileSummary
from acquire.session.folder import read_plain, storage, write_durably
from acquire.session.records import Caution, RunRecord, Sha256, SourceRecord
from acquire.validation import StrictModel, explain
from processing.frames.drift import Course
from processing.patterns import Family

RECORD = "result.json"
MAX_JSON_BYTES = 64 << 20

Scalar = TypeVar("Scalar", np.float32, np.uint8)
Side = Annotated[int, Field(ge=1, le=65_535)]
ComponentName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9-]{0,40}$")]
ProofPath = Annotated[str, Field(pattern=r"^proof/[a-z0-9-]{1,60}\.tiff$")]
ImagePath = Annotated[str, Field(pattern=r"^(components|pitches)/[a-z][a-z0-9-]{0,60}\.tiff$")]


class PixelClass(IntEnum):
    """Values of mask.tiff."""

    MEASURED = 0
    SATURATED = 1
    UNLIT = 2


class PitchRecord(StrictModel):
    """The separation at one pitch of one family of patterns.

    `additivity_error` and `direct_peak` as in `processing.frames.soundness`, None where there was
    no white frame (or, for the first, no balanced set of shifts); pitches that are not `resolved`
    take no part in the decomposition. `corrected` is direct light freed from the bias of noise,
    `deviation` its standard error; None where the noise is unknown. `contrast`: what camera and
    projector leave of the pattern in each colour, by a board; where the pitch is resolved, direct
    light was divided by it. `proven`: how many of its frames were found to show their own pattern;
    `residual`: the largest part of the contrast that the prediction of one of them leaves; None
    where they were not judged.
    """

    family: Family
    pitch_px: int
    shifts: int
    direct: ImagePath
    global_: ImagePath = Field(alias="global", serialization_alias="global")
    corrected: ImagePath | None = None
    deviation: ImagePath | None = None
    proven: int | None = None
    residual: float | None = None
    additivity_error: float | None = None
    direct_peak: float | None = None
    contrast: tuple[float, ...] | None = None
    resolved: bool = True

    model_config = ConfigDict(populate_by_name=True)

    @property
    def divided_by(self) -> NDArray[np.float32] | None:
        """The contrast that direct light was divided by; None where it was not."""
        if self.contrast is None or not self.resolved:
            return None
        return np.array(self.contrast, np.float32)

    @property
    def whole(self) -> bool:
        """Every frame was found to show its own pattern."""
        return self.proven == self.shifts


class MixingRecord(StrictModel):
    """α: how much of each component the direct image at each row holds.

    `alpha[colour][row][component]`; the rows are `families[row]` at `pitch_px[row]`, the last
    row is white light, whose pitch is infinite and written as null. `half_width`, in the same
    order, is half of the 95 % confidence interval that `interval` describes; null where it could
    not be had.
    """

    families: tuple[Family, ...]
    pitch_px: tuple[int | None, ...]
    alpha: tuple[tuple[tuple[float, ...], ...], ...]
    half_width: tuple[tuple[tuple[float | None, ...], ...], ...] | None = None
    interval: str = ""


class PortraitRecord(StrictModel):
    """A frame that looked bad, beside what it should show; see `acquire.proof.portraits`.

    Parameters
    ----------
    step, attempt, pattern
        Which exposure it is, and of what.
    verdict, is_right
        What the proof found, as a predicate, and whether the frame shows its pattern.
    how, holds
        What the prediction was made from, in words, and the part of the contrast that it holds.
    miss
        Root mean square of frame less prediction, in parts of white.
    white
        Level of white less black, fraction of full scale.
    light, residual, additivity
        As in ``proof.jsonl``.
    measured, predicted
        float32 TIFFs, (height, width, 3) with `shape`, NaN where saturated.
    """

    step: int
    attempt: int
    pattern: str
    verdict: str
    is_right: bool
    how: str
    holds: float | None
    miss: float | None
    white: float | None
    light: float | None
    residual: float | None
    additivity: float | None
    measured: ProofPath
    predicted: ProofPath | None
    shape: tuple[Side, Side]


class ProofRecord(StrictModel):
    """What the frames that count were found to show, as `acquire.proof` judged them at capture.

    Parameters
    ----------
    judged, wrong, unseen, retaken
        Numbers of frames; `unseen` were too faint to be told from others.
    light
        Lamp and exposure of each judged frame in the order of steps, relative to the first
        references; null where it could not be had.
    additivity
        Pattern and complement against white and black, relative, of each judged frame.
    moved_px
        How far each is from the first white frame, in camera pixels.
    saturated, shaded
        Part of each one's pixels that are saturated, and part of what white lights that is dark in
        it and in its complement.
    verdict
        What these figures say about the session, in sentences.
    worst
        Pictures of the worst frames.
    """

    judged: int
    wrong: int
    unseen: int
    retaken: int
    light: tuple[float | None, ...] = ()
    additivity: tuple[float | None, ...] = ()
    moved_px: tuple[float | None, ...] = ()
    saturated: tuple[float | None, ...] = ()
    shaded: tuple[float | None, ...] = ()
    verdict: tuple[str, ...] = ()
    worst: tuple[PortraitRecord, ...] = ()


class DriftRecord(StrictModel):
    """How light and black level went during the run, by the repeated references.

    Parameters
    ----------
    course, corrected
        Whether it was steady, smooth or rough, and whether the frames were freed from it.
    white_order, gain
        Place of each white frame among the exposures, and its light in each colour, 1 at the first.
    black_order, offset
        The same of the black frames: rise of their level, fraction of the sensor's range.
    range, bend
        Of gain or offset, the larger in parts of the light: largest less smallest, and how far a
        reference lies off the line between its neighbours.
    """

    course: Course
    corrected: bool
    white_order: tuple[int, ...]
    gain: tuple[tuple[float, ...], ...]
    black_order: tuple[int, ...]
    offset: tuple[tuple[float, ...], ...]
    range: float
    bend: float


class FrameNoiseRecord(StrictModel):
    """Variance of a frame's noise in each colour: in the dark, and its rise with light.

    In fractions of full scale; `processing.frames.frame_noise.FrameNoise`.
    """

    constant: tuple[float, ...]
    slope: tuple[float, ...]


class MaskRecord(StrictModel):
    """How many pixels there are and how many could not be measured."""

    pixels: int
    saturated: int
    unlit: int


class SessionSummary(StrictModel):
    """What the report repeats of the session."""

    plan_sha256: Sha256
    frames: int
    bench: dict[str, JsonValue]
    source: SourceRecord | None
    camera: CameraPlan
    projector: ProjectorPlan
    runs: tuple[RunRecord, ...]
    incidents: tuple[str, ...] = ()
    versions: dict[str, str]


class ResultRecord(StrictModel):
    """result.json; `cautions` are the `warnings` in their parts, as far as those are known.

    `profiles` are those that the frames were captured or processed with.
    """

    format: Literal[1] = 1
    method: str
    options: dict[str, JsonValue]
    components: tuple[ComponentName, ...]
    shape: tuple[Side, Side]
    pitches: tuple[PitchRecord, ...]
    mixing: MixingRecord
    pca_shares: tuple[float, ...]
    convergence: tuple[float, ...]
    mask: MaskRecord
    noise: float | None
    frame_noise: FrameNoiseRecord | None = None
    deviations: bool = False
    warnings: tuple[str, ...]
    cautions: tuple[Caution, ...] = ()
    proof: ProofRecord | None = None
    profiles: tuple[ProfileSummary, ...] = ()
    drift: DriftRecord | None = None
    exposures: ExposureRecord | None = None
    plan_sha256: Sha256
    session: SessionSummary
    versions: dict[str, str]


class Result:
    """A result folder opened for reading."""

    def __init__(self, folder: Path, record: ResultRecord) -> None:
        self.folder = folder
        self.record = record

    @classmethod
    def open(cls, folder: Path) -> Result:
        """Open a folder that `lumisplit process` wrote."""
        if not (folder / RECORD).exists():
            raise ResultError(
                f"{folder} is not a result: it has no {RECORD}. "
                "`lumisplit process SESSION --out RESULT` makes one."
            )
        try:
            text = read_plain(folder / RECORD, MAX_JSON_BYTES)
            return cls(folder, ResultRecord.model_validate_json(text))
        except SessionError as error:
            raise ResultError(str(error)) from error
        except ValidationError as error:
            raise ResultError(f"{folder / RECORD} cannot be used:\n{explain(error)}") from error

    def component(self, name: str) -> NDArray[np.float32]:
        """One component, (height, width, 3)."""
        return self._image(f"components/{name}.tiff")

    def deviation(self, name: str) -> NDArray[np.float32]:
        """Standard error of a component, (height, width, 3)."""
        return self._image(f"deviations/{name}.tiff")

    def pitch_image(self, path: str) -> NDArray[np.float32]:
        """A direct or global image named in the record, (height, width, 3)."""
        return self._image(path)

    def portrait(self, path: str, shape: tuple[int, int]) -> NDArray[np.float32]:
        """A frame or its prediction, (height, width, 3), named in the record of the proof."""
        return read_tiff(self.folder / path, (*shape, 3), np.float32)

    def component_view(self, name: str) -> NDArray[np.float32]:
        """One component as it lies on the disk, (height, width, 3)."""
        return self.view(f"components/{name}.tiff")

    def view(self, relative: str) -> NDArray[np.float32]:
        """A float image of the result as it lies on the disk, (height, width, 3)."""
        path = self.folder / relative
        with _opened_tiff(path, (*self.record.shape, 3), np.float32) as page:
            if not page.is_memmappable:
                return np.asarray(page.asarray(), np.float32)
        mapped: NDArray[np.float32] = tifffile.memmap(path, mode="r")
        return mapped

    @property
    def sha256(self) -> str:
        """Digest of result.json as it lies on the disk."""
        return hashlib.sha256(read_plain(self.folder / RECORD, MAX_JSON_BYTES)).hexdigest()

    def refuse_inside(self, path: Path) -> None:
        """Refuse to write where a part of the result is or would be."""
        if path.resolve().is_relative_to(self.folder.resolve()):
            raise ResultError(
                f"{path} lies inside the result itself, which stays as it was processed. "
                "Give another --out."
            )

    @property
    def white(self) -> NDArray[np.float32]:
        """The scene under white light, (height, width, 3)."""
        return self._image("white.tiff")

    @property
    def mask(self) -> NDArray[np.uint8]:
        """`PixelClass` of every pixel, (height, width)."""
        return read_tiff(self.folder / "mask.tiff", self.record.shape, np.uint8)

    def _image(self, relative: str) -> NDArray[np.float32]:
        return read_tiff(self.folder / relative, (*self.record.shape, 3), np.float32)


def write_record(folder: Path, record: ResultRecord) -> None:
    """Write result.json, the last file of a result."""
    text = record.model_dump_json(by_alias=True, indent=1)
    write_durably(folder / RECORD, text.encode() + b"\n")


def write_tiff(path: Path, image: NDArray[np.float32] | NDArray[np.uint8]) -> None:
    """Write an image as an uncompressed TIFF."""
    photometric = "rgb" if image.ndim == 3 else "minisblack"
    with storage(path):
        tifffile.imwrite(path, image, photometric=photometric, metadata=None)


def read_tiff(path: Path, shape: tuple[int, ...], dtype: type[Scalar]) -> NDArray[Scalar]:
    """Read an image of a result after checking that it is the one expected."""
    with _opened_tiff(path, shape, dtype) as page:
        return np.asarray(page.asarray(), dtype)


@contextmanager
def _opened_tiff(
    path: Path, shape: tuple[int, ...], dtype: type[np.generic]
) -> Iterator[tifffile.TiffPage]:
    try:
        if path.is_symlink() or path.parent.is_symlink():
            raise ResultError(f"Refused {path}: it is a link.")
        with tifffile.TiffFile(path) as file:
            page = file.pages.first
            if page.shape != shape or page.dtype != dtype:
                raise ResultError(
                    f"{path} holds {page.shape} {page.dtype}, not {shape} {dtype.__name__} as "
                    "result.json says. Process the session again."
                )
            yield page
    except ResultError:
        raise
    except Exception as error:
        # tifffile lets out whatever its parsing trips over, from KeyError to struct.error.
        raise ResultError(f"Cannot read {path}: {error!r}. Process the session again.") from error
