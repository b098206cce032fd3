"""Exported files, opened again by another reader than the one that wrote them."""

from __future__ import annotations

import ast
import json
import struct
import zipfile
from collections.abc import Iterator
from pathlib import Path

import imagecodecs
import numpy as np
import OpenImageIO
import pyfive
import pytest
from numpy.typing import NDArray
from PIL import Image
from typer.testing import CliRunner

from acquire.cli.main import app
from acquire.export import Format, component_parcel, export
from acquire.result import PixelClass, Result, write_record, write_tiff
from acquire.tone import exposure_of
from processing.patterns import Family
from tests.acquire.result_folders import write_result

Arrays = dict[str, NDArray[np.generic]]
IMAGES = ("direct", "subsurface", "interreflection", "white")
ERRORS = ("direct-error", "subsurface-error", "interreflection-error")


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    """Noise of both signs, some of it NaN, with standard errors."""
    made = write_result(
        tmp_path_factory.mktemp("export") / "r", shape=(20, 31), pixel_class=PixelClass.SATURATED
    )
    (made.folder / "deviations").mkdir()
    chance = np.random.default_rng(4)
    for name in made.record.components:
        light = chance.normal(0.2, 0.2, (20, 31, 3)).astype(np.float32)
        light[made.mask == PixelClass.SATURATED] = np.nan
        write_tiff(made.folder / f"components/{name}.tiff", light)
        write_tiff(made.folder / f"deviations/{name}.tiff", (np.abs(light) / 9).astype(np.float32))
    write_record(made.folder, made.record.model_copy(update={"deviations": True}))
    return Result.open(made.folder)


def images_of(result: Result) -> Arrays:
    errors = {f"{name}-error": result.deviation(name) for name in result.record.components}
    components = {name: result.component(name) for name in result.record.components}
    return {**components, **errors, "white": result.white}


def check(result: Result, read: Arrays, mask: NDArray[np.generic], said: str) -> None:
    wanted = images_of(result)
    assert set(read) == set(wanted) == {*IMAGES, *ERRORS}
    for name, image in wanted.items():
        assert read[name].dtype == np.float32
        assert np.array_equal(read[name], image, equal_nan=True), name
    assert np.array_equal(mask, result.mask)
    stated = json.loads(said)
    assert stated["color_space"] == "linear RGB of the camera, without white balance or matrix"
    assert stated["result_sha256"] == result.sha256
    assert stated["unit"].startswith("fraction of the sensor's range")
    assert stated["versions"]["lumisplit"] == "0.2.0"


def test_exr(result: Result, tmp_path: Path) -> None:
    (path,) = export(result, Format.EXR, tmp_path / "r.exr")
    source = OpenImageIO.ImageInput.open(str(path))
    assert source is not None
    spec = source.spec()
    pixels = np.asarray(source.read_image("float"))
    floats = {name: pixels[..., k] for k, name in enumerate(spec.channelnames)}
    mask = floats.pop("mask.class")
    read: Arrays = {
        name: np.stack([floats[f"{name}.{colour}"] for colour in "RGB"], axis=2)
        for name in images_of(result)
    }
    assert len(floats) == 3 * len(read)
    check(result, read, mask, spec.getattribute("lumisplit"))


def test_hdf5(result: Result, tmp_path: Path) -> None:
    (path,) = export(result, Format.HDF5, tmp_path / "r.h5")
    with pyfive.File(str(path)) as file:
        read: Arrays = {name: file[name][...] for name in file if name not in ("mask", "lumisplit")}
        check(result, read, file["mask"][...], _text(file["lumisplit"][()]))
        assert _text(file["direct"].attrs["channels"]) == "R,G,B"
        assert "saturated" in _text(file["mask"].attrs["classes"])


def _text(value: str | bytes) -> str:
    return value.decode() if isinstance(value, bytes) else value


def test_npz(result: Result, tmp_path: Path) -> None:
    """Read as the format is documented (numpy.lib.format), without NumPy's own reader."""
    (path,) = export(result, Format.NPZ, tmp_path / "r.npz")
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        read = {name.removesuffix(".npy"): _npy(archive.read(name)) for name in archive.namelist()}
    said = str(read.pop("lumisplit")[()])
    check(result, read, read.pop("mask"), said)


def _npy(data: bytes) -> NDArray[np.generic]:
    assert data[:6] == b"\x93NUMPY"
    (length,) = struct.unpack("<H", data[8:10])
    header = ast.literal_eval(data[10 : 10 + length].decode())
    array = np.frombuffer(data, header["descr"], offset=10 + length)
    return array.reshape(header["shape"], order="F" if header["fortran_order"] else "C")


def test_mat(result: Result, tmp_path: Path) -> None:
    """Read as MathWorks' *MAT-File Format*, version 5, has it, without SciPy."""
    (path,) = export(result, Format.MAT, tmp_path / "r.mat")
    read = dict(_mat_variables(path.read_bytes()))
    mask = read.pop("mask")
    said = bytes(read.pop("lumisplit").astype(np.uint8).ravel()).decode()
    named = {name.replace("_", "-"): array for name, array in read.items()}
    check(result, named, mask, said)


