"""Independent vector analysis by auxiliary functions (AuxIVA-IP; Ono, WASPAA 2011), real data.

The model: in every sample the colours of one source form a vector with the spherical Laplace
density p(y) ∝ exp(−‖y‖), the sources are independent, and each colour c mixes them by a matrix
of its own. With y = W_c x_c and r_k = ‖(y_k1, …, y_kC)‖ the cost per sample is

    J(W) = ⟨Σ_k h(r_k)⟩ − Σ_c log |det W_c|,

with h(r) = r but for r below the floor ε, where h(r) = r²/(2ε) + ε/2 (Huber's function plus
ε/2). Its auxiliary weight h'(r)/r = 1/max(r, ε) makes one sweep over the sources, each row of
each W_c set to its minimum in turn, a descent of J.

With two or more colours samples near zero have little influence (their density falls as r^(C−1),
faster than 1/r grows) and the floor, 1e-12 of the largest mixtures, only guards the division. With
one colour the influence of samples near zero diverges logarithmically as ε falls, so the unmixing
would hang on accidents of single samples: there the floor is 1 % of the mean r of the mixtures.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeAlias

import numba
import numpy as np
from numpy.typing import NDArray

from processing.numerics.linear_algebra import log_determinant, product, solved

_FLOOR_ONE_COLOR = 1e-2
_GUARD = 1e-12
# A chunk's intermediate values stay in the first-level cache; blocks are what threads share out.
_CHUNK_SAMPLES = 256
# Sums that run beside each other.
_LANES = _CHUNK_SAMPLES // 8
_BLOCK_SAMPLES = 32 * _CHUNK_SAMPLES
# Of this many blocks together a thread takes its share.
_TOGETHER = 8

Mixtures: TypeAlias = NDArray[np.float32] | NDArray[np.float64]
# Like `map`.
_Each: TypeAlias = Callable[[Callable[[int], None], Iterable[int]], Iterable[None]]


@dataclass(frozen=True, slots=True)
class AuxivaResult:
    """Unmixing found by AuxIVA and the record of its convergence.

    Parameters
    ----------
    unmixing
        float64, (n_colors, n_components, n_components); row k of each colour yields source k.
        Order, sign and scale of the sources are arbitrary.
    cost
        float64, (n_iterations + 1,), J per sample at the identity and after each iteration;
        never rises.
    """

    unmixing: NDArray[np.float64]
    cost: NDArray[np.float64]


def auxiva(
    mixtures: Mixtures, n_iterations: int = 10, *, n_threads: int | None = None
) -> AuxivaResult:
    """Unmix independent vectors, from the identity, one sweep over the sources an iteration.

    Each iteration reads the data once: r of the rows that a sweep has yet to change is known at
    its beginning, so the weighted covariances of all sources come from the same read. Sums are
    taken over fixed blocks in a fixed order; neither the number of threads nor the processor
    changes a bit.

    Parameters
    ----------
    mixtures
        Real float32 or float64, (n_colors, n_components, n_samples), finite, without mean (as
        gradients are); nothing is whitened here. The arithmetic is float64 for both: in float32
        cancellation near r = 0 spoils the weights and lets J rise.
    n_iterations
        Sweeps, ≥ 0.
    n_threads
        As many as numba would use, if it is not given; 1 starts none.

    Returns
    -------
    AuxivaResult
        Rows are scaled as J demands; an overall gain of the mixtures changes nothing else.

    Raises
    ------
    ValueError
        For a wrong shape or type, values that are not finite, or a weighted covariance that is
        singular because mixtures of a colour depend on each other.
    """
    _check(mixtures, n_iterations)
    data: Mixtures = np.require(mixtures, requirements="C")
    n_threads = n_threads or numba.get_num_threads()
    if n_threads == 1:
        return _descended(data, n_iterations, map)
    with ThreadPoolExecutor(n_threads, thread_name_prefix="auxiva") as threads:
        return _descended(data, n_iterations, threads.map)


def _descended(data: Mixtures, n_iterations: int, each: _Each) -> AuxivaResult:
    n_colors, n_components, _ = data.shape
    unmixing = np.tile(np.eye(n_components), (n_colors, 1, 1))
    unit = _magnitude(data)
    floor = _GUARD
    if n_colors == 1:
        penalty = _statistics(data, unmixing / unit, floor, each)[0]
        floor = _FLOOR_ONE_COLOR * penalty / n_components
    penalty, covariances = _statistics(data, unmixing / unit, floor, each)
    if not np.isfinite(penalty):
        raise ValueError("mixtures hold values that are not finite")
    cost = np.empty(n_iterations + 1)
    cost[0] = unit * penalty
    # The gain at which J of the scaled identity is least: from here on r has the scale that the
    # model gives it, whatever the unit of the mixtures, and one floor serves all iterations.
    gain = n_colors * n_components / penalty
    unmixing *= gain / unit
    floor *= gain
    covariances /= gain
    for iteration in range(1, n_iterations + 1):
        unmixing = _swept(unmixing, covariances)
        more = iteration < n_iterations
        penalty, covariances = _statistics(data, unmixing, floor, each, with_covariances=more)
        cost[iteration] = penalty - sum(map(log_determinant, unmixing))
    return AuxivaResult(unmixing, cost)


def _check(mixtures: Mixtures, n_iterations: int) -> None:
    if mixtures.ndim != 3 or 0 in mixtures.shape:
        raise ValueError(
            "mixtures must be (n_colors, n_components, n_samples), not empty; "
            f"their shape is {mixtures.shape}"
        )
    if mixtures.dtype not in (np.float32, np.float64):
        raise ValueError(f"mixtures must be float32 or float64, not {mixtures.dtype}")
    if mixtures.shape[2] < mixtures.shape[1]:
        raise ValueError(
            f"{mixtures.shape[2]} samples cannot tell {mixtures.shape[1]} components apart; "
            f"mixtures have shape {mixtures.shape}"
        )
    if n_iterations < 0:
        raise ValueError(f"n_iterations must be at least 0, not {n_iterations}")


def _magnitude(mixtures: Mixtures) -> float:
    """Largest absolute value of some thousand samples: a unit in which r is of order 1."""
    some = mixtures[..., :: max(1, mixtures.shape[2] // 4096)]
    for samples in (some, mixtures):
        largest = float(np.abs(samples).max())
        if not np.isfinite(largest):
            raise ValueError("mixtures hold values that are not finite")
        if largest > 0:
            return largest
    raise ValueError("mixtures hold nothing but zeros")


def _swept(unmixing: NDArray[np.float64], covariances: NDArray[np.float64]) -> NDArray[np.float64]:
    """Set each row in turn to the minimum of the auxiliary function (Ono 2011, eq. 12-14).

    Row w_k of a colour becomes (W V_k)^-1 e_k, scaled to w_k' V_k w_k = 1.
    """
    unmixing = unmixing.copy()
    n_colors, n_components, _ = unmixing.shape
    for component, unit in enumerate(np.eye(n_components)):
        covariance = covariances[component]
        try:
            row = np.stack([solved(one, unit) for one in product(unmixing, covariance)])
        except np.linalg.LinAlgError:
            row = np.full((n_colors, n_components), np.nan)
        energy = np.sum(row[:, :, np.newaxis] * covariance * row[:, np.newaxis], axis=(1, 2))
        if not (np.all(np.isfinite(energy)) and np.all(energy > 0)):
            raise ValueError(
                f"the {n_components} mixtures of a colour depend on each other, so they cannot "
                "be unmixed; ask for fewer components"
            )
        unmixing[:, component] = row / np.sqrt(energy)[:, np.newaxis]
    return unmixing


def _statistics(
    mixtures: Mixtures,
    unmixing: NDArray[np.float64],
    floor: float,
    each: _Each,
    *,
    with_covariances: bool = True,
) -> tuple[float, NDArray[np.float64]]:
    """Mean of Σ_k h(r_k), and weighted covariances ⟨x x'/max(r_k, ε)⟩, in one read.

    Without covariances, which the last iteration has no use for, zeros stand in for them.

    Returns
    -------
    penalty, covariances
        The latter (n_components, n_colors, n_components, n_components).
    """
    n_colors, n_components, n_samples = mixtures.shape
    n_blocks = -(-n_samples // _BLOCK_SAMPLES)
    sums = np.zeros((n_blocks, n_components, n_colors, n_components, n_components))
    penalties = np.zeros(n_blocks)
    # The length of a tuple is part of its type: loops over it are unrolled when compiled.
    components = (0,) * n_components
    model = (unmixing, floor, components)

    def accumulate(first: int) -> None:
        end = min(first + _TOGETHER, n_blocks)
        _accumulate(mixtures, first, end, model, with_covariances, sums, penalties)

    for _ in each(accumulate, range(0, n_blocks, _TOGETHER)):
        pass
    lower = sums.sum(axis=0) / n_samples
    strictly_lower = np.tril(lower, -1)
    return float(penalties.sum() / n_samples), lower + strictly_lower.swapaxes(-1, -2)


# Sums run in lanes of fixed number and nothing is contracted: vectors of any width give the same
# bits.
_compiled = numba.njit(cache=True, error_model="numpy")


@numba.njit(nogil=True, cache=True)
def _accumulate(  # type: ignore[no-untyped-def]
    mixtures, first, end, model, with_covariances, sums, penalties
):
    """Sum h(r_k) and the lower triangles of x x'/max(r_k, ε) over each block of samples."""
    for block in range(first, end):
        penalties[block] = _add_block(mixtures, block, model, with_covariances, sums[block])


