# %% [markdown]
# # Taking a scene apart in Python
#
# `processing` needs arrays and nothing else: no session, no camera, no command line. Here the
# frames come from the simulated bench, so that the truth is known; yours come from wherever you
# have them, as float32 (height, width, colours), linear in light, black frame subtracted.
#
# Runs as it is (`python docs/worked_example.py PICTURES`), or cell by cell in an editor or notebook
# that knows the percent format.

# %%
from __future__ import annotations

import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np

from drivers.protocols import CameraSettings
from drivers.raw import decode_raw
from drivers.sim.defects import Defects
from drivers.sim.devices import SimulationConfig, build
from processing.independence.decomposition import decompose_iva
from processing.frames.gathering import HarmonicsStack
from processing.metrics import relative_error
from processing.patterns import Family, Pattern, shift_grid
from processing.ranges.decomposition import decompose_ranges
from processing.frames.separation import ExtremaSeparation

mpl.use("agg")
from matplotlib import pyplot as plt

PICTURES = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("worked-example")
CAMERA_PX = (int(sys.argv[2]), int(sys.argv[2])) if len(sys.argv) > 2 else (96, 96)
PROJECTOR_PX = 288, 384
PITCHES_PX = 8, 10, 12, 14, 16, 20, 24, 30, 36, 42, 48, 56, 64, 72

# %% [markdown]
# ## A camera and a projector
#
# A corner with a translucent plate in its floor; 20 000 electrons full well, 5 electrons read
# noise.

# %%
defects = Defects(full_well_e=20_000, read_noise_e=5)
bench = build(SimulationConfig("corner", 0, CAMERA_PX, PROJECTOR_PX, defects))
settings = CameraSettings(exposure_s=0.1, aperture=8.0, iso=200)


def photograph(pattern: Pattern) -> tuple[np.ndarray, np.ndarray]:
    """Linear light, (height, width, 3), and where it saturated the sensor."""
    bench.projector.show(pattern.raster(PROJECTOR_PX))
    image = decode_raw(bench.camera.capture(settings).data)
    return image.values, image.saturated


black, saturated = photograph(Pattern(Family.BLACK))
white, too_bright = photograph(Pattern(Family.WHITE))
saturated |= too_bright
white = white - black

# %% [markdown]
# ## Every frame once
#
# A checker of each pitch is shown at 6 × 6 places. Each frame goes to two gatherers and is then
# dropped: `ExtremaSeparation` keeps the largest and the smallest value of each pixel,
# `HarmonicsStack` four images a pitch.

# %%
patterns = [
    Pattern(Family.CHECKER, pitch_px, *shift)
    for pitch_px in PITCHES_PX
    for shift in shift_grid(pitch_px, (6, 6))
]
extrema = {pitch_px: ExtremaSeparation(white.shape) for pitch_px in PITCHES_PX}
stack = HarmonicsStack(patterns, white.shape, PROJECTOR_PX)
for pattern in patterns:
    frame, too_bright = photograph(pattern)
    saturated |= too_bright
    frame = frame - black
    extrema[pattern.pitch_px].add(frame)
    stack.add(frame, pattern)
mask = (white.max(axis=-1) > 0.01 * np.percentile(white, 99.5)) & ~saturated

# %% [markdown]
# ## One pitch
#
# Max minus min is direct light, twice min is global light (Nayar et al. 2006). How good that is
# depends on a pitch that nobody tells you: too fine, and blur takes direct light away; too coarse,
# and scattered light still follows the pattern.

# %%
truth = {name: part.astype(np.float32) for name, part in bench.truth().items()}
direct_at = {pitch_px: one.separate(white).direct_light for pitch_px, one in extrema.items()}
for pitch_px, direct in direct_at.items():
    print(
        f"{pitch_px:3d} px: direct light off by {relative_error(direct, truth['direct'], mask):.3f}"
    )

# %% [markdown]
# ## All pitches
#
# `decompose_ranges` fits every pixel's light by the distance over which it travelled.

# %%
found = decompose_ranges(stack, mask)
components = dict(zip(found.names, found.components, strict=True))
errors = dict(zip(found.names, found.deviations, strict=True))
for name, image in components.items():
    inside = np.abs(image - truth[name])[mask] <= errors[name][mask]
    print(
        f"{name}: off by {relative_error(image, truth[name], mask):.3f}; the truth lies within one "
        f"standard error at {inside.mean():.0%} of the values"
    )
print("blur of each colour, projector pixels:", [f"{b.side_px2**0.5:.2f}" for b in found.blur])
for warning in found.warnings:
    print(warning)

# %%
PICTURES.mkdir(parents=True, exist_ok=True)
figure, axes = plt.subplots(3, len(components), figsize=(3 * len(components), 9), squeeze=False)
for column, (name, image) in zip(axes.T, components.items(), strict=True):
    shown = {name: image, "truth": truth[name], "standard error × 5": 5 * errors[name]}
    bright = np.percentile(truth[name][mask], 99)
    for axis, (title, one) in zip(column, shown.items(), strict=True):
        axis.imshow(np.clip(one / bright, 0, 1) ** (1 / 2.2))
        axis.set_title(title)
        axis.axis("off")
figure.tight_layout()
figure.savefig(PICTURES / "worked-components.png", dpi=80)

# %% [markdown]
# How much of each component still follows a pattern of a pitch: the mean over the scene with its
# 95 % interval, freed from blur. Direct light is 1 at every pitch by definition.

# %%
figure, axis = plt.subplots(figsize=(6, 3.5))
for k, name in enumerate(found.names):
    alpha, half = found.mixing[1, :-1, k], found.mixing_half_width[1, :-1, k]
    axis.errorbar(PITCHES_PX, alpha, half, marker="o", capsize=3, label=name)
axis.set(xscale="log", xlabel="pitch, projector pixels", ylabel="α (green)", ylim=(-0.05, 1.1))
axis.set_xticks(PITCHES_PX, [str(pitch) for pitch in PITCHES_PX])
axis.minorticks_off()
axis.legend()
figure.tight_layout()
figure.savefig(PICTURES / "worked-alpha.png", dpi=80)

# %% [markdown]
# ## The paper's method
#
# Independent vector analysis of the direct images (Subpa-asa et al.) knows nothing of the patterns
# and names what it finds only where α allows it.

# %%
rows = [*direct_at.values(), white]
blind = decompose_iva(rows, [*PITCHES_PX, np.inf], mask, n_components=3)
print(blind.names, "principal components hold", np.array2string(blind.shares[:4], precision=2))
for warning in blind.warnings:
    print(warning)
