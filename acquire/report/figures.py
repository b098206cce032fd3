"""The numbers of a result as drawings: mixing against pitch, PCA shares, convergence."""

from __future__ import annotations

import base64
import io
import math
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator
from numpy.typing import NDArray

from acquire.result import MixingRecord, PitchRecord

if TYPE_CHECKING:
    from matplotlib.typing import RcKeyType

# Okabe and Ito, Color Universal Design (2008).
PALETTE = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9", "#000000")
# Lines that stand for red, green and blue.
RGB_LINES = (PALETTE[4], PALETTE[2], PALETTE[0])
WIDE = 30
DASHES = ("-", "--", ":", "-.")
INK, FAINT = "#22262b", "#8a9097"
FONTS = "system-ui, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif"
STYLE: dict[RcKeyType, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "lumisplit",
    "font.size": 10,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.unicode_minus": True,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.major.width": 0.8,
    "ytick.major.width": 0.8,
    "grid.color": "#e4e6e8",
    "grid.linewidth": 0.8,
    "legend.frameon": False,
    "legend.fontsize": 10,
    "lines.solid_capstyle": "round",
}


@dataclass(frozen=True, slots=True)
class Drawing:
    """An SVG and what it shows in words."""

    svg: bytes
    alt: str

    @property
    def uri(self) -> str:
        """The drawing as a data URI."""
        return "data:image/svg+xml;base64," + base64.b64encode(self.svg).decode()


def colour_of(index: int) -> str:
    """The colour that stands for a component everywhere on the page."""
    return PALETTE[index % len(PALETTE)]


def mixing_drawing(mixing: MixingRecord, names: Sequence[str]) -> Drawing:
    """α against pitch: one thick line a component, its colours thin, white light at ∞."""
    alpha, widths = np.array(mixing.alpha), _half_widths(mixing)
    families = [family for family in dict.fromkeys(mixing.families) if family.is_separable]
    pitches = [pitch for pitch in mixing.pitch_px if pitch is not None]
    infinity = _place_of_infinity(pitches)
    x = np.array([infinity if pitch is None else pitch for pitch in mixing.pitch_px], float)
    with drawn(5.7, 4.4) as (figure, axes):
        axes.axhline(0, color=FAINT, linewidth=0.8)
        for dash, family in zip(DASHES * len(families), families, strict=False):
            rows = [k for k, kind in enumerate(mixing.families) if kind in {family, "white"}]
            rows.sort(key=lambda k: x[k])
            for index in range(len(names)):
                chosen = np.s_[:, rows, index]
                _draw_alpha(axes, x[rows], alpha[chosen], widths[chosen], colour_of(index), dash)
        for index, name in enumerate(names):
            axes.plot([], [], color=colour_of(index), linewidth=2.4, label=name)
        if len(families) > 1:
            for dash, family in zip(DASHES * len(families), families, strict=False):
                axes.plot([], [], color=INK, linestyle=dash, label=family.value)
        _label_pitches(axes, pitches, infinity)
        # However wide the intervals are: the lines fill the drawing.
        lowest, highest = min(float(alpha.min()), 0.0), max(float(alpha.max()), 1.0)
        axes.set_ylim(1.05 * lowest - 0.05 * highest, 1.05 * highest - 0.05 * lowest)
        axes.set_ylabel("α, share of the component in the direct image")
        figure.legend(loc="outside upper left", ncols=3, handlelength=1.8, columnspacing=1.6)
    return Drawing(svg(figure), _mixing_in_words(mixing, alpha, names))


def _is_wide(pitches: Sequence[int]) -> bool:
    """Whether pitches span more than a linear axis can show."""
    return bool(pitches) and max(pitches) > WIDE * min(pitches)


def _place_of_infinity(pitches: Sequence[int]) -> float:
    if not pitches:
        return 1.0
    if _is_wide(pitches):
        return float(max(pitches) * (max(pitches) / min(pitches)) ** 0.12)
    return max(pitches) + max(0.1 * (max(pitches) - min(pitches)), 0.15 * max(pitches))


def _half_widths(mixing: MixingRecord) -> NDArray[np.float64]:
    """Half of the intervals in the shape of α; NaN where there is none."""
    if mixing.half_width is None:
        return np.full(np.shape(mixing.alpha), np.nan)
    return np.array(mixing.half_width, dtype=np.float64)