@_compiled
def _add_block(mixtures, block, model, with_covariances, sums):  # type: ignore[no-untyped-def]
    n_colors, n_components, n_samples = mixtures.shape
    chunk = np.empty((n_colors, n_components, _CHUNK_SAMPLES))
    weights = np.empty((n_components, _CHUNK_SAMPLES))
    penalties = np.zeros(_LANES)
    lanes = np.zeros((n_components, n_colors, n_components, n_components, _LANES))
    block_end = min((block + 1) * _BLOCK_SAMPLES, n_samples)
    for start in range(block * _BLOCK_SAMPLES, block_end, _CHUNK_SAMPLES):
        end = min(start + _CHUNK_SAMPLES, block_end)
        _load(mixtures, start, end, chunk)
        _weigh(chunk, model, weights, penalties)
        if with_covariances:
            _add_covariances(chunk, weights, lanes)
    for c in range(n_colors):
        for i in range(n_components):
            for j in range(i + 1):
                for k in range(n_components):
                    sums[k, c, i, j] = _total(lanes[k, c, i, j])
    # What fills up the last chunk weighs as much as the floor.
    filled = -(block_end - block * _BLOCK_SAMPLES) % _CHUNK_SAMPLES
    return (_total(penalties) - filled * n_components * model[1]) / 2


