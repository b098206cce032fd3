"""The page: nothing outside it, nothing injected, and the numbers are those of the result."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import tomllib
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from playwright.sync_api import Playwright
from pydantic import JsonValue, ValidationError

from acquire.remix import SATURATED_RGB
from acquire.report import write_report
from acquire.report.page import percent
from acquire.report.pictures import UNLIT_RGB
from acquire.report.plates import spread_pitches
from acquire.report.settings import bench_toml, commands, run_row
from acquire.result import PixelClass, ProofRecord, Result, write_tiff
from acquire.session.records import Caution, RunRecord, SourceRecord, Transfer
from acquire.tone import encode
from processing.patterns import Family
from tests.acquire.browsers import opened
from tests.acquire.report_pages import HOSTILE, Page, page_of, said
from tests.acquire.result_folders import SIM, write_result

IMPORTED = SourceRecord(
    table=f"{HOSTILE}.csv", table_sha256="1" * 64, transfer=Transfer.SRGB, notes=(HOSTILE,)
)


def test_page_refers_to_nothing_outside_itself(tmp_path: Path) -> None:
    text = write_report(write_result(tmp_path / "r")).read_text("utf-8")
    page = Page(text)
    assert page.addresses
    assert all(address.startswith(("data:image/", "#")) for address in page.addresses)
    assert "url(" not in text
    assert "@import" not in text
    assert page.csp.startswith("default-src 'none'; img-src data:; style-src 'unsafe-inline'")
    assert re.search("; script-src 'sha256-[A-Za-z0-9+/]{43}='; ", page.csp)
    assert page.tags.count("h1") == 1


def test_drawings_are_well_formed_and_refer_to_nothing_outside(tmp_path: Path) -> None:
    page = page_of(write_result(tmp_path / "r"))
    drawings = [uri for uri in page.images.values() if uri.startswith("data:image/svg+xml")]
    assert len(drawings) == 3
    for uri in drawings:
        # The text is our own drawing, made a moment ago.
        root = ET.fromstring(base64.b64decode(uri.partition(",")[2]))  # noqa: S314
        names = {name for node in root.iter() for name in node.attrib if name.endswith("href")}
        links = [node.get(name) for node in root.iter() for name in names if node.get(name)]
        assert all(link is not None and link.startswith("#") for link in links)


def test_text_of_strangers_stays_text(tmp_path: Path) -> None:
    result = write_result(
        tmp_path / "r",
        bench={"kind": HOSTILE, "sim": {"scene": HOSTILE, HOSTILE: [HOSTILE]}},
        options={HOSTILE: {"deep": HOSTILE}, "n_iterations": HOSTILE},
        source=IMPORTED,
        runs=(RunRecord(started_s=1e300, first_step=0, outcome="failed", reason=HOSTILE),),
        warnings=(HOSTILE,),
        method=HOSTILE,
        versions={HOSTILE: HOSTILE},
    )
    page = page_of(result)
    # Ours, which the policy knows by its digest, and data.
    assert page.scripts.count("") == 1
    assert set(page.scripts) == {"", "application/json", "application/octet-stream"}
    assert page.handlers == []
    assert all(address.startswith("data:image/") for address in page.addresses)
    assert page.text.count("<script>alert('x')</script>") >= 10


def test_same_result_gives_the_same_bytes(tmp_path: Path) -> None:
    first = write_report(write_result(tmp_path / "one")).read_bytes()
    second = write_report(write_result(tmp_path / "two")).read_bytes()
    assert first == second


@pytest.mark.parametrize(
    "names",
    [("direct",), ("direct", "interreflection"), tuple(f"component-{k}" for k in range(1, 5))],
    ids=["one", "two", "four"],
)
def test_every_component_has_its_name_and_share(tmp_path: Path, names: tuple[str, ...]) -> None:
    page = page_of(write_result(tmp_path / "r", names=names))
    total = sum(range(1, len(names) + 1))
    for index, name in enumerate(names):
        assert f"{name} {said((index + 1) / total)}" in page.text
        assert f"{name}, exposed like the white picture." in page.images


def test_pictures_share_the_exposure_of_the_white_one(tmp_path: Path) -> None:
    result = write_result(tmp_path / "r", names=("direct", "interreflection"))
    page = page_of(result)
    gain = 1 / np.percentile(result.white, 99.5)
    for alt, image in (
        ("The scene under white light.", result.white),
        ("interreflection, exposed like the white picture.", result.component("interreflection")),
        ("Direct light at 8 px.", 0.6 * result.white),
    ):
        expected = encode(image.astype(np.float64) * gain).astype(int)
        assert np.abs(page.pixels(alt) - expected).max() <= 1
    assert f"×{gain:.3g}" in page.text
    assert "shown ×1.5" in page.text  # 2/3 of the light needs 3/2 of the exposure


@pytest.mark.parametrize(
    ("pixel_class", "words", "colour"),
    [
        (PixelClass.SATURATED, "saturated 192 25.0 %", SATURATED_RGB),
        (PixelClass.UNLIT, "unlit 192 25.0 %", UNLIT_RGB),
    ],
    ids=["saturated", "unlit"],
)
def test_masked_quarter_is_counted_and_coloured(
    tmp_path: Path, pixel_class: PixelClass, words: str, colour: np.ndarray[tuple[int, ...]]
) -> None:
    page = page_of(write_result(tmp_path / "r", pixel_class=pixel_class))
    assert words in page.text
    (alt,) = (alt for alt in page.images if alt.startswith("The scene in grey"))
    marked = (page.pixels(alt) == colour).all(axis=2)
    assert marked[:12, :16].all()
    assert marked.sum() == 192
    # Neither class enters the shares: three components, 1/6 + 2/6 + 3/6.
    assert f"interreflection {said(0.5)}" in page.text


def test_result_without_a_measured_pixel_still_has_a_page(tmp_path: Path) -> None:
    result = write_result(tmp_path / "r", shape=(1, 1))
    nothing = np.full((1, 1, 3), np.nan, np.float32)
    for path in result.folder.rglob("*.tiff"):
        write_tiff(path, nothing)
    write_tiff(result.folder / "mask.tiff", np.full((1, 1), PixelClass.SATURATED, np.uint8))
    page = page_of(result)
    assert "direct –" in page.text
    assert tuple(page.pixels("The scene under white light.")[0, 0]) == tuple(SATURATED_RGB)


def test_two_families_are_told_apart(tmp_path: Path) -> None:
    families = (Family.STRIPES_COLUMNS, Family.STRIPES_ROWS)
    page = page_of(write_result(tmp_path / "r", families=families))
    for family in families:
        for pitch_px in (8, 32):
            assert f"Direct light at {family.value}, {pitch_px} px." in page.images
    assert "6 of 6 pitches" in page.text


def test_pitches_spread_from_the_finest_to_the_coarsest(tmp_path: Path) -> None:
    result = write_result(tmp_path / "r", pitches_px=(96, 8, *range(12, 96, 4)))
    shown = [pitch.pitch_px for pitch in spread_pitches(result.record.pitches)]
    assert len(shown) == 6
    assert shown == sorted(shown)
    assert (shown[0], shown[-1]) == (8, 96)


def test_negative_light_is_said_and_shown(tmp_path: Path) -> None:
    result = write_result(tmp_path / "r", names=("direct", "interreflection"))
    image = result.component("interreflection").copy()
    image[:, :16] *= -1
    write_tiff(result.folder / "components/interreflection.tiff", image)
    page = page_of(result)
    assert "Where components are negative" in page.text
    assert "50.0 %" in page.text
    colours = page.pixels("interreflection: orange positive, blue negative.").astype(int)
    bluer = colours[..., 2] > colours[..., 0]
    assert bluer[:, :16].all()
    assert not bluer[:, 16:].any()


def test_no_negative_light_no_map_of_it(tmp_path: Path) -> None:
    assert "Where components are negative" not in page_of(write_result(tmp_path / "r")).text


def test_warnings_are_counted_before_the_pictures_and_notes_are_no_warnings(tmp_path: Path) -> None:
    source = SourceRecord(
        table="t.csv", table_sha256="1" * 64, transfer=Transfer.SRGB, notes=("8-bit pictures.",)
    )
    result = write_result(
        tmp_path / "r", source=source, warnings=("8-bit pictures.", "The lamp drifted.")
    )
    text = write_report(result).read_text("utf-8")
    assert text.index('<a href="#warnings">1 warning:') < text.index("<img")
    assert text.count("The lamp drifted.") == 1
    assert text.count("8-bit pictures.") == 1
    # Such sessions were written before notes had their parts.
    assert "What that means was not written down" in text


def test_a_caution_is_shown_in_its_three_parts_and_once(tmp_path: Path) -> None:
    caution = Caution(what="The lamp drifted.", meaning="Light is off.", remedy="Let it warm up.")
    result = write_result(tmp_path / "r", warnings=(caution.text, "Old words."))
    record = result.record.model_copy(update={"cautions": (caution,)})
    page = page_of(Result(result.folder, record))
    assert "2 warnings" in page.text
    assert "The lamp drifted. Means Light is off. Do Let it warm up. Old words." in page.text
    assert page.text.count("The lamp drifted.") == 1


@pytest.mark.parametrize("missing", ["what", "meaning", "remedy"])
@pytest.mark.parametrize("text", ["", "no end", " A blank before."])
def test_a_caution_without_one_of_its_parts_cannot_be(missing: str, text: str) -> None:
    parts = {"what": "A.", "meaning": "B.", "remedy": "C."}
    assert Caution(**parts).text == "A. B. C."
    with pytest.raises(ValidationError):
        Caution(**(parts | {missing: text}))


def test_results_from_before_cautions_and_proof_can_be_read(tmp_path: Path) -> None:
    result = write_result(tmp_path / "r", warnings=("The lamp drifted.",))
    fields = json.loads((result.folder / "result.json").read_text())
    for name in ("cautions", "proof"):
        del fields[name]
    for pitch in fields["pitches"]:
        del pitch["proven"]
    (result.folder / "result.json").write_text(json.dumps(fields))
    assert "The lamp drifted." in page_of(Result.open(result.folder)).text


def test_proof_is_counted_and_drawn(tmp_path: Path) -> None:
    result = write_result(tmp_path / "r")
    pitches = tuple(
        pitch.model_copy(update={"proven": 36 - k}) for k, pitch in enumerate(result.record.pitches)
    )
    proof = ProofRecord(
        judged=110, wrong=1, unseen=2, retaken=5, light=(1.0, 1.01, None), additivity=(None, -0.02)
    )
    record = result.record.model_copy(update={"proof": proof, "pitches": pitches})
    page = page_of(Result(result.folder, record))
    assert "107 show their own pattern, 1 do not, 2 are too faint to be told; 5 were" in page.text
    assert "105 of 108; not all at 16 px (35 of 36), 32 px (34 of 36); hollow" in page.text
    (alt,) = (alt for alt in page.images if alt.startswith("Light of 2 frames"))
    assert "+0.00 % to +1.00 %" in alt
    assert "white by -2.00 % to -2.00 %" in alt


def test_profiles_of_earlier_versions_are_named_with_their_digests(tmp_path: Path) -> None:
    options: dict[str, JsonValue] = {"profiles": {"noise": "ab" * 32}}
    page = page_of(write_result(tmp_path / "r", options=options))
    assert f"Calibration profiles, by digest noise {'ab' * 32}" in page.text


def test_a_page_without_warnings_says_so(tmp_path: Path) -> None:
    assert "No warnings" in page_of(write_result(tmp_path / "r")).text


def test_commands_repeat_the_options(tmp_path: Path) -> None:
    options: dict[str, JsonValue] = {
        "n_components": 3,
        "n_iterations": 25,
        "smoothing_px": None,
        "leak": 0.02,
    }
    result = write_result(tmp_path / "r", options=options)
    lines = [command.line for command in commands(result.record)]
    assert lines[0] == "lumisplit capture PLAN.toml --out SESSION --bench BENCH.toml"
    assert (
        "lumisplit process SESSION --out RESULT --method iva --components 3 --iterations 25 "
        "--leak 0.02"
    ) in lines


def test_command_quotes_the_name_of_a_table(tmp_path: Path) -> None:
    source = SourceRecord(table="a; b.csv", table_sha256="1" * 64, transfer=Transfer.LINEAR)
    first = commands(write_result(tmp_path / "r", source=source).record)[0]
    assert first.line == "lumisplit import 'a; b.csv' --transfer linear --out SESSION"


def test_bench_reads_back_as_toml() -> None:
    bench: dict[str, JsonValue] = {
        "kind": "sim",
        "sim": {"scene": 'a "b"\n', "camera_px": [96, 128], "an odd key": 0.5},
    }
    assert tomllib.loads(bench_toml(bench)) == bench
    assert tomllib.loads(bench_toml(SIM)) == {"kind": "sim", "sim": {"scene": "corner", "seed": 7}}


@pytest.mark.parametrize(
    ("started_s", "expected"),
    [(1.7e9, "2023-11-14 22:13:20 UTC"), (1e300, "1e+300 s after 1970-01-01 UTC")],
    ids=["a date", "no date of this world"],
)
def test_start_of_a_run(started_s: float, expected: str) -> None:
    assert run_row(RunRecord(started_s=started_s, first_step=0)).started == expected


def test_every_version_and_digest_is_on_the_page(tmp_path: Path) -> None:
    result = write_result(tmp_path / "r")
    page = page_of(result)
    assert "lumisplit 0.1.0 0.2.0" in page.text
    assert "rawpy 0.24.1 –" in page.text
    assert hashlib.sha256((result.folder / "result.json").read_bytes()).hexdigest() in page.text
    assert result.record.plan_sha256 in page.text


@pytest.mark.parametrize(
    ("fraction", "expected"),
    [(1.0, "100.0"), (0.123, "12.3"), (-0.0032, "−0.32"), (1.5e-7, "0.000015"), (0, "0")],
)
def test_percent(fraction: float, expected: str) -> None:
    assert percent(fraction) == f"{expected}\u202f%"


@pytest.mark.browser
def test_page_in_a_browser(tmp_path: Path, playwright: Playwright, chromium: str) -> None:
    families = (Family.STRIPES_COLUMNS, Family.STRIPES_ROWS)
    result = write_result(
        tmp_path / "r",
        names=tuple(f"component-{k}" for k in range(1, 5)),
        families=families,
        pixel_class=PixelClass.SATURATED,
        source=IMPORTED,
        warnings=(HOSTILE, "w" * 300),
    )
    uri = write_report(result).as_uri()
    with opened(playwright, chromium, uri) as visit:
        for width_px in (1280, 400):
            visit.page.set_viewport_size({"width": width_px, "height": 800})
            assert visit.page.evaluate("document.documentElement.scrollWidth") <= width_px
        broken = "[...document.images].filter(image => !image.complete || !image.naturalWidth)"
        assert visit.page.evaluate("document.images.length") > 20
        assert visit.page.evaluate(f"{broken}.map(image => image.alt)") == []
        assert visit.complaints == []
        assert {a for a in visit.requested if not re.match("data:image/", a)} == {uri}


def test_notes_of_an_import_are_shown_in_their_parts_and_are_no_warnings(tmp_path: Path) -> None:
    note = Caution(what="No black frame.", meaning="Light stays in.", remedy="Take one.")
    source = SourceRecord(
        table="t.csv", table_sha256="1" * 64, transfer=Transfer.LINEAR, notes=(note,)
    )
    result = write_result(tmp_path / "r", source=source, warnings=(note.text,))
    record = result.record.model_copy(update={"cautions": (note,)})
    page = page_of(Result(result.folder, record))
    assert "About the frames No black frame. Means Light stays in. Do Take one." in page.text
    assert page.text.count("No black frame.") == 1
    assert "No warnings" in page.text
