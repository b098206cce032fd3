from __future__ import annotations

import shutil
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
import tifffile

from acquire.errors import LumisplitError, ResultError, StackError
from acquire.evaluation import evaluate, read_truth
from acquire.frames import Frames
from acquire.pipeline import INTERPOLATED, Options, process
from acquire.report.settings import commands
from acquire.result import Result
from acquire.session import Session
from acquire.stack import Stack
from acquire.table import import_table
from drivers.image import Demosaic
from processing.metrics import relative_error
from processing.patterns import Family
from tests.acquire.captures import captured, small_bench, small_plan

PLAN = small_plan("[pattern]\npitch_px = [8, 12, 16, 24]\n")
IVA = Options(method="iva")
SHARP = {"camera_px": (32, 40), "projector_px": (96, 128)}
NOISY = {**SHARP, "full_well_e": 20000.0}


@dataclass
class Silent:
    stages: list[tuple[str, int]] = field(default_factory=list)
    units: int = 0

    def stage(self, name: str, total: int) -> None:
        self.stages.append((name, total))

    def advance(self) -> None:
        self.units += 1


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Session:
    """Frames without noise; to be read only."""
    folder = tmp_path_factory.mktemp("sound") / "s"
    return captured(folder, PLAN, small_bench(**SHARP))[0]


@pytest.fixture(scope="module")
def unmixed(sound: Session, tmp_path_factory: pytest.TempPathFactory) -> Result:
    """The sound frames' components by AuxIVA; to be read only."""
    return process(sound, tmp_path_factory.mktemp("unmixed") / "r", IVA, Silent())


@pytest.fixture(scope="module")
def noisy(tmp_path_factory: pytest.TempPathFactory) -> Session:
    """To be read only."""
    folder = tmp_path_factory.mktemp("noisy") / "s"
    return captured(folder, PLAN, small_bench(**NOISY))[0]


@pytest.fixture(scope="module")
def by_default(noisy: Session, tmp_path_factory: pytest.TempPathFactory) -> Result:
    """The noisy frames' result by the default method; to be read only."""
    return process(noisy, tmp_path_factory.mktemp("default") / "r", Options(), Silent())


def processed(tmp_path: Path, **changes: object) -> Result:
    session, _ = captured(tmp_path / "s", PLAN, small_bench(**{**SHARP, **changes}))
    return process(session, tmp_path / "r", IVA, Silent())


def test_direct_and_global_add_up_to_white_less_black(tmp_path: Path) -> None:
    result = processed(tmp_path, ambient=0.05, black_level=0.02)
    for pitch in result.record.pitches:
        both = result.pitch_image(pitch.direct) + result.pitch_image(pitch.global_)
        np.testing.assert_allclose(both, result.white, atol=1e-6)


def test_white_is_the_truth_to_the_steps_of_the_sensor(sound: Session, unmixed: Result) -> None:
    truth = read_truth(sound.folder / "truth.npz", unmixed.record.shape)
    step = 1 / (16383 - 512)
    assert np.abs(unmixed.white - sum(truth.values())).max() <= step


@pytest.mark.parametrize("method", ["ranges", "iva"])
def test_every_frame_is_counted(sound: Session, tmp_path: Path, method: str) -> None:
    observer = Silent()
    process(sound, tmp_path / "r", Options(method), observer)
    assert observer.stages == [
        ("separating", len(PLAN)),
        ("correcting", 4),
        ("decomposing", 50),
        ("looking back", 6),
    ]
    assert observer.units == len(PLAN) + 4 + 50 + 6


def test_demosaiced_frames_have_a_pixel_for_each_photosite(
    sound: Session, unmixed: Result, tmp_path: Path
) -> None:
    measured = unmixed
    options = Options("iva", demosaic=Demosaic.BILINEAR)
    full = process(sound, tmp_path / "full", options, Silent())
    assert full.record.shape == (64, 80)
    # Red and blue lie at opposite corners of an RGGB quad, and are what the superpixels have.
    np.testing.assert_array_equal(full.white[::2, ::2, 0], measured.white[..., 0])
    np.testing.assert_array_equal(full.white[1::2, 1::2, 2], measured.white[..., 2])
    assert full.record.options["demosaic"] == "bilinear"
    assert measured.record.options["demosaic"] == "superpixel"
    assert INTERPOLATED in full.record.cautions
    assert INTERPOLATED.text in full.record.warnings
    assert INTERPOLATED not in measured.record.cautions
    assert any("--demosaic bilinear" in command.line for command in commands(full.record))


