"""Calibration of the geometry: which projector pixel lights what, and both devices' lenses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from acquire.calibrating.finding import Finding, Plot, Setting
from acquire.calibrating.light import Viewer, lit_pixels
from acquire.calibrating.plots import histogram_plot, map_plot, scatter_plot
from acquire.errors import ProfileError
from acquire.plan import Plan, ProfileKind
from acquire.plan_file import BLACK, WHITE
from acquire.profile_file import Quantity, numbers
from acquire.session import Session
from calibration.errors import UnsupportedError
from calibration.geometry import Correspondence, correspondence
from calibration.poses import Chessboard, DevicePair, Lens, find_pose, fit_poses, opencv_text
from calibration.stripes import GrayCode, Phase, Sinusoids
from processing.patterns import Family, Pattern, gray_code, shift_grid

PITCH_PX, STEPS, FINEST = 8, 8, 2
# Green's two photosites surround the middle of a quad; red and blue lie beside it.
GREEN = 1
WARNED_DECODED = 0.9
Image = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class GeometryCalibration:
    """Gray code with complements and shifted sinusoids, along columns and rows."""

    kind: ProfileKind = "geometry"
    purpose: str = (
        "which projector pixel every camera pixel sees; the scene itself or, for the lenses, a "
        "printed chessboard, in several poses, a session each"
    )
    board: Chessboard | None = None

    def plan(self, setting: Setting, sessions: Sequence[Session]) -> Plan | None:
        """References around the sinusoids and the bits of both ways."""
        if sessions:
            return None
        patterns = [WHITE, WHITE, BLACK, BLACK]
        for rows in (False, True):
            patterns += _waves(rows=rows)
            for _, bit, complement in _bits(setting.resolution, rows=rows):
                patterns += [bit, complement]
        patterns += [WHITE, BLACK]
        # A session does not say by itself how large the projector is.
        projector = setting.projector.model_copy(update={"resolution_px": setting.resolution})
        return Plan(camera=setting.camera, projector=projector, patterns=tuple(patterns))

    def fit(self, sessions: Sequence[Session], frame_done: Callable[[], None]) -> Finding:
        """The correspondence of the last session; the lenses of all, where a board was named."""
        if self.board is None:
            if len(sessions) > 1:
                raise ProfileError(
                    f"{len(sessions)} sessions are poses of a chessboard: say which with --board "
                    "COLUMNSxROWS (inner corners) and --square-mm."
                )
            return _finding(_seen(sessions[0], frame_done), None)
        views, poses = [], []
        for session in sessions:
            view = _seen(session, frame_done)
            try:
                poses.append(find_pose(view.picture, view.places, self.board))
            except UnsupportedError as error:
                raise UnsupportedError(f"{session.folder}: {error}") from error
            views.append(view)
        sizes = {(view.picture.shape, view.resolution) for view in views}
        if len(sizes) != 1:
            raise UnsupportedError(f"the poses were taken by devices of different sizes: {sizes}")
        last = views[-1]
        height, width = last.picture.shape
        pair = fit_poses(poses, (height, width), last.resolution)
        return _finding(last, pair)


@dataclass(frozen=True, slots=True)
class _View:
    """What one session tells: light of all photosites under white, and the projector's places."""

    picture: Image
    places: Correspondence
    resolution: tuple[int, int]


def _waves(*, rows: bool) -> list[Pattern]:
    family = Family.SINUSOID_ROWS if rows else Family.SINUSOID_COLUMNS
    counts = (STEPS, 1) if rows else (1, STEPS)
    shifts = shift_grid(PITCH_PX, counts, (2, 2))
    return [Pattern(family, PITCH_PX, *shift) for shift in shifts]


def _bits(resolution: tuple[int, int], *, rows: bool) -> list[tuple[int, Pattern, Pattern]]:
    """Bits from the coarsest to that of cells a quarter of the sinusoids' period wide."""
    n_bits = max((resolution[0 if rows else 1] - 1).bit_length(), FINEST + 1)
    return [
        (
            bit,
            gray_code(bit, n_bits, rows=rows),
            gray_code(bit, n_bits, rows=rows, complement=True),
        )
        for bit in reversed(range(FINEST, n_bits))
    ]


def _seen(session: Session, frame_done: Callable[[], None]) -> _View:
    viewer = Viewer(session, frame_done)
    black, _ = viewer.mean(viewer.all_of(Family.BLACK))
    white, saturated = viewer.mean(viewer.all_of(Family.WHITE))
    light = white - black
    lit = lit_pixels(light, saturated)
    green = np.ascontiguousarray(light[..., GREEN])
    resolution = _resolution(session)
    along = []
    for rows in (False, True):
        phase = _phase(viewer, rows=rows)
        code = GrayCode(FINEST, phase, green)
        for bit, pattern, complement in _bits(resolution, rows=rows):
            code.add(bit, _green(viewer, pattern), _green(viewer, complement))
        along.append((phase, *code.places(resolution[0 if rows else 1])))
    (across, columns, across_good), (down, rows_, down_good) = along
    places = correspondence(
        (columns, rows_),
        across_good & down_good & ~saturated,
        np.maximum(across.deviation_px, down.deviation_px),
        lit,
        resolution,
    )
    return _View(_of_all_photosites(light, lit), places, resolution)


