"""Profiles that a plan or a person names, and what they change.

At capture the profiles that the plan's ``[calibration]`` names are held by their digests in the
plan, and with it in every session; copies lie in the session's ``profiles`` folder.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import JsonValue

from acquire.errors import ProfileError
from acquire.plan import CameraPlan, Plan, ProfileUse, ProjectorPlan
from acquire.plan_file import PlanFile, check_measurable, read_plan_file
from acquire.profile_file import (
    COLOURS,
    Profile,
    ProfileSummary,
    check_applies,
    read_maps,
    read_profile,
)
from acquire.session import Session
from acquire.session.folder import storage, write_durably
from acquire.session.store import PROFILES
from processing.frames.frame_noise import FrameNoise
from processing.frames.optical_contrast import OpticalContrast
from processing.ranges.blur import Blur

# Kinds that change how a session is processed.
PROCESSED = ("dark", "noise", "leak", "board")


@dataclass(frozen=True, slots=True)
class Profiles:
    """What profiles say about a session.

    Parameters
    ----------
    leak
        b, where no black frame was captured; None where no profile says.
    blur
        Of each colour, measured on a board.
    contrast
        What the optics leave of patterns, measured on the same board.
    noise
        Of a frame of superpixels.
    hot
        bool, (height, width): superpixels to leave out.
    black
        Level of each colour without light, over the black level that raw files state, fraction
        of the sensor's range.
    uses
        The profiles, by digest.
    summaries
        Of these, and of those that changed how the session was captured.
    """

    leak: float | None = None
    blur: tuple[Blur, ...] | None = None
    contrast: OpticalContrast | None = None
    noise: FrameNoise | None = None
    hot: NDArray[np.bool_] | None = None
    black: tuple[float, ...] | None = None
    uses: tuple[ProfileUse, ...] = ()
    summaries: tuple[ProfileSummary, ...] = ()


def plan_with_profiles(path: Path) -> tuple[Plan, dict[str, Path]]:
    """A plan as a person wrote it, with what its ``[calibration]`` says, and the profiles' files.

    A response takes the place of gamma, and a latency sets ``settle_s`` unless the plan does.
    """
    written = read_plan_file(path)
    files = {
        kind: path.parent / named
        for kind, named in written.calibration.model_dump().items()
        if named is not None
    }
    profiles = {kind: _of_kind(kind, file) for kind, file in files.items()}
    uses = tuple(ProfileUse(kind=p.kind, sha256=digest) for p, digest in profiles.values())
    plan = written.plan().model_copy(
        update={"projector": _projector(written, profiles), "calibration": uses}
    )
    check_measurable(plan)
    return plan, files


def check_profiles(
    files: Mapping[str, Path], bench: Mapping[str, JsonValue], camera: CameraPlan
) -> None:
    """Refuse profiles that were not measured on a bench with these devices and settings."""
    for kind, file in files.items():
        check_applies(_of_kind(kind, file)[0], str(file), bench, camera)


def keep_profiles(files: Mapping[str, Path], folder: Path) -> None:
    """Copy profiles and their images into a session."""
    if not files:
        return
    with storage(folder):
        (folder / PROFILES).mkdir(parents=True, exist_ok=True)
        for kind, file in files.items():
            profile, _ = read_profile(file)
            if profile.maps is not None:
                read_maps(file, profile)
                beside = file.parent / profile.maps.file
                write_durably(folder / PROFILES / profile.maps.file, beside.read_bytes())
            write_durably(folder / PROFILES / f"{kind}.json", file.read_bytes())


def profiles_for(session: Session, given: Iterable[Path]) -> Profiles:
    """What the session's own profiles say, and those given in their place.

    Raises
    ------
    ProfileError
        A profile is of other devices or settings, is given twice, changes nothing here, or is no
        longer the one that the plan names.
    """
    named: dict[str, Path] = {}
    for path in given:
        profile, _ = read_profile(path)
        if profile.kind not in PROCESSED:
            raise ProfileError(
                f"{path}: a {profile.kind} profile changes how a session is captured, not how it "
                "is processed; name it in the plan's [calibration]."
            )
        if profile.kind in named:
            raise ProfileError(f"{path}: a second {profile.kind} profile; give one of each kind.")
        named[profile.kind] = path
    for use in session.plan.calibration:
        if use.kind in PROCESSED and use.kind not in named:
            kept = session.folder / PROFILES / f"{use.kind}.json"
            if read_profile(kept)[1] != use.sha256:
                raise ProfileError(f"{kept} is not the profile that the session was begun with.")
            named[use.kind] = kept
    found = Profiles()
    for path in named.values():
        found = _with(found, path, session)
    captured = (use for use in session.plan.calibration if use.kind not in named)
    summaries = (*found.summaries, *(_kept_summary(session, use) for use in captured))
    return replace(found, summaries=summaries)


def _kept_summary(session: Session, use: ProfileUse) -> ProfileSummary:
    """Of a profile that the session was captured with, as far as its copy still tells."""
    kept = session.folder / PROFILES / f"{use.kind}.json"
    try:
        profile, digest = read_profile(kept)
    except ProfileError:
        digest = ""
    if digest == use.sha256:
        return profile.summary(kept, digest)
    return ProfileSummary(
        kind=use.kind,
        file=kept.name,
        page=kept.with_suffix(".html").name,
        sha256=use.sha256,
        warnings=("Its copy in the session is missing or no longer the one that was used.",),
    )


def _with(found: Profiles, path: Path, session: Session) -> Profiles:
    profile, digest = read_profile(path)
    check_applies(profile, str(path), session.record.bench, session.plan.camera)
    use = ProfileUse(kind=profile.kind, sha256=digest)
    return replace(
        found,
        **_said(profile, path),
        uses=(*found.uses, use),
        summaries=(*found.summaries, profile.summary(path, digest)),
    )


def _said(profile: Profile, path: Path) -> dict[str, Any]:
    """What a profile says, by the fields of `Profiles`."""
    if profile.kind == "leak":
        return {"leak": float(profile.numbers("leak")[0])}
    if profile.kind == "noise":
        constant, rise = profile.numbers("constant"), profile.numbers("rise")
        return {"noise": FrameNoise(constant, rise)}
    if profile.kind == "dark":
        black = tuple(profile.numbers("black_level").tolist())
        return {"hot": np.asarray(read_maps(path, profile)["hot"], bool), "black": black}
    sides, skews = profile.numbers("side_px2"), profile.numbers("skew_px2")
    modulation = [profile.column("contrast", f"modulation_{colour}") for colour in COLOURS]
    return {
        "blur": tuple(Blur(float(a), float(b)) for a, b in zip(sides, skews, strict=True)),
        "contrast": OpticalContrast(
            side_px2=sides,
            deviation_px2=profile.errors("side_px2"),
            pitch_px=profile.column("contrast", "pitch_px"),
            modulation=np.stack(modulation, axis=1),
        ),
    }


def _of_kind(kind: str, file: Path) -> tuple[Profile, str]:
    profile, digest = read_profile(file)
    if profile.kind != kind:
        raise ProfileError(
            f"calibration.{kind}: {file} is a {profile.kind} profile. Name the right file."
        )
    return profile, digest


def _projector(written: PlanFile, profiles: Mapping[str, tuple[Profile, str]]) -> ProjectorPlan:
    changes: dict[str, object] = {}
    if "response" in profiles:
        response = profiles["response"][0]
        light = tuple(tuple(response.column("light", colour).tolist()) for colour in COLOURS)
        changes["light"] = light[:1] if len(set(light)) == 1 else light
    if "latency" in profiles and "settle_s" not in written.projector.model_fields_set:
        changes["settle_s"] = float(profiles["latency"][0].numbers("settle_s")[0])
    return ProjectorPlan.model_validate(written.projector.model_dump() | changes)
