"""Places spread evenly over a picture, but at no period that its texture could share."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_GOLDEN_SECTION = (5**0.5 - 1) / 2
# Usable pixels that tell a few numbers about a picture well enough.
_ENOUGH = 1 << 19


def sample_stride(mask: NDArray[np.bool_], axes: int = 2, enough: int = _ENOUGH) -> int:
    """Least stride, along one axis or both, that leaves no more than enough usable pixels.

    Parameters
    ----------
    mask
        bool, (height, width), True where a pixel is usable; at least one is.
    axes
        2 for lines and columns, 1 for lines alone.
    enough
        Pixels.
    """
    lines = np.count_nonzero(mask) / enough
    return int(np.ceil(lines if axes == 1 else np.sqrt(lines)))


def stratified(length: int, stride: int, turn: int = 0) -> NDArray[np.int64]:
    """One of every `stride` indices, at the places of Weyl's sequence of the golden section.

    Parameters
    ----------
    length
        The indices are 0 … length − 1.
    stride
        ≥ 1; with 1 every index is taken.
    turn
        Different ones for neighbouring lines, so that their columns differ.

    Returns
    -------
    (⌈length/stride⌉,), rising.
    """
    strata = np.arange(-(-length // stride))
    # Steps of the golden section to the side of a line, of its square from line to line.
    within = ((strata + _GOLDEN_SECTION * turn) * _GOLDEN_SECTION) % 1
    return np.minimum(stride * strata + (stride * within).astype(np.int64), length - 1)