def test_processing_twice_gives_the_same_bytes(
    noisy: Session, by_default: Result, tmp_path: Path
) -> None:
    again = process(noisy, tmp_path / "r", Options(), Silent())
    contents = []
    for folder in (by_default.folder, again.folder):
        paths = sorted(path for path in folder.rglob("*") if path.is_file())
        contents.append({path.relative_to(folder): path.read_bytes() for path in paths})
    assert contents[0] == contents[1]


def test_corrected_light_and_its_error_cover_what_a_camera_without_noise_reads(
    tmp_path: Path,
) -> None:
    """With nothing given but the session itself.

    0.68 ± 0.03 is promised for patterns that are what they should be. Here light that travelled
    about a pitch tilts the plateaus of the pattern, how much so is measured in the neighbourhood
    only, and the promise is known to fail: scenes were measured between 0.61 and 0.73
    (`benchmarks.single_pitch_coverage`). Beyond that range something broke.
    """
    plan = small_plan("[pattern]\npitch_px = [8, 24]\n")
    size = {"camera_px": (72, 96), "projector_px": (216, 288)}
    results = []
    sensor = {"full_well_e": 20_000.0, "read_noise_e": 5.0}
    for name, defects in (("clean", {}), ("noisy", sensor)):
        session, _ = captured(tmp_path / name, plan, small_bench(**size, **defects))
        results.append(process(session, tmp_path / f"{name}-r", IVA, Silent()))
    clean, noisy = results
    usable = (clean.mask == 0) & (noisy.mask == 0)
    for truth, pitch in zip(clean.record.pitches, noisy.record.pitches, strict=True):
        assert pitch.corrected is not None
        assert pitch.deviation is not None
        true = clean.pitch_image(truth.direct)[usable]
        error = noisy.pitch_image(pitch.corrected)[usable] - true
        deviation = noisy.pitch_image(pitch.deviation)[usable]
        assert np.mean(np.abs(error) <= deviation) == pytest.approx(0.68, abs=0.1)
        plain = noisy.pitch_image(pitch.direct)[usable] - true
        assert np.linalg.norm(error) < np.linalg.norm(plain)
    noise = noisy.record.frame_noise
    assert noise is not None
    # 14 bits of 20 000 electrons; the green of a superpixel is the mean of two.
    np.testing.assert_allclose(noise.slope, [5e-5, 2.5e-5, 5e-5], rtol=0.1)


def test_saturated_pixels_are_counted_and_nan(tmp_path: Path) -> None:
    plan = small_plan("[pattern]\npitch_px = [8, 12]\n[camera]\nexposure_s = 0.2\n")
    session, _ = captured(tmp_path / "s", plan, small_bench(**SHARP))
    result = process(session, tmp_path / "r", Options("iva", n_components=2), Silent())
    saturated = result.mask == 1
    assert 0 < result.record.mask.saturated == saturated.sum() < saturated.size
    for name in result.record.components:
        assert np.isnan(result.component(name)[saturated]).all()
        assert np.isfinite(result.component(name)[~saturated]).all()
    assert any("saturated" in warning for warning in result.record.warnings)


def test_everything_saturated_is_one_message(tmp_path: Path) -> None:
    plan = small_plan("[pattern]\npitch_px = [8]\n[camera]\nexposure_s = 100.0\n")
    session, _ = captured(tmp_path / "s", plan, small_bench(**SHARP))
    with pytest.raises(StackError, match="no pixel can be measured"):
        process(session, tmp_path / "r", Options("iva", n_components=2), Silent())


@pytest.mark.parametrize(
    ("defect", "word"),
    [
        pytest.param({"blur_px": 1.5}, "Not resolved", id="blur"),
        pytest.param({"ambient": 0.3}, "black frame", id="room light"),
    ],
)
def test_what_weakens_the_frames_is_said(
    unmixed: Result, tmp_path: Path, defect: dict[str, object], word: str
) -> None:
    weak = processed(tmp_path, **defect)
    assert not any(word in warning for warning in unmixed.record.warnings)
    assert any(word in warning for warning in weak.record.warnings)


def test_sinusoids_are_separated_too(tmp_path: Path) -> None:
    text = (
        '[pattern]\nfamily = "sinusoid-columns"\npitch_px = [8, 16]\nshifts = [1, 8]\n'
        "[projector]\ngamma = 2.2\n"
    )
    bench = small_bench(gamma=2.2, scene="board", **SHARP)
    session, _ = captured(tmp_path / "s", small_plan(text), bench)
    result = process(session, tmp_path / "r", Options("iva", n_components=2), Silent())
    coarse = result.pitch_image(result.record.pitches[1].direct)
    lit = result.mask == 0
    # A flat board has no global light; a pixel averages the sinusoid over about 3 of its 32
    # projector pixels, which lowers the amplitude by at most 2 %.
    ratio = coarse[lit].sum() / result.white[lit].sum()
    assert ratio == pytest.approx(1, abs=0.03)