MAT_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 16: "u1"}


def _mat_elements(data: bytes) -> Iterator[tuple[int, bytes]]:
    place = 0
    while place < len(data):
        kind, size = struct.unpack_from("<II", data, place)
        if kind >> 16:  # a small element: the size is in the upper half of the kind
            yield kind & 0xFFFF, data[place + 4 : place + 4 + (kind >> 16)]
            place += 8
        else:
            yield kind, data[place + 8 : place + 8 + size]
            place += 8 + size + (-size % 8 if kind != 14 else 0)


def _mat_variables(data: bytes) -> Iterator[tuple[str, NDArray[np.generic]]]:
    assert data[:19] == b"MATLAB 5.0 MAT-file"
    assert data[126:128] == b"IM"
    for kind, body in _mat_elements(data[128:]):
        assert kind == 14
        _, shape, name, (number, values) = _mat_elements(body)
        array = np.frombuffer(values, "<" + MAT_TYPES[number])
        sides = struct.unpack(f"<{len(shape[1]) // 4}i", shape[1])
        yield name[1].decode(), array.reshape(sides, order="F")


def test_png(result: Result, tmp_path: Path) -> None:
    paths = export(result, Format.PNG, tmp_path / "pictures")
    assert [path.name for path in paths] == [
        f"{name}.png" for name in component_parcel(result).images
    ]
    gain = exposure_of(result.white)
    for path, (name, image) in zip(paths, images_of(result).items(), strict=True):
        data = path.read_bytes()
        pixels = imagecodecs.png_decode(data)
        assert pixels.dtype == np.uint16
        light = np.clip(np.nan_to_num(image.astype(np.float64)) * gain, 0, 1)
        curve = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
        assert np.abs(pixels - 65535 * curve).max() <= 1, name
        picture = Image.open(path)
        picture.load()
        said = json.loads(picture.text["Description"])  # type: ignore[attr-defined] # of PNGs
        assert said["image"] == name
        assert said["display_gain"] == pytest.approx(gain)
        assert "sRGB curve" in said["color_space"]


@pytest.mark.parametrize(
    ("to", "out", "status", "reason"),
    [
        ("npz", "r.npz", 0, ""),
        ("tga", "r.tga", 2, "there are exr, mat, npz, hdf5, png"),
        ("npz", "nowhere/r.npz", 1, "No such file"),
        ("exr", "nowhere/r.exr", 1, "nowhere"),
        ("hdf5", "nowhere/r.h5", 1, "nowhere"),
    ],
)
def test_command(
    result: Result, tmp_path: Path, to: str, out: str, status: int, reason: str
) -> None:
    words = ["export", str(result.folder), "--to", to, "--out", str(tmp_path / out)]
    run = CliRunner().invoke(app, words)
    assert run.exit_code == status
    said = " ".join((run.output + str(run.exception)).replace("│", " ").split())
    assert reason in said
    assert (tmp_path / out).exists() is (status == 0)


def test_nothing_is_written_into_the_result(result: Result) -> None:
    words = ["export", str(result.folder), "--to", "png", "--out", str(result.folder / "pictures")]
    run = CliRunner().invoke(app, words)
    assert "inside the result" in str(run.exception)
    assert not (result.folder / "pictures").exists()


@pytest.fixture(scope="module")
def with_pitches(result: Result) -> Result:
    """Another result whose second pitch knows its noise."""
    chance = np.random.default_rng(6)
    pitches = []
    for k, pitch in enumerate(result.record.pitches):
        for path in (pitch.direct, pitch.global_):
            light = chance.normal(0.2, 0.2, (20, 31, 3)).astype(np.float32)
            light[result.mask == PixelClass.SATURATED] = np.nan
            write_tiff(result.folder / path, light)
        more = {}
        if k == 1:
            more = {"corrected": "pitches/corrected-0016.tiff"}
            more |= {"deviation": "pitches/deviation-0016.tiff"}
            for path in more.values():
                write_tiff(result.folder / path, chance.random((20, 31, 3)).astype(np.float32))
        pitches.append(pitch.model_copy(update=more))
    write_record(result.folder, result.record.model_copy(update={"pitches": tuple(pitches)}))
    return Result.open(result.folder)


PITCHES = (
    "direct-0008", "global-0008", "direct-0016", "global-0016", "corrected-0016",
    "deviation-0016", "direct-0032", "global-0032",
)  # fmt: skip


def check_pitches(result: Result, read: Arrays, said: str) -> None:
    assert set(read) == {*PITCHES, "white"}
    for name in PITCHES:
        assert read[name].dtype == np.float32
        expected = result.pitch_image(f"pitches/{name}.tiff")
        assert np.array_equal(read[name], expected, equal_nan=True), name
    assert np.array_equal(read["white"], result.white, equal_nan=True)
    stated = json.loads(said)
    assert [one["pitch_px"] for one in stated["pitches"]] == [8, 16, 32]
    assert stated["pitches"][1]["deviation"] == "deviation-0016"
    assert "corrected" not in stated["pitches"][0]
    assert stated["result_sha256"] == result.sha256