def _draw_alpha(
    axes: Axes,
    x: NDArray[np.float64],
    alpha: NDArray[np.float64],
    widths: NDArray[np.float64],
    colour: str,
    dash: str,
) -> None:
    """Draw one component, alpha and its half intervals (colour, row); dotted to infinite pitch."""
    finite = len(x) - 1
    for line, width in zip(alpha[:, :finite], widths[:, :finite], strict=True):
        low, high = line - width, line + width
        axes.fill_between(x[:finite], low, high, color=colour, alpha=0.18, linewidth=0)
    for values, width, opacity in ((alpha, 0.8, 0.55), (alpha.mean(axis=0)[np.newaxis], 2.4, 1)):
        for line in values:
            axes.plot(x[:finite], line[:finite], dash, c=colour, lw=width, alpha=opacity)
            axes.plot(x[-2:], line[-2:], ":", c=colour, lw=width / 1.6, alpha=opacity)
    axes.plot(x[:finite], alpha.mean(axis=0)[:finite], "o", c=colour, ms=3)
    axes.plot(x[-1:], alpha.mean(axis=0)[-1:], "o", c=colour, ms=5, mfc="white", clip_on=False)


def _label_pitches(axes: Axes, pitches: Sequence[int], infinity: float) -> None:
    shown = sorted(set(pitches))
    if len(shown) > 8:
        shown = [shown[k] for k in np.linspace(0, len(shown) - 1, 8).round().astype(int)]
    if _is_wide(pitches):
        axes.set_xscale("log")
        axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xticks([*shown, infinity], [*(str(pitch) for pitch in shown), "∞\nwhite light"])
    axes.set_xlabel("pitch of the pattern in projector pixels")
    axes.grid(axis="y")


def _mixing_in_words(mixing: MixingRecord, alpha: NDArray[np.float64], names: Sequence[str]) -> str:
    rows = [k for k, pitch in enumerate(mixing.pitch_px) if pitch is not None]
    if not rows:
        return "Mixing against pitch: white light only."
    pitches = [mixing.pitch_px[k] or 0 for k in rows]
    first, last = rows[int(np.argmin(pitches))], rows[int(np.argmax(pitches))]
    mean, widths = alpha.mean(axis=0), _half_widths(mixing).mean(axis=0)

    def value(row: int, k: int) -> str:
        known = math.isfinite(widths[row, k])
        return f"{mean[row, k]:.2f}" + (f" ± {widths[row, k]:.2g}" if known else "")

    said = "; ".join(
        f"{name} from {value(first, k)} to {value(last, k)}" for k, name in enumerate(names)
    )
    return f"Mixing α between pitch {min(pitches)} and {max(pitches)} px, mean of colours: {said}."


