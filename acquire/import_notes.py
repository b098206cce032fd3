"""What a report must say of an imported stack: how it was read and what it cannot show."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from acquire.session import Transfer
from acquire.session.records import Caution
from acquire.table_file import Row, by_pitch
from drivers.media import PICTURE_TYPES
from drivers.picture import JPEG_WHITE
from processing.patterns import Family, untoggled_fraction

EXTREMA = Caution(
    what="Each pitch has two frames, of which one is nowhere darker than the other.",
    meaning="They will be taken for the largest and the smallest value of each pixel over many "
    "shifts. If they are two positions of a pattern, something is wrong with the table or with "
    "what was projected.",
    remedy="Import all frames of every pitch, where they exist.",
)


def import_notes(
    rows: Sequence[Row],
    transfer: Transfer,
    media_type: str,
    dtype: str,
    profile: str | None,
    *,
    extrema: bool,
) -> tuple[Caution, ...]:
    """Notes for the report, most important first.

    Parameters
    ----------
    rows
        The table.
    transfer
        How the numbers were read.
    media_type, dtype, profile
        Kind of the files, type of their values, and their ICC profile's description.
    extrema
        Whether every pitch has two frames, of which one is nowhere darker than the other.
    """
    return (
        *_reading_notes(transfer, media_type, dtype),
        *_profile_notes(transfer, profile),
        *_reference_notes(rows),
        *((EXTREMA,) if extrema else _few_shifts(rows)),
        *_untoggled(rows),
    )


def _reading_notes(transfer: Transfer, media_type: str, dtype: str) -> Iterator[Caution]:
    bits = {"uint8": "8-bit", "uint16": "16-bit"}.get(dtype, "floating-point")
    if transfer is Transfer.SRGB:
        yield Caution(
            what=f"The {bits} pictures were linearised with the sRGB curve (IEC 61966-2-1).",
            meaning="The camera's own curve is unknown, so values are only approximately linear: "
            "shares of light are off by as much as the curves differ.",
            remedy="Use the camera's raw files, if there are any.",
        )
    if transfer is Transfer.LINEAR:
        yield Caution(
            what=f"The {bits} pictures were taken as linear in light, without any curve.",
            meaning="If they have one, shares of light are wrong at every pixel.",
            remedy="If they were encoded for a screen, import them with `--transfer srgb`.",
        )
    if media_type == "image/jpeg":
        yield Caution(
            what="The pictures are JPEG files.",
            meaning="Compression changed the values and hides noise, so that errors are "
            f"underestimated; pixels from code {JPEG_WHITE} of 255 count as saturated.",
            remedy="Use the camera's raw files, if there are any.",
        )
    yield from _saturation_notes(bits, transfer, media_type)
    yield Caution(
        what="The exposures are unknown.",
        meaning="All frames are taken to have the same exposure, gain and light, but for what "
        "`lumisplit process` finds by white, black and complementary patterns; where they have "
        "not, direct and global light are wrong by as much.",
        remedy="Look at how far patterns and complements miss white; fix exposure, gain and white "
        "balance in the next capture.",
    )


def _saturation_notes(bits: str, transfer: Transfer, media_type: str) -> Iterator[Caution]:
    if bits == "floating-point" and transfer is not Transfer.RAW:
        yield Caution(
            what="Floating-point pictures have no white level.",
            meaning="Saturated pixels cannot be told and count as measured.",
            remedy="Leave saturated parts of the picture out of what you conclude.",
        )
    elif media_type in PICTURE_TYPES and media_type != "image/jpeg":
        yield Caution(
            what="Saturation is told by the highest code of the file format only.",
            meaning="Where the camera clips below it, that goes unnoticed and such pixels read "
            "too little light.",
            remedy="See whether the brightest pixels of the white frame all have one value.",
        )


def _profile_notes(transfer: Transfer, profile: str | None) -> Iterator[Caution]:
    if profile is None or (transfer is Transfer.SRGB and "srgb" in profile.lower()):
        return
    linear = transfer is Transfer.LINEAR
    yield Caution(
        what=f'The pictures carry the colour profile "{profile}", which was not applied.',
        meaning="Its curve, if it has one, was not undone: shares of light may be wrong."
        if linear
        else "Its curve may differ from the one that was undone: shares of light are approximate.",
        remedy="If they are not linear, import them with `--transfer srgb`."
        if linear
        else "Convert the pictures to linear TIFF and import these with `--transfer linear`.",
    )


def _reference_notes(rows: Sequence[Row]) -> Iterator[Caution]:
    families = {row.pattern.family for row in rows}
    if Family.WHITE not in families:
        yield Caution(
            what="There is no white frame.",
            meaning="The frames themselves stand in for it, and none of them can be checked "
            "against it.",
            remedy="Capture a white frame with the next stack, at the same settings.",
        )
    if Family.BLACK not in families:
        yield Caution(
            what="There is no black frame.",
            meaning="Light that does not come from the projector stays in and counts as global "
            "light.",
            remedy="Capture a black frame with the next stack, at the same settings.",
        )


def _few_shifts(rows: Sequence[Row]) -> Iterator[Caution]:
    groups = by_pitch(rows)
    if any(len(members) == 2 for members in groups.values()):
        yield Caution(
            what="There are two shifts only at "
            f"{_pitches(key for key, members in groups.items() if len(members) == 2)}.",
            meaning="Noise and the edges of the pattern are not averaged out and are seen in the "
            "direct images.",
            remedy="Take at least four shifts in each direction in which the pattern changes.",
        )


def _untoggled(rows: Sequence[Row]) -> Iterator[Caution]:
    for key, members in by_pitch(rows).items():
        share = untoggled_fraction([row.pattern for row in members]) if key[0].is_binary else 0.0
        if share > 0:
            yield Caution(
                what=f"At {key[0]}, pitch {key[1]}, {share:.1%} of the projector's pixels are "
                "never both lit and dark.",
                meaning="The direct light there reads too low.",
                remedy="Let the shifts cover two pitches down and one to the right.",
            )


def _pitches(groups: Iterator[tuple[Family, int]]) -> str:
    found: dict[str, list[str]] = {}
    for family, pitch_px in groups:
        found.setdefault(family.value, []).append(str(pitch_px))
    return "; ".join(f"{family} {', '.join(pitches)} px" for family, pitches in found.items())
