"""What the page says about a result, gathered and put in words before any markup."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from acquire.remix import Preset, presets
from acquire.report import settings
from acquire.report.exposure_drawing import curve_drawing, gains_drawing
from acquire.report.figures import (
    RGB_LINES,
    Drawing,
    convergence_drawing,
    finite,
    frames_drawing,
    mixing_drawing,
    pca_drawing,
)
from acquire.report.live import Live, layers_read, live_of
from acquire.report.pictures import LARGE_PX, SMALL_PX, reduction
from acquire.report.plates import (
    ComponentPlate,
    MaskPlate,
    PitchPlate,
    WhitePlate,
    component_plate,
    mask_plate,
    measured_pixels,
    pitch_label,
    pitch_plate,
    spread_pitches,
    white_plate,
)
from acquire.report.portraits import PortraitPlate, portrait_plates
from acquire.report.run_drawing import drift_drawing, run_drawing
from acquire.result import Result, ResultRecord
from acquire.session.records import Caution

METHODS = {
    "iva": "independent vector analysis",
    "ranges": "the range over which light travelled",
}


@dataclass(frozen=True, slots=True)
class Drawings:
    """The plots; None where the method has nothing to plot."""

    frames: Drawing | None
    run: Drawing | None
    drift: Drawing | None
    gains: Drawing | None
    curve: Drawing | None
    mixing: Drawing | None
    pca: Drawing | None
    convergence: Drawing | None
    noise_share: float | None


@dataclass(frozen=True, slots=True)
class Redo:
    """Everything needed to do it again."""

    commands: tuple[settings.Command, ...]
    processing: settings.Rows
    capture: settings.Rows
    profiles: settings.Rows
    patterns: tuple[settings.PatternRow, ...]
    source: settings.Rows
    bench: str
    runs: tuple[settings.RunRow, ...]
    incidents: tuple[str, ...]
    versions: tuple[settings.VersionRow, ...]


@dataclass(frozen=True, slots=True)
class Content:
    """All that the template needs; everything in it is text or a picture."""

    title: str
    summary: str
    facts: settings.Rows
    cautions: tuple[Caution, ...]
    warnings: tuple[str, ...]
    notes: tuple[Caution, ...]
    white: WhitePlate
    components: tuple[ComponentPlate, ...]
    pitches: tuple[PitchPlate, ...]
    mask: MaskPlate
    portraits: tuple[PortraitPlate, ...]
    live: Live
    presets: tuple[Preset, ...]
    key: tuple[str, str, str]
    drawings: Drawings
    redo: Redo
    record: ResultRecord
    large_reduction: int
    small_reduction: int


def images_read(record: ResultRecord) -> int:
    """How many times `content_of` tells that it is further."""
    shown = len(record.components) + len(spread_pitches(record.pitches))
    return shown + layers_read(record)


def content_of(result: Result, done: Callable[[], object] = lambda: None) -> Content:
    """Read a result folder once and prepare everything that the page shows.

    Parameters
    ----------
    result
        The result.
    done
        Called `images_read` times.
    """
    record = result.record
    measured = measured_pixels(result)
    white = white_plate(result, measured)
    families = tuple(dict.fromkeys(pitch.family for pitch in record.pitches))
    pitches = []
    for pitch in spread_pitches(record.pitches):
        label = pitch_label(pitch, families)
        pitches.append(pitch_plate(result, pitch, white, measured, label))
        done()
    components = []
    for index in range(len(record.components)):
        components.append(component_plate(result, index, white, measured))
        done()
    notes = record.session.source.notes if record.session.source else ()
    told = {caution.text for caution in record.cautions}
    # Notes of earlier versions were one text without an end.
    told |= {text for note in notes for text in (note.text, note.what, note.what[:-1])}
    return Content(
        title=_title(record),
        summary=_summary(record),
        facts=_facts(record),
        cautions=tuple(caution for caution in record.cautions if caution not in notes),
        warnings=tuple(warning for warning in record.warnings if warning not in told),
        notes=notes,
        white=white,
        components=tuple(components),
        pitches=tuple(pitches),
        mask=mask_plate(result, white.gain),
        portraits=portrait_plates(result),
        live=live_of(result, white.gain, done),
        presets=presets(record.components),
        key=RGB_LINES,
        drawings=_drawings(record, white, tuple(pitches)),
        redo=_redo(record, result.sha256),
        record=record,
        large_reduction=reduction(record.shape, LARGE_PX),
        small_reduction=reduction(record.shape, SMALL_PX),
    )


def _scene(record: ResultRecord) -> str | None:
    simulation = record.session.bench.get("sim")
    scene = simulation.get("scene") if isinstance(simulation, dict) else None
    return scene if isinstance(scene, str) and scene else None


def _title(record: ResultRecord) -> str:
    scene = _scene(record)
    return "The light of a scene, taken apart" if scene is None else f"The light of “{scene}”"


def _summary(record: ResultRecord) -> str:
    patterns = _patterns_in_words(record)
    kind = record.session.bench.get("kind")
    origin = {"sim": "a simulated scene", "lab": "a real scene"}.get(str(kind), "a scene")
    if record.session.source is not None:
        origin = "a scene that others captured"
    parts = _listed(record.components)
    return (
        f"{record.session.frames} frames of {origin} under {patterns}, "
        f"separated into {parts} by {METHODS.get(record.method, record.method)}."
    )


def _patterns_in_words(record: ResultRecord) -> str:
    words: list[str] = []
    for family in dict.fromkeys(pitch.family for pitch in record.pitches):
        own = sorted(pitch.pitch_px for pitch in record.pitches if pitch.family is family)
        many = f"{len(own)} pitches from {own[0]} to {own[-1]} projector pixels"
        one = f"a pitch of {own[0]} projector pixels"
        words.append(f"{family.value} patterns at {one if len(own) == 1 else many}")
    return _listed(words) if words else "uniform light"


def _listed(words: tuple[str, ...] | list[str]) -> str:
    return " and ".join(filter(None, (", ".join(words[:-1]), *words[-1:])))


def _facts(record: ResultRecord) -> settings.Rows:
    height, width = record.shape
    mask = record.mask
    measured = mask.pixels - mask.saturated - mask.unlit
    share = 100 * measured / mask.pixels if mask.pixels else math.nan
    return (
        ("Frames", str(record.session.frames)),
        ("Pitches", str(len(record.pitches))),
        ("Image", f"{width} × {height} px"),
        ("Method", record.method),
        ("Components", str(len(record.components))),
        ("Pixels measured", f"{share:.4g} %"),
    )


def _drawings(record: ResultRecord, white: WhitePlate, pitches: tuple[PitchPlate, ...]) -> Drawings:
    alpha = [value for colour in record.mixing.alpha for row in colour for value in row]
    noise_share = _noise_share(record, white, pitches)
    pca, cost = record.pca_shares, record.convergence
    return Drawings(
        frames=frames_drawing(record.pitches),
        run=None if record.proof is None else run_drawing(record.proof),
        drift=None if record.drift is None else drift_drawing(record.drift),
        gains=None if record.exposures is None else gains_drawing(record.exposures),
        curve=_curve(record),
        mixing=mixing_drawing(record.mixing, record.components) if finite(alpha) else None,
        pca=pca_drawing(pca, len(record.components), noise_share) if finite(pca) else None,
        convergence=convergence_drawing(cost) if finite(cost) else None,
        noise_share=noise_share,
    )


def _curve(record: ResultRecord) -> Drawing | None:
    found = None if record.exposures is None else record.exposures.curve
    return None if found is None or not found.corrected else curve_drawing(found)


def _noise_share(
    record: ResultRecord, white: WhitePlate, pitches: tuple[PitchPlate, ...]
) -> float | None:
    """PCA share of pure noise: its variance over the energy of all rows (those shown stand in)."""
    squares = [white.mean_square, *(pitch.mean_square for pitch in pitches)]
    energy = len(record.pca_shares) * sum(squares) / len(squares)
    if record.noise is None:
        return None
    share = record.noise**2 / energy if energy > 0 else math.nan
    return share if 0 < share < 1 else None


def _redo(record: ResultRecord, record_sha256: str) -> Redo:
    session = record.session
    return Redo(
        commands=settings.commands(record),
        processing=settings.processing_rows(record, record_sha256),
        capture=settings.capture_rows(session),
        profiles=settings.profile_rows(record),
        patterns=settings.pattern_rows(record),
        source=settings.source_rows(session),
        bench=settings.bench_toml(session.bench),
        runs=tuple(settings.run_row(run) for run in session.runs),
        incidents=session.incidents,
        versions=settings.version_rows(record),
    )
