"""The mix in a file is the sum that was asked for, and says so."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image
from typer.testing import CliRunner

from acquire.cli.main import app
from acquire.errors import ResultError
from acquire.remix import SATURATED_RGB, gains_for, mix, mixed_rows, presets, write_mix
from acquire.result import PixelClass, Result, write_tiff
from acquire.tone import Tone, encode
from tests.acquire.result_folders import write_result

ALL = ("direct", "subsurface", "interreflection")
BLIND = ("component-1", "component-2")


def signed_result(folder: Path, shape: tuple[int, int] = (24, 32)) -> Result:
    """Components of both signs, a quarter of the pixels saturated."""
    result = write_result(folder, shape=shape, pixel_class=PixelClass.SATURATED)
    chance = np.random.default_rng(5)
    for name in result.record.components:
        image = chance.normal(0.1, 0.3, (*shape, 3)).astype(np.float32)
        image[np.isnan(result.white)] = np.nan
        write_tiff(result.folder / f"components/{name}.tiff", image)
    return result


@pytest.mark.parametrize("shape", [(24, 32), (1, 1), (1500, 700)], ids=["one strip", "1", "three"])
def test_tiff_is_the_sum_of_gains_times_components(tmp_path: Path, shape: tuple[int, int]) -> None:
    result = signed_result(tmp_path / "r", shape)
    gains = (1.0, 0.4, -2.5)
    write_mix(result, gains, tmp_path / "mix.tiff", 0, Tone.SRGB)
    expected = sum(
        np.float64(gain) * result.component(name) for gain, name in zip(gains, ALL, strict=True)
    )
    read = tifffile.imread(tmp_path / "mix.tiff")
    assert read.dtype == np.float32
    assert np.array_equal(read, np.asarray(expected, np.float32), equal_nan=True)


def test_tiff_says_what_it_is(tmp_path: Path) -> None:
    result = write_result(tmp_path / "r")
    write_mix(result, (1, 0.4, 0), tmp_path / "mix.tiff", 0, Tone.SRGB)
    with tifffile.TiffFile(tmp_path / "mix.tiff") as file:
        said = json.loads(file.pages.first.description)
    assert said["gains"] == {"direct": 1, "subsurface": 0.4, "interreflection": 0}
    assert said["color_space"].startswith("linear RGB of the camera")
    assert said["result_sha256"] == result.sha256


@pytest.mark.parametrize("tone", Tone)
def test_png_is_the_mix_through_the_curve_it_states(tmp_path: Path, tone: Tone) -> None:
    result = signed_result(tmp_path / "r")
    write_mix(result, (1, 2, 0.5), tmp_path / "mix.png", 1.5, tone)
    picture = Image.open(tmp_path / "mix.png")
    picture.load()
    said = json.loads(picture.text["Description"])  # type: ignore[attr-defined] # of PNG files
    assert ("16" in said["curve"]) is (tone is Tone.SOFT)
    gain = 2**1.5 / np.nanpercentile(result.white, 99.5)
    assert said["display_gain"] == pytest.approx(gain)
    light = mix([result.component(name) for name in ALL], (1, 2, 0.5)) * gain
    pixels = np.asarray(picture)
    known = np.isfinite(light).all(axis=2)
    assert (pixels[~known] == SATURATED_RGB).all()
    assert 0 < known.sum() < known.size
    assert np.array_equal(pixels[known], encode(light[known], tone))


@pytest.mark.parametrize(
    ("linear", "encoded"),
    # 4 → 1; 1 → (1 + 1/16)/2 = 0.53125, of which sRGB makes 192.6.
    [(-1.0, 0), (0.0, 0), (1.0, 193), (4.0, 255), (99.0, 255)],
)
def test_soft_curve(linear: float, encoded: int) -> None:
    assert encode(np.array([linear]), Tone.SOFT)[0] == encoded


def test_sum_of_unlike_numbers_is_refused() -> None:
    with pytest.raises(ValueError, match="1 components and 2 gains"):
        mix([np.zeros((2, 2, 3))], (1, 1))


@pytest.mark.parametrize(
    ("names", "offered"),
    [
        (ALL, ["as-captured", "direct-only", "no-interreflection", "scattering-x2"]),
        (("direct", "interreflection"), ["as-captured", "direct-only", "no-interreflection"]),
        (BLIND, ["as-captured"]),
    ],
    ids=["three", "nothing scatters", "unnamed"],
)
def test_presets_need_their_components(names: tuple[str, ...], offered: list[str]) -> None:
    assert [preset.name for preset in presets(names)] == offered


@pytest.mark.parametrize(
    ("preset", "given", "gains"),
    [
        (None, {"direct": 1, "subsurface": 0.4}, (1, 0.4, 0)),
        ("as-captured", {}, (1, 1, 1)),
        ("direct-only", {}, (1, 0, 0)),
        ("no-interreflection", {}, (1, 1, 0)),
        ("scattering-x2", {"direct": 0.5}, (0.5, 2, 1)),
    ],
)
def test_gains(preset: str | None, given: dict[str, float], gains: tuple[float, ...]) -> None:
    assert gains_for(ALL, preset, given) == gains


@pytest.mark.parametrize(
    ("preset", "given", "reason"),
    [
        (None, {}, "Nothing to mix"),
        (None, {"glow": 1}, "No component 'glow' in this result; there are direct, subsurface"),
        ("scattering", {}, "No preset 'scattering' for this result; there are as-captured"),
        (None, {"direct": math.nan}, "finite"),
    ],
)
def test_what_cannot_be_mixed(preset: str | None, given: dict[str, float], reason: str) -> None:
    with pytest.raises(ResultError, match=reason):
        gains_for(ALL, preset, given)


@pytest.mark.parametrize(
    ("out", "reason"),
    [
        ("mix.jpg", "suffix"),
        ("r/components/direct.tiff", "inside the result"),
        ("nowhere/mix.tiff", "No such file"),
    ],
)
def test_where_a_mix_cannot_go(tmp_path: Path, out: str, reason: str) -> None:
    result = write_result(tmp_path / "r")
    before = result.component("direct")
    run = CliRunner().invoke(
        app, ["remix", str(result.folder), "--preset", "direct-only", "--out", str(tmp_path / out)]
    )
    assert reason in str(run.exception)
    assert np.array_equal(result.component("direct"), before)
    assert not list(tmp_path.rglob(".part-*"))


def test_damaged_component_leaves_no_half_file(tmp_path: Path) -> None:
    result = write_result(tmp_path / "r")
    (result.folder / "components/subsurface.tiff").write_bytes(b"II*\0")
    with pytest.raises(ResultError, match="Process the session again"):
        write_mix(result, (1, 1, 1), tmp_path / "mix.tiff", 0, Tone.SRGB)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["r"]


def test_rows_do_not_hold_the_picture(tmp_path: Path) -> None:
    result = write_result(tmp_path / "r", shape=(1500, 700))
    assert max(len(rows) for rows in mixed_rows(result, (1, 1, 1))) <= 750


@pytest.mark.parametrize(
    ("words", "status", "said"),
    [
        (["--gain", "direct=1", "--gain", "subsurface=0.4"], 0, "1 × direct + 0.4 × subsurface"),
        (["--gain", "direct:1"], 2, "COMPONENT=NUMBER"),
        (["--gain", "direct=1", "--gain", "direct=2"], 2, "two gains"),
    ],
)
def test_command(tmp_path: Path, words: list[str], status: int, said: str) -> None:
    result = write_result(tmp_path / "r")
    out = tmp_path / "mix.tiff"
    run = CliRunner().invoke(app, ["remix", str(result.folder), *words, "--out", str(out)])
    assert run.exit_code == status
    assert said in " ".join(run.output.replace("│", " ").split())
    assert out.exists() is (status == 0)