def test_pitches_as_hdf5(with_pitches: Result, tmp_path: Path) -> None:
    (path,) = export(with_pitches, Format.HDF5, tmp_path / "p.h5", pitches=True)
    with pyfive.File(str(path)) as file:
        read: Arrays = {name: file[name][...] for name in file if name not in ("mask", "lumisplit")}
        assert np.array_equal(file["mask"][...], with_pitches.mask)
        check_pitches(with_pitches, read, _text(file["lumisplit"][()]))


def test_more_pitches_than_an_attribute_has_room_for(with_pitches: Result, tmp_path: Path) -> None:
    first = with_pitches.record.pitches[0]
    many = tuple(first.model_copy(update={"pitch_px": 2 * k}) for k in range(1, 701))
    record = with_pitches.record.model_copy(update={"pitches": many})
    export(Result(with_pitches.folder, record), Format.HDF5, tmp_path / "p.h5", pitches=True)
    with pyfive.File(str(tmp_path / "p.h5")) as file:
        said = _text(file["lumisplit"][()])
    assert len(said) > 1 << 16
    assert [one["pitch_px"] for one in json.loads(said)["pitches"]] == list(range(2, 1402, 2))


def test_pitches_as_npz(with_pitches: Result, tmp_path: Path) -> None:
    (path,) = export(with_pitches, Format.NPZ, tmp_path / "p.npz", pitches=True)
    with zipfile.ZipFile(path) as archive:
        read = {name.removesuffix(".npy"): _npy(archive.read(name)) for name in archive.namelist()}
    assert np.array_equal(read.pop("mask"), with_pitches.mask)
    check_pitches(with_pitches, read, str(read.pop("lumisplit")[()]))


def test_pitches_as_mat(with_pitches: Result, tmp_path: Path) -> None:
    (path,) = export(with_pitches, Format.MAT, tmp_path / "p.mat", pitches=True)
    read = dict(_mat_variables(path.read_bytes()))
    assert np.array_equal(read.pop("mask"), with_pitches.mask)
    said = bytes(read.pop("lumisplit").astype(np.uint8).ravel()).decode()
    named = {name.replace("_", "-"): array for name, array in read.items()}
    check_pitches(with_pitches, named, said)


def test_pitches_as_a_folder_of_exr(with_pitches: Result, tmp_path: Path) -> None:
    paths = export(with_pitches, Format.EXR, tmp_path / "p", pitches=True)
    assert [path.name for path in paths] == [
        "pitch-0008.exr", "pitch-0016.exr", "pitch-0032.exr", "white.exr",
    ]  # fmt: skip
    read: Arrays = {}
    for path in paths:
        source = OpenImageIO.ImageInput.open(str(path))
        assert source is not None
        spec = source.spec()
        pixels = np.asarray(source.read_image("float"))
        floats = {name: pixels[..., k] for k, name in enumerate(spec.channelnames)}
        assert np.array_equal(floats.pop("mask.class"), with_pitches.mask)
        layers = {name.partition(".")[0] for name in floats}
        for layer in layers:
            name = "white" if layer == "white" else f"{layer}-{path.stem.partition('-')[2]}"
            read[name] = np.stack([floats[f"{layer}.{colour}"] for colour in "RGB"], axis=2)
        said = spec.getattribute("lumisplit")
        assert json.loads(said)["file"] == path.stem
    check_pitches(with_pitches, read, said)


def test_pitches_as_png(with_pitches: Result, tmp_path: Path) -> None:
    words = ["export", str(with_pitches.folder), "--to", "png", "--pitches"]
    run = CliRunner().invoke(app, [*words, "--out", str(tmp_path / "p")])
    assert run.exit_code == 0
    assert {path.stem for path in (tmp_path / "p").iterdir()} == {*PITCHES, "white"}
    gain = exposure_of(with_pitches.white)
    light = np.nan_to_num(with_pitches.pitch_image("pitches/global-0016.tiff"))
    light = np.clip(light * gain, 0, 1)
    curve = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    pixels = imagecodecs.png_decode((tmp_path / "p" / "global-0016.png").read_bytes())
    assert np.abs(pixels - 65535 * curve).max() <= 1


def test_pitches_of_two_families_have_both_names(tmp_path: Path) -> None:
    families = (Family.STRIPES_ROWS, Family.STRIPES_COLUMNS)
    made = write_result(tmp_path / "r", families=families, pitches_px=(8,))
    paths = export(made, Format.EXR, tmp_path / "p", pitches=True)
    assert [path.stem for path in paths] == [
        "pitch-stripes-rows-0008", "pitch-stripes-columns-0008", "white",
    ]  # fmt: skip
