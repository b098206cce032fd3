"""What the page shows of how sure a result is: intervals, calibrations, frames."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from acquire.profile_file import ProfileSummary, Quantity
from acquire.remix import SATURATED_RGB
from acquire.report.figures import mixing_drawing
from acquire.result import (
    MixingRecord,
    PortraitRecord,
    ProofRecord,
    Result,
    write_record,
    write_tiff,
)
from tests.acquire.report_pages import HOSTILE, page_of
from tests.acquire.result_folders import write_result


def test_intervals_of_mixing_are_drawn_and_said(tmp_path: Path) -> None:
    result = write_result(tmp_path / "r")
    mixing = result.record.mixing
    plain = mixing_drawing(mixing, result.record.components)
    widths: list[list[list[float | None]]] = [
        [[0.05 * k for k in range(3)] for _ in colour] for colour in mixing.alpha
    ]
    widths[0][0][2] = None
    changed = json.loads(mixing.model_dump_json())
    changed |= {"half_width": widths, "interval": "what the bands are"}
    record = MixingRecord.model_validate_json(json.dumps(changed))
    drawn = mixing_drawing(record, result.record.components)
    # Bands are the only see-through areas.
    assert drawn.svg.count(b"fill-opacity: 0.18") >= 9
    assert plain.svg.count(b"fill-opacity: 0.18") == 0
    assert "subsurface from 0.80 ± 0.05 to 0.50 ± 0.05" in drawn.alt
    assert "interreflection from 0.67 to" in drawn.alt
    write_record(result.folder, result.record.model_copy(update={"mixing": record}))
    assert "Bands: what the bands are. Under white" in page_of(Result.open(result.folder)).text


def test_intervals_wider_than_all_light_leave_the_lines_readable(tmp_path: Path) -> None:
    mixing = write_result(tmp_path / "r").record.mixing
    wide = tuple(tuple((0.0, 1e9, 1e9) for _ in colour) for colour in mixing.alpha)
    plain = mixing_drawing(mixing, ("a", "b", "c")).svg
    drawn = mixing_drawing(mixing.model_copy(update={"half_width": wide}), ("a", "b", "c")).svg
    ticks = [text for text in (">0.0<", ">1.0<") if text.encode() in plain]
    assert ticks
    assert all(text.encode() in drawn for text in ticks)


def test_key_figures_of_profiles_are_shown(tmp_path: Path) -> None:
    result = write_result(tmp_path / "r")
    leak = ProfileSummary(
        kind="leak",
        file=f"{HOSTILE}.json",
        page=f"{HOSTILE}.html",
        sha256="ab" * 32,
        measured="2026-01-02T03:04:05+00:00",
        figures={
            "leak": Quantity(
                meaning="b of the projector", unit="of white", value=(0.0123,), uncertainty=(4e-4,)
            ),
            "spread": Quantity(meaning=HOSTILE, unit="", value=(None,), role="residual"),
        },
        warnings=("The room was bright.",),
    )
    lost = ProfileSummary(
        kind="latency", file="latency.json", page="latency.html", sha256="cd" * 32
    )
    record = result.record.model_copy(update={"profiles": (leak, lost)})
    page = page_of(Result(result.folder, record))
    assert "leak 0.0123 ± 0.0004 of white b of the projector" in page.text
    assert "spread residual –" in page.text
    assert "measured 2026-01-02T03:04:05+00:00" in page.text
    assert "ab" * 32 in page.text
    assert "cd" * 32 in page.text
    assert "The room was bright." in page.text
    assert page.text.count(HOSTILE) == 3
    assert "latency.html beside it" in page.text
    # The page is a name, no link: it lies beside the profile, not beside this page.
    assert not [address for address in page.addresses if ".html" in address]


def proof_with(result: Result, **changes: object) -> Result:
    """A result whose capture had one wrong frame of two."""
    (result.folder / "proof").mkdir()
    due = np.full((8, 12, 3), 0.4, np.float32)
    measured = due.copy()
    measured[:, :6] += 0.1
    measured[0, -1] = np.nan
    write_tiff(result.folder / "proof/measured-000005-1.tiff", measured)
    write_tiff(result.folder / "proof/predicted-000005-1.tiff", due)
    worst = PortraitRecord(
        step=5,
        attempt=1,
        pattern="checker:8:0,4",
        verdict=f"does not show {HOSTILE}; it was kept all the same",
        is_right=False,
        how="white, black and its complement, step 23",
        holds=1.0,
        miss=0.123,
        white=0.5,
        light=1.01,
        residual=0.2,
        additivity=-0.02,
        measured="proof/measured-000005-1.tiff",
        predicted="proof/predicted-000005-1.tiff",
        shape=(8, 12),
    )
    alone = worst.model_copy(update={"step": 6, "predicted": None, "miss": None})
    proof = ProofRecord(
        judged=2,
        wrong=1,
        unseen=0,
        retaken=3,
        light=(1.0, 0.98),
        additivity=(None, -0.02),
        moved_px=(0.0, 0.25),
        worst=(worst, alone),
    )
    changed = result.record.model_copy(update={"proof": proof.model_copy(update=changes)})
    return Result(result.folder, changed)


def test_worst_frames_are_shown_with_their_difference(tmp_path: Path) -> None:
    page = page_of(proof_with(write_result(tmp_path / "r")))
    assert "step 5, checker:8:0,4, attempt 2 does not show" in page.text
    assert HOSTILE in page.text
    assert "12.30% of white" in page.text
    assert "part of the contrast left over 20.00%" in page.text
    taken = page.pixels("step 5, checker:8:0,4, attempt 2 as it was taken.")
    due = page.pixels("What step 5, checker:8:0,4, attempt 2 should show.")
    # White, 0.5, has full brightness: 0.4 and 0.5 of it are 0.8 and 1.
    assert (due == np.rint(255 * (1.055 * 0.8 ** (1 / 2.4) - 0.055))).all()
    assert (taken[:, :6] == 255).all()
    assert (taken[0, -1] == SATURATED_RGB).all()
    miss = page.pixels("step 5, checker:8:0,4, attempt 2 less what it should show.")
    # A fifth of white, 0.1, is brightest orange; no difference is white; unknown is black.
    assert (miss[:, :6] == (0xE6, 0x9F, 0x00)).all()
    assert (miss[1:, 6:] == 255).all()
    assert (miss[0, -1] == 0).all()
    # Of the other nothing is predicted.
    assert len([alt for alt in page.images if "step 6" in alt]) == 1


def test_the_run_is_drawn_as_far_as_it_was_judged(tmp_path: Path) -> None:
    result = proof_with(write_result(tmp_path / "r"))
    (alt,) = (alt for alt in page_of(result).images if alt.startswith("Light of 2 frames"))
    assert "moved by up to 0.25 camera pixels" in alt
    assert result.record.proof is not None
    nothing = {"light": (), "additivity": (), "moved_px": (), "worst": ()}
    bare = result.record.model_copy(
        update={"proof": result.record.proof.model_copy(update=nothing)}
    )
    page = page_of(Result(result.folder, bare))
    assert not [alt for alt in page.images if alt.startswith("Light of")]
    assert "keeps no pictures of single frames" in page.text


def test_pitches_tell_the_proof_of_their_frames(tmp_path: Path) -> None:
    result = write_result(tmp_path / "r")
    pitches = tuple(
        pitch.model_copy(update={"proven": 36 - k, "residual": 0.01 * k, "additivity_error": None})
        for k, pitch in enumerate(result.record.pitches)
    )
    page = page_of(Result(result.folder, result.record.model_copy(update={"pitches": pitches})))
    assert "8 px 36 of 36 0 % – 16 px 35 of 36 1 % – 32 px 34 of 36 2 % –" in page.text.replace(
        "\u202f", " "
    )
