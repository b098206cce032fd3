"""Lenses and places of camera and projector from a printed chessboard in several poses.

After Moreno & Taubin, Simple, accurate, and robust projector-camera calibration (3DIMPVT 2012):
the board's corners are found in the camera's picture, carried to the projector by a homography of
the correspondence around each of them, and both devices are calibrated as cameras with OpenCV.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.errors import UnsupportedError
from calibration.geometry import Correspondence

Array = NDArray[np.float64]
LEAST_POSES = 3
LEAST_TILT_DEG = 15.0
MOST_FOCAL_ERROR = 0.02
MOST_REPROJECTION_PX = 1.0
LEAST_POINTS = 16
LEAST_CORNERS = 0.7
WINDOW = 0.8
# Of the distance to the nearest corner.
REFINED_WITHIN = 0.35
OUTLIER_PX = 1.5
# Some hundred corners tell k1; further terms trade places with the principal point.
FLAGS = cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3


@dataclass(frozen=True, slots=True)
class Chessboard:
    """A printed board: inner corners along each side, and the side of a square in metres."""

    columns: int
    rows: int
    square_m: float

    def points_m(self) -> NDArray[np.float32]:
        """(rows · columns, 3) corners on the board, z = 0, row after row."""
        row, column = np.divmod(np.arange(self.rows * self.columns), self.columns)
        flat = np.stack([column, row, np.zeros_like(row)], axis=1)
        return (self.square_m * flat).astype(np.float32)


@dataclass(frozen=True, slots=True)
class Pose:
    """Corners of the board in one pose; (n, 3) in metres, (n, 2) as (column, row) in pixels."""

    board_m: NDArray[np.float32]
    camera_px: NDArray[np.float32]
    projector_px: NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Lens:
    """A device as a pinhole with distortion, in OpenCV's terms.

    Parameters
    ----------
    matrix
        (3, 3), pixels.
    distortion
        (5,): k1, k2, p1, p2, k3, of which all but k1 are held at 0.
    focal_deviation_px, centre_deviation_px
        (2,) standard errors of the focal lengths and of the principal point.
    reprojection_px
        Root mean square of what is left of the corners, by itself.
    residuals_px
        (corners, 2) of all poses.
    """

    matrix: Array
    distortion: Array
    focal_deviation_px: Array
    centre_deviation_px: Array
    reprojection_px: float
    residuals_px: Array


@dataclass(frozen=True, slots=True)
class DevicePair:
    """Camera, projector and the step between them: X_projector = R X_camera + t.

    Parameters
    ----------
    rotation, translation_m
        (3, 3) and (3,).
    essential, fundamental
        (3, 3).
    reprojection_px
        Root mean square over both devices with one pose of the board for the two.
    tilt_deg
        Largest angle between two poses of the board.
    """

    camera: Lens
    projector: Lens
    rotation: Array
    translation_m: Array
    essential: Array
    fundamental: Array
    reprojection_px: float
    tilt_deg: float


def find_pose(picture: NDArray[np.float32], seen: Correspondence, board: Chessboard) -> Pose:
    """Corners of the board in the camera's picture and where the projector has them.

    Parameters
    ----------
    picture
        Light under white, (height, width).
    seen
        The correspondence in this pose.
    board
        What is printed.

    Raises
    ------
    UnsupportedError
        The board is not seen whole, or the correspondence has gaps at too many corners.
    """
    if picture.shape != seen.valid.shape:
        raise ValueError(f"picture {picture.shape} does not fit places {seen.valid.shape}")
    bright = max(float(np.percentile(picture, 99.5)), 1e-30)
    # The eye's curve: paper and ink both well within eight bits.
    shown = (255 * np.sqrt(np.clip(picture / bright, 0, 1))).astype(np.uint8)
    flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
    found, corners = cv2.findChessboardCornersSB(shown, (board.columns, board.rows), flags=flags)
    if not found:
        raise UnsupportedError(
            f"no board of {board.columns} × {board.rows} inner corners is seen whole: it has to "
            "lie within the light and the picture, with a pale margin, in focus"
        )
    camera_px = _refined(np.sqrt(np.clip(picture / bright, 0, 1)), corners.reshape(-1, 2))
    carried = [_carried(corner, camera_px, seen) for corner in camera_px]
    kept = np.array([one is not None for one in carried])
    if kept.mean() < LEAST_CORNERS:
        raise UnsupportedError(
            f"only {int(kept.sum())} of the board's {len(kept)} corners are surrounded by pixels "
            "whose projector pixel is known: light all of the board, and expose longer"
        )
    places = np.array([one for one in carried if one is not None], np.float32)
    return Pose(board.points_m()[kept], camera_px[kept], places)


def _refined(shown: NDArray[np.floating], corners: NDArray[np.floating]) -> NDArray[np.float32]:
    """Corners where the gradients around each point at it (OpenCV's cornerSubPix).

    The detector's own fraction of a pixel is off by 0.08 to 0.15 px on squares of 11 to 22 px,
    enough for focal lengths 1.5 % too long; this is off by 0.04 px.
    """
    distances = np.hypot(*np.moveaxis(corners[:, np.newaxis] - corners, -1, 0))
    nearest = float(np.sort(distances, axis=1)[:, 1].min())
    reach = max(int(REFINED_WITHIN * nearest), 2)
    until = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)
    places = np.ascontiguousarray(corners, np.float32).reshape(-1, 1, 2)
    moved = cv2.cornerSubPix(
        (255 * shown).astype(np.float32), places, (reach, reach), (-1, -1), until
    )
    return np.asarray(moved, np.float32).reshape(-1, 2)


def _carried(
    corner: NDArray[np.float32], corners: NDArray[np.float32], seen: Correspondence
) -> Array | None:
    """A corner's place in the projector's picture, by the homography around it."""
    distances = np.hypot(*(corners - corner).T)
    reach = WINDOW * float(np.sort(distances)[1])
    height, width = seen.valid.shape
    left, top = (max(int(np.floor(one - reach)), 0) for one in corner)
    right, bottom = (int(np.ceil(one + reach)) + 1 for one in corner)
    window = slice(top, min(bottom, height)), slice(left, min(right, width))
    down, across = np.nonzero(seen.valid[window])
    if len(down) < LEAST_POINTS:
        return None
    here = np.stack([across + left, down + top], axis=1).astype(np.float64)
    there = np.stack([seen.column[window], seen.row[window]], axis=-1)[down, across]
    # Centred, so that the homography is well conditioned far from the origin.
    middle = there.mean(axis=0, dtype=np.float64)
    homography, inliers = cv2.findHomography(here - corner, there - middle, cv2.RANSAC, OUTLIER_PX)
    if homography is None or inliers.sum() < LEAST_POINTS:
        return None
    place: Array = homography[:2, 2] / homography[2, 2] + middle
    return place


def fit_poses(
    poses: Sequence[Pose], camera_px: tuple[int, int], projector_px: tuple[int, int]
) -> DevicePair:
    """Lenses of both devices and how they stand to each other.

    Parameters
    ----------
    poses
        At least three, tilted against each other.
    camera_px, projector_px
        (height, width).

    Raises
    ------
    UnsupportedError
        The poses are too few or too alike, or do not agree.
    """
    if len(poses) < LEAST_POSES:
        raise UnsupportedError(
            f"{len(poses)} poses of the board do not tell the lenses: capture at least "
            f"{LEAST_POSES}, better 6, tilted to all sides"
        )
    board = [pose.board_m for pose in poses]
    camera, tilts = _lens(board, [pose.camera_px for pose in poses], camera_px, "camera")
    tilt_deg = _widest(tilts)
    if tilt_deg < LEAST_TILT_DEG:
        raise UnsupportedError(
            f"the poses of the board differ by {tilt_deg:.0f}° at most, and the focal length "
            f"cannot be told from the distance: tilt it by {LEAST_TILT_DEG:.0f}° and more"
        )
    projector, _ = _lens(board, [pose.projector_px for pose in poses], projector_px, "projector")
    error, *_, rotation, translation, essential, fundamental = cv2.stereoCalibrate(
        board,
        [pose.camera_px for pose in poses],
        [pose.projector_px for pose in poses],
        camera.matrix,
        camera.distortion,
        projector.matrix,
        projector.distortion,
        camera_px[::-1],
        flags=cv2.CALIB_FIX_INTRINSIC,
    )
    if error > MOST_REPROJECTION_PX:
        raise UnsupportedError(
            f"corners miss their places by {error:.2f} px: the board is not flat, moved during a "
            "pose, or its squares are not square"
        )
    return DevicePair(
        camera, projector, np.asarray(rotation, np.float64), np.ravel(translation),
        np.asarray(essential), np.asarray(fundamental), float(error), tilt_deg,
    )  # fmt: skip


def _lens(
    board: list[NDArray[np.float32]],
    seen: list[NDArray[np.float32]],
    size_px: tuple[int, int],
    name: str,
) -> tuple[Lens, list[Array]]:
    """A device by itself, and the board's rotation in every pose."""
    try:
        error, matrix, distortion, turns, steps, deviations, *_ = cv2.calibrateCameraExtended(
            board, seen, size_px[::-1], np.eye(3), np.zeros(5), flags=FLAGS
        )
    except cv2.error as failed:
        raise UnsupportedError(f"the {name}'s lens cannot be told from these poses") from failed
    residuals = [
        np.reshape(cv2.projectPoints(points, turn, step, matrix, distortion)[0], (-1, 2)) - places
        for points, places, turn, step in zip(board, seen, turns, steps, strict=True)
    ]
    focal_deviation, centre_deviation = np.ravel(deviations)[:4].astype(np.float64).reshape(2, 2)
    focal = np.array([matrix[0, 0], matrix[1, 1]])
    if not np.all(focal_deviation < MOST_FOCAL_ERROR * focal):
        raise UnsupportedError(
            f"the {name}'s focal length is only known to {np.max(focal_deviation / focal):.0%}: "
            "the poses are too alike or too few; tilt the board more, to all sides, and fill the "
            "picture"
        )
    lens = Lens(
        np.asarray(matrix, np.float64), np.ravel(distortion)[:5].astype(np.float64),
        focal_deviation, centre_deviation,
        float(error), np.concatenate(residuals).astype(np.float64),
    )  # fmt: skip
    return lens, [np.asarray(cv2.Rodrigues(turn)[0], np.float64) for turn in turns]


def _widest(turns: list[Array]) -> float:
    """Largest angle between the board's normals, degrees."""
    normals = np.array([turn[:, 2] for turn in turns])
    return float(np.degrees(np.arccos(np.clip(normals @ normals.T, -1, 1)).max()))


def opencv_text(pair: DevicePair, camera_px: tuple[int, int], projector_px: tuple[int, int]) -> str:
    """The result as YAML that `cv2.FileStorage` reads; sizes are (width, height)."""
    file = cv2.FileStorage("geometry.yaml", cv2.FileStorage_WRITE | cv2.FileStorage_MEMORY)
    file.write("camera_size", np.array(camera_px[::-1]))
    file.write("camera_matrix", pair.camera.matrix)
    file.write("camera_distortion", pair.camera.distortion)
    file.write("projector_size", np.array(projector_px[::-1]))
    file.write("projector_matrix", pair.projector.matrix)
    file.write("projector_distortion", pair.projector.distortion)
    file.write("R", pair.rotation)
    file.write("T", pair.translation_m)
    file.write("E", pair.essential)
    file.write("F", pair.fundamental)
    file.write("reprojection_px", pair.reprojection_px)
    return str(file.releaseAndGetString())