def test_evaluation_is_zero_for_the_truth_itself(tmp_path: Path) -> None:
    result = processed(tmp_path, scene="board")
    truth = read_truth(tmp_path / "s" / "truth.npz", result.record.shape)
    rows = evaluate(result, {"direct": result.component(result.record.components[0])}).rows
    assigned = next(row for row in rows if row.matching == "assigned")
    assert assigned.error == pytest.approx(0, abs=1e-6)
    finest = next(row for row in evaluate(result, truth).rows if "finest" in row.matching)
    oracle = next(row for row in evaluate(result, truth).rows if "oracle" in row.matching)
    assert oracle.error <= finest.error


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        pytest.param(Options(method="magic"), "No method 'magic'", id="method"),
        pytest.param(Options("iva", n_components=1), "2 to 5", id="one component"),
        pytest.param(Options("iva", n_components=6), "2 to 5", id="too many components"),
    ],
)
def test_options_that_cannot_be(
    sound: Session, tmp_path: Path, options: Options, reason: str
) -> None:
    with pytest.raises(LumisplitError, match=reason):
        process(sound, tmp_path / "r", options, Silent())
    assert not (tmp_path / "r").exists()


def test_the_default_yields_light_with_errors(by_default: Result) -> None:
    result = by_default
    assert result.record.method == "ranges"
    assert result.record.components[0] == "direct"
    images = [result.component(name) for name in result.record.components]
    assert min(image.min() for image in images) >= 0
    measured = result.mask == 0
    np.testing.assert_allclose(
        np.sum(images, axis=0)[measured], np.maximum(result.white, 0)[measured], atol=1e-5
    )
    for name in result.record.components:
        assert (result.deviation(name)[measured] >= 0).all()
    assert not list(result.folder.glob(".*"))


def test_a_number_of_components_that_has_no_effect_is_said(sound: Session, tmp_path: Path) -> None:
    for options in (Options(n_components=2), Options("ranges", n_components=2)):
        result = process(sound, tmp_path / "r", options, Silent())
        assert any("had no effect" in warning for warning in result.record.warnings)


@pytest.mark.parametrize(
    "pattern",
    [
        pytest.param("pitch_px = [8, 12, 16]", id="checkers"),
        pytest.param('family = "stripes-rows"\npitch_px = [8, 16]', id="two-pitches-of-stripes"),
    ],
)
def test_where_the_default_cannot_work_iva_does_and_says_why(tmp_path: Path, pattern: str) -> None:
    text = f"[pattern]\n{pattern}\nshifts = [2, 1]\n"
    session, _ = captured(tmp_path / "s", small_plan(text), small_bench(**SHARP))
    result = process(session, tmp_path / "r", Options(), Silent())
    assert result.record.method == "iva"
    assert any("default method cannot be used" in warning for warning in result.record.warnings)
    with pytest.raises(StackError, match="--method iva"):
        process(session, tmp_path / "r2", Options(method="ranges"), Silent())


def extrema_of(session: Session, folder: Path) -> Session:
    """An imported stack of the largest and smallest value of every pixel at each pitch."""
    folder.mkdir()
    stack, frames_of = Stack(session), Frames(session)
    rows = ["file,role,pattern,pitch_px,shift_y_px,shift_x_px", "w.tiff,white,,,,"]
    levels = {
        frame.pattern.family: image.values
        for frame, image in frames_of.images(session.frames)
        if frame.pattern.family in {Family.WHITE, Family.BLACK}
    }
    tifffile.imwrite(
        folder / "w.tiff", levels[Family.WHITE] - levels[Family.BLACK], photometric="rgb"
    )
    for group in stack.groups:
        frames = np.stack([image.values for _, image in frames_of.images(group.frames)])
        for name, pick, shift in (("max", np.max, 0), ("min", np.min, group.pitch_px)):
            path = folder / f"{name}-{group.pitch_px}.tiff"
            light = pick(frames, axis=0) - levels[Family.BLACK]
            tifffile.imwrite(path, light, photometric="rgb")
            rows.append(f"{path.name},pattern,checker,{group.pitch_px},{shift},0")
    (folder / "t.csv").write_text("\n".join(rows) + "\n")
    return import_table(folder / "t.csv", folder / "s", progress=Silent())


