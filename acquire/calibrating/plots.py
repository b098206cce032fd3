"""Drawings of calibrations, in the style of the report."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import ScalarFormatter
from numpy.typing import NDArray

from acquire.report.figures import FAINT, PALETTE, Drawing, drawn, svg
from calibration.photon_transfer import NoiseLine, TransferPoints

Array = NDArray[np.float64]
RGB = (PALETTE[4], PALETTE[2], PALETTE[0])
NAMES = ("red", "green", "blue")


def _colours(count: int) -> tuple[tuple[str, str], ...]:
    return tuple(zip(NAMES, RGB, strict=True)) if count == 3 else ((("all"), "#22262b"),)


def _spread(axes: Axes, x: Array) -> None:
    """Powers of two apart alike where x goes over five of them and more, as pitches do."""
    if x.min() > 0 and x.max() >= 32 * x.min():
        axes.set_xscale("log", base=2)
        axes.xaxis.set_major_formatter(ScalarFormatter())


def points_plot(x: Array, y: Array, x_label: str, y_label: str) -> Drawing:
    """Points, (n,) against (n, colours)."""
    with drawn(5.7, 3.2) as (figure, axes):
        axes.axhline(0, color=FAINT, linewidth=0.8)
        for k, (name, colour) in enumerate(_colours(y.shape[1])):
            axes.plot(x, y[:, k], "o-", c=colour, ms=3, lw=1.2, label=name)
        _spread(axes, x)
        axes.set_xlabel(x_label)
        axes.set_ylabel(y_label)
        axes.grid(axis="y")
        if y.shape[1] > 1:
            axes.legend()
    finite = y[np.isfinite(y)]
    ends = f"{finite.min():.3g} to {finite.max():.3g}" if finite.size else "nothing"
    return Drawing(svg(figure), f"{y_label} against {x_label}: {ends}.")


def curves_plot(
    x: Array, measured: Array, fitted_x: Array, fitted: Array, x_label: str, y_label: str
) -> Drawing:
    """Points (n, colours) and the curves (m, colours) through them."""
    with drawn(5.7, 4.0) as (figure, axes):
        for k, (name, colour) in enumerate(_colours(measured.shape[1])):
            axes.plot(fitted_x, fitted[:, k], "-", c=colour, lw=1.2)
            axes.plot(x, measured[:, k], "o", c=colour, ms=3.5, label=name)
        _spread(axes, x)
        axes.set_xlabel(x_label)
        axes.set_ylabel(y_label)
        axes.grid(axis="y")
        if measured.shape[1] > 1:
            axes.legend()
    worst = float(np.nanmax(measured))
    return Drawing(svg(figure), f"{y_label} against {x_label}, up to {worst:.3g}.")


def noise_plot(points: Sequence[TransferPoints], lines: Sequence[NoiseLine]) -> Drawing:
    """Variance against signal and the fitted lines, both logarithmic."""
    with drawn(5.7, 4.0) as (figure, axes):
        for colour, line, (name, shade) in zip(points, lines, _colours(3), strict=True):
            seen = (colour.signal > 1e-3) & (colour.variance > 0)
            axes.plot(
                colour.signal[seen],
                colour.variance[seen],
                ".",
                c=shade,
                ms=4,
                alpha=0.6,
                label=name,
            )
            at = np.geomspace(1e-3, 1, 60)
            axes.plot(at, np.maximum(line.constant + line.rise * at, 1e-12), "-", c=shade, lw=1.2)
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlabel("signal, fraction of the sensor's range")
        axes.set_ylabel("variance, squared")
        axes.grid()
        axes.legend()
    rises = ", ".join(f"{line.rise:.3g}" for line in lines)
    return Drawing(svg(figure), f"Variance against signal; it rises by {rises}.")


def histogram_plot(values: NDArray[np.float32], x_label: str) -> Drawing:
    """How often each offset occurs, (…, colours), in per cent."""
    with drawn(5.7, 3.2) as (figure, axes):
        flat = 100 * values.reshape(-1, values.shape[-1]).astype(np.float64)
        spread = max(float(np.abs(flat).max()), 1e-3)
        for k, (name, colour) in enumerate(_colours(values.shape[-1])):
            axes.hist(
                flat[:, k], bins=np.linspace(-spread, spread, 81).tolist(), histtype="step",
                color=colour, label=name, log=True,
            )  # fmt: skip
        axes.set_xlabel(x_label)
        axes.set_ylabel("pixels")
        axes.legend()
    return Drawing(svg(figure), f"{x_label}, from {flat.min():.3g} to {flat.max():.3g}.")


def map_plot(values: NDArray[np.float32], label: str) -> Drawing:
    """A map of the picture, (height, width), NaN left white."""
    step = max(1, max(values.shape) // 400)
    with drawn(5.7, 4.4) as (figure, axes):
        shown = axes.imshow(values[::step, ::step], interpolation="nearest", cmap="viridis")
        axes.set_axis_off()
        figure.colorbar(shown, ax=axes, label=label, shrink=0.8)
    known = values[np.isfinite(values)]
    ends = f"{known.min():.1f} to {known.max():.1f}" if known.size else "unknown everywhere"
    return Drawing(svg(figure), f"{label}: {ends}.")


def scatter_plot(offsets: Array, unit: str) -> Drawing:
    """Offsets (n, 2), across and down, around nothing."""
    reach = 1.1 * max(float(np.abs(offsets).max()), 1e-3)
    with drawn(4.4, 4.0) as (figure, axes):
        axes.axhline(0, color=FAINT, linewidth=0.8)
        axes.axvline(0, color=FAINT, linewidth=0.8)
        axes.plot(offsets[:, 0], offsets[:, 1], ".", c=PALETTE[0], ms=4, alpha=0.6)
        axes.set_xlim(-reach, reach)
        axes.set_ylim(reach, -reach)
        axes.set_aspect("equal")
        axes.set_xlabel(f"across, {unit}")
        axes.set_ylabel(f"down, {unit}")
    rms = float(np.sqrt((offsets**2).sum(axis=1).mean()))
    return Drawing(svg(figure), f"{len(offsets)} offsets, {rms:.3g} {unit} root mean square.")
