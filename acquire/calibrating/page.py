"""A calibration as a page: what was found, how sure it is, and the drawings."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from acquire.calibrating.finding import Plot
from acquire.calibrating.run import Calibrated
from acquire.profile_file import Profile
from acquire.report.page import render_page
from acquire.report.settings import Rows
from acquire.session.folder import write_durably

TITLES = {
    "dark": "The camera without light",
    "noise": "The camera's noise",
    "response": "The projector's response",
    "leak": "The projector's leak",
    "exposure": "The exposure",
    "latency": "The delay of light",
    "geometry": "Where camera and projector look",
    "board": "Contrast against pitch",
}


@dataclass(frozen=True, slots=True)
class QuantityRow:
    """A quantity in words."""

    name: str
    meaning: str
    unit: str
    values: str


@dataclass(frozen=True, slots=True)
class Sheet:
    """What the page's template needs."""

    title: str
    summary: str
    warnings: tuple[str, ...]
    quantities: tuple[QuantityRow, ...]
    plots: tuple[Plot, ...]
    origin: Rows


def write_page(out: Path, calibrated: Calibrated, purpose: str) -> Path:
    """Write the page beside the profile."""
    path = out.with_suffix(".html")
    write_durably(path, render_page("calibration.html.jinja", sheet(calibrated, purpose)).encode())
    return path


def sheet(calibrated: Calibrated, purpose: str) -> Sheet:
    """The page's content."""
    profile = calibrated.profile
    return Sheet(
        title=TITLES[profile.kind],
        summary=purpose[0].upper() + purpose[1:] + ".",
        warnings=profile.warnings,
        quantities=tuple(
            QuantityRow(name, one.meaning, one.unit, one.in_words)
            for name, one in profile.quantities.items()
        ),
        plots=calibrated.finding.plots,
        origin=(
            ("kind", profile.kind),
            ("measured", profile.measured),
            ("bench", str(profile.bench.get("kind", "?"))),
            *_settings(profile),
            *(
                (f"session {number}", f"{use.frames} frames, {use.frames_sha256[:16]}…")
                for number, use in enumerate(profile.sessions, 1)
            ),
            *((name, version) for name, version in profile.versions.items()),
        ),
    )


def _settings(profile: Profile) -> tuple[tuple[str, str], ...]:
    if profile.bench.get("kind") == "import":
        return (("exposure, aperture, ISO", "unknown: imported"),)
    camera = profile.camera
    return (
        ("exposure", f"{camera.exposure_s:g} s"),
        ("aperture", "–" if camera.aperture is None else f"f/{camera.aperture:g}"),
        ("ISO", "–" if camera.iso is None else str(camera.iso)),
    )
