"""The result of a calibration as a file: what was found, how sure it is, and what it was found on.

The profile is JSON; images that belong to it lie beside it in one npz, held by its digest.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, JsonValue, ValidationError

from acquire.bench_identity import are_same_devices
from acquire.errors import ProfileError, SessionError
from acquire.plan import CameraPlan, ProfileKind, ProjectorPlan
from acquire.session import Session
from acquire.session.folder import read_plain, write_durably
from acquire.session.records import Sha256
from acquire.validation import StrictModel, explain

COLOURS = ("red", "green", "blue")
MAX_PROFILE_BYTES = 16 << 20
MAX_MAPS_BYTES = 4 << 30
Numbers = tuple[float | None, ...]
# What of a camera's settings a calibration holds for.
_BOUND_SETTINGS: Mapping[str, tuple[str, ...]] = {
    "dark": ("exposure_s", "iso"),
    "noise": ("iso",),
    "board": ("aperture",),
}


class Quantity(StrictModel):
    """A number, or one a colour, with its standard uncertainty; null where there is none.

    `role`: what was ``found``; a ``residual``, what the model or the frames leave unexplained; a
    ``detail``, which only programs need.
    """

    meaning: str
    unit: str
    value: Numbers = Field(min_length=1)
    uncertainty: Numbers | None = None
    role: Literal["found", "residual", "detail"] = "found"

    @property
    def in_words(self) -> str:
        """``0.0123 ± 0.0004, …``; a dash where there is no number."""
        errors = self.uncertainty or (None,) * len(self.value)
        return ", ".join(
            "–" if value is None else f"{value:.5g}" + ("" if error is None else f" ± {error:.2g}")
            for value, error in zip(self.value, errors, strict=True)
        )


class Curve(StrictModel):
    """A table: columns of equal length."""

    meaning: str
    columns: dict[str, Numbers]


class MapFile(StrictModel):
    """The npz of images beside the profile."""

    file: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,200}$")]
    sha256: Sha256


class ProfileSummary(StrictModel):
    """What a reader of a result must know of a profile that it was made with.

    `file` is its name, `page` that of the page that `lumisplit calibrate` wrote beside it. What
    the profile says of itself is empty where it can no longer be read.
    """

    kind: ProfileKind
    file: str
    page: str
    sha256: Sha256
    measured: str = ""
    figures: dict[str, Quantity] = Field(default_factory=dict)
    warnings: tuple[str, ...] = ()


class SessionUse(StrictModel):
    """A session that the calibration was computed from."""

    plan_sha256: Sha256
    frames_sha256: Sha256
    frames: int = Field(ge=1)


class Profile(StrictModel):
    """A calibration."""

    format: Literal[1] = 1
    kind: ProfileKind
    measured: str
    bench: dict[str, JsonValue]
    camera: CameraPlan
    projector: ProjectorPlan
    sessions: tuple[SessionUse, ...] = Field(min_length=1)
    quantities: dict[str, Quantity]
    curves: dict[str, Curve] = Field(default_factory=dict)
    maps: MapFile | None = None
    warnings: tuple[str, ...] = ()
    versions: dict[str, str]

    def summary(self, file: Path, digest: str) -> ProfileSummary:
        """Its key figures, what was found before what is left, under the name of its file."""
        order = ("found", "residual")
        shown = [(name, one) for name, one in self.quantities.items() if one.role in order]
        shown.sort(key=lambda each: order.index(each[1].role))
        return ProfileSummary(
            kind=self.kind,
            file=file.name,
            page=file.with_suffix(".html").name,
            sha256=digest,
            measured=self.measured,
            figures=dict(shown),
            warnings=self.warnings,
        )

    def numbers(self, name: str) -> NDArray[np.float64]:
        """A quantity's values; NaN where there is none."""
        return _array(self._known(self.quantities, name).value)

    def errors(self, name: str) -> NDArray[np.float64]:
        """Standard uncertainties of a quantity; 0 where none is stated."""
        quantity: Quantity = self._known(self.quantities, name)
        stated = quantity.uncertainty or (None,) * len(quantity.value)
        return np.nan_to_num(_array(stated))

    def column(self, curve: str, name: str) -> NDArray[np.float64]:
        """A column of a table."""
        return _array(self._known(self._known(self.curves, curve).columns, name))

    def _known(self, held: Mapping[str, Any], name: str) -> Any:
        if name not in held:
            raise ProfileError(
                f"The {self.kind} profile holds no {name!r}: it was made by another version or "
                "changed by hand. Calibrate again."
            )
        return held[name]