def test_extrema_alone_are_taken_apart_by_range(sound: Session, tmp_path: Path) -> None:
    session = extrema_of(sound, tmp_path / "import")
    result = process(session, tmp_path / "r", Options(), Silent())
    assert result.record.method == "ranges"
    assert any("largest and smallest value" in warning for warning in result.record.warnings)
    assert result.record.components[0] == "direct"
    measured = result.mask == 0
    truth = read_truth(sound.folder / "truth.npz", measured.shape)
    blind = process(session, tmp_path / "blind", IVA, Silent())
    errors = [
        min(
            relative_error(one.component(name), truth["direct"], measured)
            for name in one.record.components
        )
        for one in (result, blind)
    ]
    assert errors[0] < errors[1]


def test_a_result_replaces_only_a_result(sound: Session, unmixed: Result, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(unmixed.folder, tmp_path / "r"))
    assert len(list((folder / "components").iterdir())) == 3
    process(sound, folder, Options("iva", n_components=2), Silent())
    assert len(Result.open(folder).record.components) == 2
    assert len(list((folder / "components").iterdir())) == 2
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter-1.tex").write_text("ten years")
    for taken in (tmp_path / "thesis", sound.folder):
        with pytest.raises(ResultError):
            process(sound, taken, Options(), Silent())
    assert (tmp_path / "thesis" / "chapter-1.tex").exists()


def test_a_changed_frame_stops_the_processing(sound: Session, tmp_path: Path) -> None:
    session = Session.open(Path(shutil.copytree(sound.folder, tmp_path / "s")))
    path = tmp_path / "s" / session.frames[7].file
    content = bytearray(path.read_bytes())
    content[-1] ^= 1
    path.write_bytes(content)
    with pytest.raises(LumisplitError, match="digest differs"):
        process(session, tmp_path / "r", Options(), Silent())


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        pytest.param(b"not a zip", "Cannot read the truth", id="no zip"),
        pytest.param({"other": np.zeros((4, 5, 3))}, "holds none of", id="other names"),
        pytest.param({"direct": np.zeros((4, 5))}, r"\(4, 5\)", id="shape"),
        pytest.param({"direct": np.zeros((900, 900, 3))}, "larger than", id="too large"),
        pytest.param({"direct": np.array([object()])}, "Cannot read|larger|direct is", id="pickle"),
        pytest.param({"direct": np.full((4, 5, 3), "x")}, "direct is|larger", id="text"),
    ],
)
def test_truth_files_that_cannot_be_used(
    tmp_path: Path, content: bytes | dict[str, np.ndarray], reason: str
) -> None:
    path = tmp_path / "truth.npz"
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        np.savez(path, allow_pickle=True, **content)
    with pytest.raises(ResultError, match=reason):
        read_truth(path, (4, 5))


@pytest.mark.parametrize(
    ("damage", "reason"),
    [
        pytest.param(b"{}", "cannot be used", id="empty"),
        pytest.param(b'{"components": ["../../x"]}', "cannot be used", id="path as a name"),
        pytest.param(b"\xff" * 100, "cannot be used", id="noise"),
    ],
)
def test_damaged_results(tmp_path: Path, damage: bytes, reason: str) -> None:
    (tmp_path / "result.json").write_bytes(damage)
    with pytest.raises(ResultError, match=reason):
        Result.open(tmp_path)


def test_images_of_a_stranger(unmixed: Result, tmp_path: Path) -> None:
    result = Result.open(Path(shutil.copytree(unmixed.folder, tmp_path / "r")))
    (result.folder / "white.tiff").write_bytes(b"II*\x00garbage")
    with pytest.raises(ResultError, match=r"white\.tiff"):
        _ = result.white
    (result.folder / "mask.tiff").unlink()
    (result.folder / "mask.tiff").symlink_to("/etc/passwd")
    with pytest.raises(ResultError, match="is a link"):
        _ = result.mask


def test_few_pitches_that_repeat_on_the_raster_tell_what_scatters(tmp_path: Path) -> None:
    """Octaves; a target of the default method, 0.45, which 0.65 and more missed."""
    bench = small_bench(camera_px=(96, 96), projector_px=(288, 384), full_well_e=20_000.0)
    plan = small_plan("[pattern]\npitch_px = [8, 16, 32, 64]\n")
    session, _ = captured(tmp_path / "s", plan, bench)
    result = process(session, tmp_path / "r", Options(), Silent())
    measured = result.mask == 0
    truth = read_truth(session.folder / "truth.npz", measured.shape)
    found = result.component("subsurface")
    assert relative_error(found, truth["subsurface"], measured) < 0.45
