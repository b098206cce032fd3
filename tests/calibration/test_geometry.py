"""Places from stripes, and lenses from poses of a board that are rendered exactly."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.errors import UnsupportedError
from calibration.geometry import Correspondence, correspondence
from calibration.poses import Chessboard, DevicePair, Pose, find_pose, fit_poses, opencv_text
from calibration.stripes import GrayCode, Sinusoids
from processing.patterns import Family, Pattern, gray_code, shift_grid

Array = NDArray[np.float64]
WIDTH = 200
PITCH, STEPS, FINEST = 8, 8, 2


def decoded(
    columns: Array, direct: Array, sigma: float = 0.0, gamma: float = 1.0, turned: float = 0.0
) -> tuple[Array, NDArray[np.bool_], Array]:
    """Decode what pixels at `columns` see.

    `turned` is global light that answers every bit with its complement.
    """
    rng = np.random.default_rng(5)
    resolution = (1, WIDTH)

    def seen(pattern: Pattern) -> NDArray[np.float32]:
        code = pattern.code(resolution)[0]
        light = direct * np.interp(columns, np.arange(WIDTH), code) ** gamma
        if pattern.family is Family.STRIPES_COLUMNS:
            nearest = code[np.rint(columns).astype(int)]
            light = direct * nearest + turned * (1 - nearest)
        elif pattern.family is not Family.WHITE:
            light = light + turned / 2
        noisy: Array = light + rng.normal(0, sigma, light.shape) if sigma else light
        return noisy.astype(np.float32)

    waves = Sinusoids(PITCH, STEPS)
    for shift in shift_grid(PITCH, (1, STEPS), (2, 2)):
        waves.add(seen(Pattern(Family.SINUSOID_COLUMNS, PITCH, *shift)), shift[1])
    phase = waves.phase()
    gray = GrayCode(FINEST, phase, (direct + turned).astype(np.float32))
    for bit in range(FINEST, 8):
        gray.add(
            bit,
            seen(gray_code(bit, 8, rows=False)),
            seen(gray_code(bit, 8, rows=False, complement=True)),
        )
    places, trusted = gray.places(WIDTH)
    return places, trusted, phase.deviation_px


def whole_columns() -> Array:
    return np.tile(np.arange(WIDTH, dtype=np.float64), (20, 1))


@pytest.mark.parametrize("gamma", [1.0, 2.2], ids=["linear", "gamma 2.2"])
def test_places_are_exact_without_noise(gamma: float) -> None:
    columns = whole_columns()
    places, trusted, _ = decoded(columns, np.ones_like(columns), gamma=gamma)
    assert trusted.all()
    # The 7th and 9th harmonics of cos^4.4 are all that 8 steps cannot tell from the first.
    assert np.abs(places - columns).max() < (1e-6 if gamma == 1 else 0.01)


def test_noise_moves_places_by_the_error_that_is_stated() -> None:
    columns = whole_columns()
    places, trusted, deviation = decoded(columns, np.ones_like(columns), sigma=0.02)
    assert trusted.mean() > 0.99
    off = (places - columns)[trusted]
    # 4000 pixels tell a standard deviation to 1.1 %; each pixel's own noise is known to 8 %.
    assert off.std() == pytest.approx(np.sqrt((deviation[trusted] ** 2).mean()), rel=0.1)


def test_bits_that_global_light_turned_are_not_trusted() -> None:
    columns = whole_columns()
    direct = np.where(np.arange(20)[:, np.newaxis] < 10, 1.0, 0.2) * np.ones_like(columns)
    places, trusted, _ = decoded(columns, direct, turned=0.4)
    # Where direct light outweighs global, places are right; where it does not, bits are turned.
    assert trusted[:10].all()
    assert np.abs(places - columns)[:10].max() < 1e-6
    assert not trusted[10:].any()


def test_too_few_places_are_refused_with_the_reason() -> None:
    columns = np.tile(np.arange(30.0), (30, 1))
    places, lit = (columns, columns.T), np.ones((30, 30), bool)
    with pytest.raises(UnsupportedError, match="expose longer"):
        correspondence(places, lit, np.full((30, 30), 2.0), lit, (30, 30))
    with pytest.raises(UnsupportedError, match="focus camera and projector"):
        correspondence(places, ~lit, np.full((30, 30), 0.01), lit, (30, 30))
    found = correspondence(places, lit, np.full((30, 30), 0.01), lit, (30, 30))
    assert (found.decoded, found.coverage) == (1.0, 1.0)
    assert found.camera_px_per_projector_px == pytest.approx(1)


CAMERA_PX, PROJECTOR_PX = (240, 320), (384, 512)
CAMERA = np.array([[520.0, 0, 158], [0, 520, 121], [0, 0, 1]])
# A projector whose axis is at the lower edge of its picture.
PROJECTOR = np.array([[700.0, 0, 255], [0, 700, 330], [0, 0, 1]])
TURN = cv2.Rodrigues(np.array([0.05, -0.12, 0.01]))[0]
STEP_M = np.array([0.15, 0.06, 0.01])
BOARD = Chessboard(7, 5, 0.03)
TILTS = [(0, 0), (0.45, 0.1), (-0.4, 0.2), (0.1, 0.45), (-0.2, -0.45)]


def board_pose(tilt: tuple[float, float], noise_px: float) -> Pose:
    """The board rendered with 4 × 4 samples a pixel, and its exact places with noise added."""
    rng = np.random.default_rng(3)
    turn = cv2.Rodrigues(np.array([tilt[0], tilt[1], 0.02]))[0]
    middle = np.array([0.09, 0.06, 0])
    step = np.array([0.0, 0.0, 0.6]) - turn @ middle

    def on_board(columns: Array, rows: Array) -> Array:
        rays = np.stack([columns, rows, np.ones_like(columns)], -1) @ np.linalg.inv(CAMERA).T
        depth = (turn[:, 2] @ step) / (rays @ turn[:, 2])
        points: Array = depth[..., np.newaxis] * rays
        return points

    height, width = CAMERA_PX
    fine_rows, fine_columns = (
        (index + 0.5) / 4 - 0.5 for index in np.mgrid[: 4 * height, : 4 * width].astype(float)
    )
    x, y = np.moveaxis(((on_board(fine_columns, fine_rows) - step) @ turn)[..., :2], -1, 0) / 0.03
    squares = (x > -1) & (x < 7) & (y > -1) & (y < 5)
    ink = squares & ((np.floor(x) + np.floor(y)) % 2 == 0)
    picture = np.where(ink, 0.06, 0.8).reshape(height, 4, width, 4).mean(axis=(1, 3))
    rows, columns = np.mgrid[:height, :width].astype(float)
    seen = (on_board(columns, rows) @ TURN.T + STEP_M) @ PROJECTOR.T
    places = seen[..., :2] / seen[..., 2:] + rng.normal(0, noise_px, (*CAMERA_PX, 2))
    valid = np.all((places > 0) & (places < (512, 384)), axis=-1)
    column, row = (np.where(valid, places[..., k], np.nan).astype(np.float32) for k in (0, 1))
    deviation = np.full(CAMERA_PX, noise_px, np.float32)
    known = Correspondence(column, row, deviation, valid, 1.0, 0.5, 0.5)
    return find_pose(picture.astype(np.float32), known, BOARD)


@pytest.fixture(scope="module")
def poses() -> list[Pose]:
    return [board_pose(tilt, 0.1) for tilt in TILTS]


@pytest.fixture(scope="module")
def pair(poses: list[Pose]) -> DevicePair:
    return fit_poses(poses, CAMERA_PX, PROJECTOR_PX)


def test_lenses_and_the_step_between_them_are_found(pair: DevicePair) -> None:
    """Within 4 of the stated standard errors, and within the reprojection that is asked for."""
    assert pair.reprojection_px < 0.3
    off = np.zeros(2)
    for k, (lens, truth) in enumerate(((pair.camera, CAMERA), (pair.projector, PROJECTOR))):
        focal = np.array([lens.matrix[0, 0], lens.matrix[1, 1]])
        assert np.all(np.abs(focal - truth[0, 0]) < 4 * lens.focal_deviation_px)
        centre = np.abs(lens.matrix[:2, 2] - truth[:2, 2])
        assert np.all(centre < 4 * lens.centre_deviation_px)
        off[k] = np.hypot(*lens.centre_deviation_px) / truth[0, 0]
    # Distances follow the focal length, directions the principal points.
    scale = max(pair.camera.focal_deviation_px / CAMERA[0, 0])
    step_m = np.linalg.norm(STEP_M)
    assert np.linalg.norm(pair.translation_m) == pytest.approx(step_m, rel=4 * scale + 4 * max(off))
    turned = cv2.Rodrigues(pair.rotation @ TURN.T)[0]
    assert np.linalg.norm(turned) < 4 * np.hypot(*off)


def test_opencv_reads_the_result(tmp_path: Path, pair: DevicePair) -> None:
    path = tmp_path / "geometry.yaml"
    path.write_text(opencv_text(pair, CAMERA_PX, PROJECTOR_PX))
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    assert np.array_equal(file.getNode("camera_matrix").mat(), pair.camera.matrix)
    assert np.array_equal(file.getNode("projector_matrix").mat(), pair.projector.matrix)
    assert np.array_equal(file.getNode("R").mat(), pair.rotation)
    assert file.getNode("T").mat().ravel() == pytest.approx(pair.translation_m, abs=0)
    assert file.getNode("projector_size").mat().ravel().tolist() == [512, 384]
    file.release()


def test_poses_that_cannot_tell_are_refused(poses: list[Pose]) -> None:
    with pytest.raises(UnsupportedError, match="at least 3"):
        fit_poses(poses[:2], CAMERA_PX, PROJECTOR_PX)
    with pytest.raises(UnsupportedError, match=r"alike|tilt"):
        fit_poses([poses[0]] * 4, CAMERA_PX, PROJECTOR_PX)


def test_a_picture_without_the_board_is_refused() -> None:
    rows, columns = np.mgrid[:60, :80].astype(np.float32)
    valid = np.ones((60, 80), bool)
    known = Correspondence(columns, rows, np.full((60, 80), 0.1, np.float32), valid, 1, 1, 1)
    with pytest.raises(UnsupportedError, match="no board of 7 × 5"):
        find_pose(np.ones((60, 80), np.float32), known, BOARD)