def _array(values: Numbers) -> NDArray[np.float64]:
    return np.array([np.nan if value is None else value for value in values], np.float64)


def numbers(values: NDArray[Any] | Sequence[float] | float) -> Numbers:
    """Numbers as a profile holds them, what is not finite as null."""
    flat = np.ravel(np.asarray(values, np.float64))
    return tuple(float(value) if np.isfinite(value) else None for value in flat)


def session_use(session: Session) -> SessionUse:
    """What identifies a session: the digests of its plan and of its lines."""
    lines = b"".join(session.complete_lines())
    return SessionUse(
        plan_sha256=session.plan.sha256,
        frames_sha256=hashlib.sha256(lines).hexdigest(),
        frames=len(session.frames),
    )


def measured_at(session: Session) -> str:
    """When the last frame was taken, by the bench's clock, ISO 8601 in UTC."""
    moments = [frame.finished_s for frame in session.frames if frame.finished_s is not None]
    if not moments:
        return "unknown"
    return datetime.fromtimestamp(max(moments), UTC).isoformat(timespec="seconds")


def write_profile(path: Path, profile: Profile, maps: Mapping[str, NDArray[Any]]) -> Profile:
    """Write a profile and its images; the profile, which holds their digest, comes last."""
    if maps:
        buffer = io.BytesIO()
        np.savez_compressed(buffer, allow_pickle=False, **dict(maps))
        beside = path.with_suffix(".npz")
        write_durably(beside, buffer.getvalue())
        digest = hashlib.sha256(buffer.getvalue()).hexdigest()
        profile = profile.model_copy(update={"maps": MapFile(file=beside.name, sha256=digest)})
    write_durably(path, profile.model_dump_json(indent=1).encode() + b"\n")
    return profile


def read_profile(path: Path) -> tuple[Profile, str]:
    """A profile and the digest of its file."""
    try:
        content = read_plain(path, MAX_PROFILE_BYTES)
        profile = Profile.model_validate_json(content)
    except SessionError as error:
        raise ProfileError(f"{error} `lumisplit calibrate` makes profiles.") from error
    except ValidationError as error:
        raise ProfileError(f"{path} is no profile that can be used:\n{explain(error)}") from error
    return profile, hashlib.sha256(content).hexdigest()


def read_maps(path: Path, profile: Profile) -> dict[str, NDArray[Any]]:
    """The images of a profile that lies at `path`, checked against their digest."""
    if profile.maps is None:
        return {}
    beside = path.parent / profile.maps.file
    try:
        content = read_plain(beside, MAX_MAPS_BYTES)
    except SessionError as error:
        raise ProfileError(f"{error} Keep it beside {path}.") from error
    if hashlib.sha256(content).hexdigest() != profile.maps.sha256:
        raise ProfileError(f"{beside} is not the file that {path} was written with.")
    with np.load(io.BytesIO(content), allow_pickle=False) as archive:
        return {name: archive[name] for name in archive.files}


def check_applies(
    profile: Profile, name: str, bench: Mapping[str, JsonValue], camera: CameraPlan
) -> None:
    """Refuse a profile of another bench, or of camera settings that it does not hold for."""
    if not are_same_devices(profile.bench, bench):
        raise ProfileError(
            f"{name}: this {profile.kind} profile is of another bench. Calibrate on the bench "
            "that the session is captured on."
        )
    for key in _BOUND_SETTINGS.get(profile.kind, ()):
        there, here = getattr(profile.camera, key), getattr(camera, key)
        if there != here:
            raise ProfileError(
                f"{name}: this {profile.kind} profile holds for {key} = {there}, the session has "
                f"{here}. Calibrate again with the session's settings."
            )