def frames_drawing(pitches: Sequence[PitchRecord]) -> Drawing | None:
    """How the frames of each pitch agree with white; None without a white frame."""
    judged = [pitch for pitch in pitches if pitch.direct_peak is not None]
    if not judged:
        return None
    families = list(dict.fromkeys(pitch.family for pitch in judged))
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(5.7, 4.4), layout="constrained")
        axes, below = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
        for dash, family in zip(DASHES * len(families), families, strict=False):
            own = [pitch for pitch in judged if pitch.family is family]
            x = [pitch.pitch_px for pitch in own]
            y = [100 * (pitch.direct_peak or 0) for pitch in own]
            axes.plot(x, y, dash, c=INK, lw=1.6, label=family.value)
            for pitch, value in zip(own, y, strict=True):
                fill = INK if pitch.resolved else "white"
                axes.plot(
                    pitch.pitch_px, value, "o", c=PALETTE[0 if pitch.resolved else 4], mfc=fill
                )
            sums = [pitch for pitch in own if pitch.additivity_error is not None]
            errors = [100 * (pitch.additivity_error or 0) for pitch in sums]
            below.plot([pitch.pitch_px for pitch in sums], errors, f"o{dash}", c=INK, ms=3, lw=1.2)
        if _is_wide([pitch.pitch_px for pitch in judged]):
            axes.set_xscale("log")
            axes.xaxis.set_minor_locator(NullLocator())
        axes.set_ylabel("direct, % of white")
        axes.set_ylim(0, max(105, 1.05 * max(100 * (p.direct_peak or 0) for p in judged)))
        worst = max(abs(p.additivity_error or 0) for p in judged)
        below.set_ylim(-max(1, 120 * worst), max(1, 120 * worst))
        below.axhline(0, color=FAINT, linewidth=0.8)
        below.set_ylabel("sum − white, %")
        below.set_xlabel("pitch of the pattern in projector pixels")
        shown = sorted({pitch.pitch_px for pitch in judged})
        step = max(1, len(shown) // 8)
        below.set_xticks(shown[::step], [str(pitch) for pitch in shown[::step]])
        for panel in (axes, below):
            panel.grid(axis="y")
        if len(families) > 1:
            axes.legend(loc="lower right")
    unresolved = sum(not pitch.resolved for pitch in judged)
    return Drawing(
        svg(figure),
        f"Direct fraction of the most direct pixels against pitch; {unresolved} of {len(judged)} "
        f"pitches are not resolved. Complements miss white by {worst:.1%} at most.",
    )


def pca_drawing(shares: Sequence[float], kept: int, noise_share: float | None) -> Drawing:
    """Share of each principal component on a logarithmic axis, the kept ones filled.

    Parameters
    ----------
    shares
        Uncentred PCA shares, largest first, each in [0, 1].
    kept
        Number of components that were separated.
    noise_share
        Share that a component of noise alone would have; None when the noise is not known.
    """
    number = np.arange(1, len(shares) + 1)
    heights = np.maximum(np.array(shares, dtype=float), 1e-16)
    floor = min([float(heights.min()), *([noise_share] if noise_share else [])]) / 3
    with drawn(5.0, 2.5) as (figure, axes):
        axes.vlines(number, floor, heights, color="#cfd3d7", linewidth=1.2)
        axes.plot(number[:kept], heights[:kept], "o", c=INK, ms=5)
        axes.plot(number[kept:], heights[kept:], "o", c=FAINT, ms=5, mfc="white")
        axes.set_yscale("log")
        axes.set_ylim(floor, 3)
        axes.yaxis.set_major_locator(LogLocator(numticks=6))
        axes.yaxis.set_minor_locator(NullLocator())
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{100 * value:.3g} %"))
        axes.xaxis.set_major_locator(MaxNLocator(integer=True, nbins=8))
        axes.set_xlim(0.4, max(len(shares), kept) + 0.6)
        axes.grid(axis="y")
        axes.set_xlabel("principal component")
        axes.set_ylabel("share")
        if noise_share:
            axes.axhline(noise_share, color=PALETTE[4], linestyle="--", linewidth=1.2)
            axes.annotate(
                "noise alone", (1, noise_share), (-2, 4), xycoords=("axes fraction", "data"),
                textcoords="offset points", ha="right", color=PALETTE[4],
                bbox={"boxstyle": "square,pad=0.1", "fc": "white", "ec": "none"},
            )  # fmt: skip
    listed = ", ".join(f"{share:.2g}" for share in shares[: kept + 1])
    return Drawing(svg(figure), f"PCA shares, largest first: {listed}; {kept} were kept.")


def convergence_drawing(cost: Sequence[float]) -> Drawing:
    """Cost of the separation against the number of iterations."""
    with drawn(5.0, 2.5) as (figure, axes):
        axes.plot(range(len(cost)), cost, "o-", c=INK, ms=4, lw=1.6)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True, nbins=8))
        axes.yaxis.set_major_locator(MaxNLocator(nbins=5))
        axes.ticklabel_format(axis="y", useOffset=False)
        axes.grid(axis="y")
        axes.set_xlabel("iteration")
        axes.set_ylabel("cost")
    alt = f"The cost went from {cost[0]:.5g} to {cost[-1]:.5g} in {len(cost) - 1} iterations."
    return Drawing(svg(figure), alt)


@contextmanager
def drawn(width_in: float, height_in: float) -> Iterator[tuple[Figure, Axes]]:
    """An empty drawing in the page's style."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(width_in, height_in), layout="constrained")
        yield figure, figure.add_subplot()


def svg(figure: Figure) -> bytes:
    """Render the same bytes for the same numbers, the text in the fonts of the page."""
    file = io.BytesIO()
    nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    with mpl.rc_context(STYLE):
        figure.savefig(file, format="svg", transparent=True, metadata=nothing)
    text = file.getvalue().decode()
    return re.sub(r"(font: [\d.]+px) [^;\"]+", rf"\1 {FONTS}", text).encode()


def finite(values: Sequence[float]) -> bool:
    """Whether there is something to draw."""
    return bool(values) and all(math.isfinite(value) for value in values)