def _of_all_photosites(light: Image, lit: NDArray[np.bool_]) -> Image:
    """A picture for corners, (height, width), in which all photosites of a quad count.

    Two photosites of a quad see only half of it, and the print's edges stand where they see them.
    """
    level = np.percentile(light[lit], 99, axis=0) if lit.any() else np.ones(3)
    shares = np.array([0.25, 0.5, 0.25]) / np.maximum(level, 1e-30)
    return np.asarray(light @ shares, np.float32)


def _phase(viewer: Viewer, *, rows: bool) -> Phase:
    waves = Sinusoids(PITCH_PX, STEPS)
    for pattern in _waves(rows=rows):
        waves.add(_green(viewer, pattern), pattern.shift_y_px + pattern.shift_x_px)
    return waves.phase()


def _green(viewer: Viewer, pattern: Pattern) -> Image:
    frames = [frame for frame in viewer.session.frames if frame.pattern == pattern]
    if len(frames) != 1:
        raise ProfileError(
            f"{viewer.session.folder} holds {len(frames)} frames of {pattern}, not the one of "
            "`lumisplit calibrate geometry`; it was captured for something else."
        )
    _, image = next(iter(viewer.images(frames)))
    return np.ascontiguousarray(image.values[..., GREEN])


def _resolution(session: Session) -> tuple[int, int]:
    resolution = session.plan.projector.resolution_px
    if resolution is None:
        raise ProfileError(
            f"{session.folder} does not say how large the projector is; it was captured for "
            "something else."
        )
    return resolution


def _finding(view: _View, pair: DevicePair | None) -> Finding:
    seen = view.places
    quantities = {
        "decoded": Quantity(
            meaning="lit camera pixels whose projector pixel is known", unit="fraction",
            value=(seen.decoded,),
        ),
        "coverage": Quantity(
            meaning="part of the projector's picture that they see", unit="fraction",
            value=(seen.coverage,),
        ),
        "camera_px_per_projector_px": Quantity(
            meaning="camera pixels that see one projector pixel, median of the area", unit="",
            value=numbers(seen.camera_px_per_projector_px),
        ),
        "place_deviation_px": Quantity(
            meaning="standard error of a place from noise, median", unit="projector px",
            value=numbers(float(np.nanmedian(seen.deviation_px))),
        ),
    }  # fmt: skip
    plots = [
        Plot("Columns", map_plot(seen.column, "projector column"),
             "Which projector column each camera pixel sees; white: unknown."),
        Plot("Rows", map_plot(seen.row, "projector row"), "The same for rows."),
        Plot("Error of the places",
             histogram_plot(seen.deviation_px[seen.valid][:, np.newaxis], "% of a projector px"),
             "Standard error from the noise of the frames, of columns or rows, the larger."),
    ]  # fmt: skip
    warnings = []
    if seen.decoded < WARNED_DECODED:
        warnings.append(
            f"{1 - seen.decoded:.0%} of the lit pixels have no projector pixel: light from "
            "elsewhere in the scene outweighs their own, they are noisy, or see a depth edge."
        )
    beside = {}
    if pair is not None:
        quantities |= _lens_quantities(pair)
        plots += [
            Plot("What is left of the corners, camera",
                 scatter_plot(pair.camera.residuals_px, "camera px"),
                 "Corner as projected by the fit, less as seen."),
            Plot("What is left of the corners, projector",
                 scatter_plot(pair.projector.residuals_px, "projector px"), "The same."),
        ]  # fmt: skip
        height, width = view.picture.shape
        beside[".yaml"] = opencv_text(pair, (height, width), view.resolution)
    return Finding(
        quantities=quantities,
        maps={"column": seen.column, "row": seen.row, "deviation_px": seen.deviation_px},
        warnings=tuple(warnings),
        plots=tuple(plots),
        beside=beside,
    )


def _lens_quantities(pair: DevicePair) -> dict[str, Quantity]:
    found = {
        "reprojection_px": Quantity(
            meaning="what is left of the board's corners, root mean square over both devices",
            unit="px", value=(pair.reprojection_px,), role="residual",
        ),
        "tilt_deg": Quantity(
            meaning="widest angle between two poses", unit="degrees", value=(pair.tilt_deg,)
        ),
        "rotation": Quantity(
            meaning="camera to projector, (3, 3) row by row", unit="", value=numbers(pair.rotation),
            role="detail",
        ),
        "translation_m": Quantity(
            meaning="camera to projector", unit="m", value=numbers(pair.translation_m),
            role="detail",
        ),
    }  # fmt: skip
    for name, lens in (("camera", pair.camera), ("projector", pair.projector)):
        found |= _of_lens(name, lens)
    return found


def _of_lens(name: str, lens: Lens) -> dict[str, Quantity]:
    focal = np.array([lens.matrix[0, 0], lens.matrix[1, 1]])
    return {
        f"{name}_focal_px": Quantity(
            meaning="focal lengths across and down", unit="px", value=numbers(focal),
            uncertainty=numbers(lens.focal_deviation_px),
        ),
        f"{name}_centre_px": Quantity(
            meaning="principal point, column and row", unit="px", value=numbers(lens.matrix[:2, 2]),
            uncertainty=numbers(lens.centre_deviation_px),
        ),
        f"{name}_distortion": Quantity(
            meaning="OpenCV's k1, k2, p1, p2, k3; only k1 is fitted", unit="",
            value=numbers(lens.distortion), role="detail",
        ),
        f"{name}_reprojection_px": Quantity(
            meaning="what is left of the corners, this device by itself", unit="px",
            value=(lens.reprojection_px,), role="residual",
        ),
    }  # fmt: skip