@_compiled
def _total(lanes):  # type: ignore[no-untyped-def]
    total = 0.0
    for i in range(_LANES):
        total += lanes[i]
    return total


@_compiled
def _load(mixtures, start, end, chunk):  # type: ignore[no-untyped-def]
    """Copy samples as float64; the last chunk is filled up with zeros, which weigh nothing."""
    for c in range(chunk.shape[0]):
        for i in range(chunk.shape[1]):
            source = mixtures[c, i, start:end]
            target = chunk[c, i]
            for n in range(source.size):
                target[n] = source[n]
            target[source.size :] = 0.0


@_compiled
def _weigh(chunk, model, weights, penalties):  # type: ignore[no-untyped-def]
    """Fill weights, (n_components, samples), with 1/max(r_k, ε); add 2 h(r_k) to the lanes."""
    unmixing, floor, components = model
    least = floor * floor
    one = np.float32(1)
    for k in range(len(components)):
        energy = weights[k]
        energy[:] = 0.0
        for c in range(chunk.shape[0]):
            for n in range(_CHUNK_SAMPLES):
                source = 0.0
                for i in range(len(components)):
                    source += unmixing[c, k, i] * chunk[c, i, n]
                energy[n] += source * source
        for first in range(0, _CHUNK_SAMPLES, _LANES):
            some = energy[first : first + _LANES]
            for n in range(_LANES):
                floored = some[n] if some[n] > least else least
                # The root in float32, then a step of Newton's, is right to 1e-14 and half the work.
                weight = np.float64(one / np.sqrt(np.float32(floored)))
                weight *= 1.5 - 0.5 * floored * weight * weight
                penalties[n] += (some[n] + floored) * weight
                some[n] = weight


@_compiled
def _add_covariances(chunk, weights, sums):  # type: ignore[no-untyped-def]
    """Add the weighted products of mixtures i ≥ j of each colour to the lanes sums[k, c, i, j]."""
    n_colors, n_components, _ = chunk.shape
    p = np.empty(_CHUNK_SAMPLES)
    for c in range(n_colors):
        for i in range(n_components):
            for j in range(i + 1):
                for n in range(_CHUNK_SAMPLES):
                    p[n] = chunk[c, i, n] * chunk[c, j, n]
                for k in range(n_components):
                    # Eight products a lane: its sum is loaded once for all.
                    for n in range(_LANES):
                        sums[k, c, i, j, n] += (
                            (p[n] * weights[k, n] + p[n + _LANES] * weights[k, n + _LANES])
                            + (
                                p[n + 2 * _LANES] * weights[k, n + 2 * _LANES]
                                + p[n + 3 * _LANES] * weights[k, n + 3 * _LANES]
                            )
                        ) + (
                            (
                                p[n + 4 * _LANES] * weights[k, n + 4 * _LANES]
                                + p[n + 5 * _LANES] * weights[k, n + 5 * _LANES]
                            )
                            + (
                                p[n + 6 * _LANES] * weights[k, n + 6 * _LANES]
                                + p[n + 7 * _LANES] * weights[k, n + 7 * _LANES]
                            )
                        )
