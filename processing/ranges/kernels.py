"""How the compiled functions of this room are compiled.

Loops run over the last axis, without sums among it, so that they become vectors whose order of
operations, and bits, are those of every processor. Small functions are put where they are called:
at some ten numbers each, a call would cost more than the work. Division by 0 gives infinity.
"""

from __future__ import annotations

from numba import njit

compiled = njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
