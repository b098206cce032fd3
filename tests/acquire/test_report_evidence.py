"""What the page shows of how sure a result is: intervals, calibrations, frames."""

from __future__ import annotations

import json
from pathlib import Path

from acquire.profile_file import ProfileSummary, Quantity
from acquire.report.figures import mixing_drawing
from acquire.result import MixingRecord, Result, write_record
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
