"""What a report must say of an imported stack: how it was read and what it cannot show."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from acquire.session import Transfer
from acquire.table_file import Row, by_pitch
from drivers.media import PICTURE_TYPES
from drivers.picture import JPEG_WHITE
from processing.patterns import Family, untoggled_fraction


def import_notes(
    rows: Sequence[Row], transfer: Transfer, media_type: str, dtype: str, profile: str | None
) -> tuple[str, ...]:
    """Notes for the report, most important first.

    Parameters
    ----------
    rows
        The table.
    transfer
        How the numbers were read.
    media_type, dtype, profile
        Kind of the files, type of their values, and their ICC profile's description.
    """
    return (
        *_reading_notes(transfer, media_type, dtype),
        *_profile_notes(transfer, profile),
        *_reference_notes(rows),
        *_shift_notes(rows),
    )


def _reading_notes(transfer: Transfer, media_type: str, dtype: str) -> Iterator[str]:
    bits = {"uint8": "8-bit", "uint16": "16-bit"}.get(dtype, "floating-point")
    if transfer is Transfer.SRGB:
        yield (
            f"{bits} pictures were linearised with the sRGB curve (IEC 61966-2-1); the camera's "
            "own curve is unknown, so values are only approximately linear"
        )
    if transfer is Transfer.LINEAR:
        yield f"{bits} pictures were taken as linear in light, without any curve"
    if media_type == "image/jpeg":
        yield (
            "JPEG compression changed the values and hides noise; pixels from code "
            f"{JPEG_WHITE} of 255 count as saturated"
        )
    if bits == "floating-point" and transfer is not Transfer.RAW:
        yield "floating-point pictures have no white level: saturated pixels cannot be told"
    elif media_type in PICTURE_TYPES and media_type != "image/jpeg":
        yield (
            "saturation is told by the highest code of the file format only; a camera that clips "
            "below it goes unnoticed"
        )
    yield "exposures are unknown; all frames are taken to have the same exposure, gain and light"


def _profile_notes(transfer: Transfer, profile: str | None) -> Iterator[str]:
    if profile is None or (transfer is Transfer.SRGB and "srgb" in profile.lower()):
        return
    advice = (
        "; if they are not linear, import them with --transfer srgb"
        if transfer is Transfer.LINEAR
        else ""
    )
    yield f'the pictures carry the colour profile "{profile}", which was not applied{advice}'


def _reference_notes(rows: Sequence[Row]) -> Iterator[str]:
    families = {row.pattern.family for row in rows}
    if Family.WHITE not in families:
        yield "there is no white frame; the maximum over the shifts stands in for it"
    if Family.BLACK not in families:
        yield "there is no black frame; light that does not come from the projector stays in"


def _shift_notes(rows: Sequence[Row]) -> Iterator[str]:
    groups = by_pitch(rows)
    if any(len(members) == 2 for members in groups.values()):
        yield (
            "two shifts only at "
            f"{_pitches(key for key, members in groups.items() if len(members) == 2)}; noise and "
            "the edges of the pattern are not averaged out"
        )
    for key, members in groups.items():
        share = untoggled_fraction([row.pattern for row in members]) if key[0].is_binary else 0.0
        if share > 0:
            yield (
                f"{key[0]} at pitch {key[1]}: {share:.1%} of the projector's pixels are never "
                "both lit and dark; the direct light there reads too low"
            )


def _pitches(groups: Iterator[tuple[Family, int]]) -> str:
    found: dict[str, list[str]] = {}
    for family, pitch_px in groups:
        found.setdefault(family.value, []).append(str(pitch_px))
    return "; ".join(f"{family} {', '.join(pitches)} px" for family, pitches in found.items())
