"""A picture's parts, each judged for itself: blocks, strips across it, the whole."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Parts:
    """A picture of n places, cut up.

    Parameters
    ----------
    labels
        int, (n,): the part, 0, 1 …, that a place lies in.
    """

    labels: NDArray[np.int64]

    @classmethod
    def grid(
        cls,
        places: tuple[NDArray[np.int64], NDArray[np.int64]],
        shape: tuple[int, int],
        counts: tuple[int, int],
    ) -> Parts:
        """Parts of places (row, column) when an image of `shape` is cut into (down, right)."""
        down, right = (places[axis] * counts[axis] // shape[axis] for axis in (0, 1))
        labels = down * counts[1] + right
        return cls(np.unique(labels, return_inverse=True)[1].astype(np.int64))

    @classmethod
    def whole(cls, n: int) -> Parts:
        """All of n places as one part."""
        return cls(np.zeros(n, np.int64))

    @property
    def sizes(self) -> NDArray[np.int64]:
        """Places of each part, (parts,)."""
        sizes: NDArray[np.int64] = np.bincount(self.labels)
        return sizes

    def sums(self, values: NDArray[np.floating]) -> NDArray[np.float64]:
        """Sums over each part, (…, parts), of values (…, n)."""
        rows = values.reshape(-1, values.shape[-1])
        sums = np.stack([np.bincount(self.labels, row) for row in rows]).astype(np.float64)
        return sums.reshape(*values.shape[:-1], -1)

    def means(self, values: NDArray[np.floating]) -> NDArray[np.float64]:
        """Means over each part, (…, parts), of values (…, n)."""
        means: NDArray[np.float64] = self.sums(values) / self.sizes
        return means
