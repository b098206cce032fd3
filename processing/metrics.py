"""How far an estimate of light is from the truth."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment


def relative_error(
    estimate: NDArray[np.float32], truth: NDArray[np.float32], mask: NDArray[np.bool_]
) -> float:
    """‖estimate − truth‖ / ‖truth‖ over usable pixels and all colours.

    Parameters
    ----------
    estimate, truth
        (height, width, colours), linear, in one unit.
    mask
        bool, (height, width), True where a pixel counts.

    Returns
    -------
    ≥ 0; NaN where the truth is dark everywhere, as nothing can be relative to it.
    """
    estimated, true = _usable(estimate, mask, truth), _usable(truth, mask, truth)
    return _ratio(np.linalg.norm(estimated - true), np.linalg.norm(true))


def relative_error_with_gains(
    estimate: NDArray[np.float32], truth: NDArray[np.float32], mask: NDArray[np.bool_]
) -> float:
    """`relative_error` after the single gain a colour that makes it least.

    A colour's residual at its best gain ⟨e, t⟩/⟨e, e⟩ is ‖t‖² − ⟨e, t⟩²/⟨e, e⟩.
    """
    estimated, true = _usable(estimate, mask, truth), _usable(truth, mask, truth)
    energy = np.sum(estimated**2, axis=0)
    gains = np.sum(estimated * true, axis=0) / np.where(energy > 0, energy, 1)
    return _ratio(np.linalg.norm(gains * estimated - true), np.linalg.norm(true))


@dataclass(frozen=True, slots=True)
class Assignment:
    """Which blind component is which true one.

    Parameters
    ----------
    components
        Index of the component for each truth, in the order of the truths.
    errors
        Relative error, after the best gain per colour, of each truth.
    """

    components: tuple[int, ...]
    errors: tuple[float, ...]


def best_assignment(
    components: NDArray[np.float32], truths: NDArray[np.float32], mask: NDArray[np.bool_]
) -> Assignment:
    """Match blind components to truths so that the sum of squared relative errors is least.

    Parameters
    ----------
    components
        (n, height, width, colours).
    truths
        (k, height, width, colours), k ≤ n, none of them dark everywhere.
    mask
        bool, (height, width), True where a pixel counts.
    """
    if len(truths) > len(components):
        raise ValueError(
            f"{len(components)} components cannot be matched to {len(truths)} truths: "
            f"shapes {components.shape} and {truths.shape}"
        )
    errors = np.array(
        [[relative_error_with_gains(one, truth, mask) for one in components] for truth in truths]
    )
    if np.isnan(errors).any():
        raise ValueError("a truth that is dark everywhere can be matched to anything; leave it out")
    order, chosen = linear_sum_assignment(errors**2)
    return Assignment(tuple(int(k) for k in chosen), tuple(float(e) for e in errors[order, chosen]))


@dataclass(frozen=True, slots=True)
class EstimateError:
    """How far one of several estimates is off.

    Parameters
    ----------
    index
        Which it is, in their order.
    error, error_after_gains
        `relative_error` and `relative_error_with_gains`.
    """

    index: int
    error: float
    error_after_gains: float


def errors_of(
    estimates: Iterable[NDArray[np.float32]],
    truth: NDArray[np.float32],
    mask: NDArray[np.bool_],
) -> tuple[EstimateError, ...]:
    """Errors of several estimates of one and the same light, of single pitches for example.

    Parameters
    ----------
    estimates
        (height, width, colours) each; taken one after the other, none is kept.
    truth
        (height, width, colours).
    mask
        bool, (height, width), True where a pixel counts.
    """
    return tuple(
        EstimateError(
            index,
            relative_error(estimate, truth, mask),
            relative_error_with_gains(estimate, truth, mask),
        )
        for index, estimate in enumerate(estimates)
    )


def oracle(errors: Iterable[EstimateError]) -> EstimateError:
    """The estimate with the least error, which only one who knows the truth can choose."""
    return min(errors, key=lambda one: one.error)


def _usable(
    image: NDArray[np.float32], mask: NDArray[np.bool_], truth: NDArray[np.float32]
) -> NDArray[np.float64]:
    if image.shape != truth.shape or image.shape[:2] != mask.shape:
        raise ValueError(
            f"estimate, truth and mask have shapes {image.shape}, {truth.shape} and {mask.shape}"
        )
    return image[mask].astype(np.float64)


def _ratio(error: np.floating, truth: np.floating) -> float:
    return float(error / truth) if truth > 0 else float("nan")
