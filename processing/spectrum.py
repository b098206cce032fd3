"""The spectrum of ranges of a pixel's light: non-negative least squares, compiled.

D(P), the correlation slope at pitch P, is the sum over all light of its response at P. With
x_r ≥ 0 the light of range r,

    D(P) = Σ_r A_r(P) x_r,    Σ_r x_r = white.

Each small problem is solved to its exact minimum by the active-set method of Lawson and Hanson
(Solving Least Squares Problems, 1974, chapter 23) on the normal equations.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.special import ndtri

# Gradients below this, relative to the right-hand side, count as zero.
_TOLERANCE = 1e-10
# Keeps nearly parallel responses solvable; relative to the mean diagonal.
RIDGE = 1e-9
_QUANTILES = 2000


@njit(cache=True)
def solve_spectrum(gram, moment, amounts, inverse):  # type: ignore[no-untyped-def]
    """Minimise xᵀ G x − 2 mᵀ x over x ≥ 0.

    Parameters
    ----------
    gram
        float64, (n, n), G = Aᵀ A of the weighted responses; n is small.
    moment
        float64, (n,), m = Aᵀ b.
    amounts
        float64, (n,), receives x.
    inverse
        float64, (n, n), receives the inverse of G over the positive x, 0 elsewhere: their
        covariance where the rows have unit variance.
    """
    n = len(moment)
    lift = RIDGE * np.trace(gram) / n
    least = _TOLERANCE * max(np.max(np.abs(moment)), 1e-300)
    passive = np.zeros(n, np.bool_)
    trial = np.zeros(n)
    amounts[:] = 0
    inverse[:] = 0
    for _ in range(3 * n):
        chosen, steepest = -1, least
        for k in range(n):
            if not passive[k]:
                slope = moment[k]
                for j in range(n):
                    slope -= gram[k, j] * amounts[j]
                if slope > steepest:
                    chosen, steepest = k, slope
        if chosen < 0:
            break
        passive[chosen] = True
        for _ in range(n):
            _solve_passive(gram, moment, passive, lift, trial, inverse)
            if _step_towards(trial, amounts, passive):
                break


@njit(cache=True)
def _step_towards(trial, amounts, passive):  # type: ignore[no-untyped-def]
    """Go to the trial as far as all stay ≥ 0; whether it was reached. What hits 0 is let go."""
    step, blocking = 1.0, -1
    for k in range(len(trial)):
        if passive[k] and trial[k] <= 0:
            reach = amounts[k] / (amounts[k] - trial[k]) if amounts[k] > 0 else 0.0
            if reach < step:
                step, blocking = reach, k
    if blocking < 0:
        amounts[:] = trial
        return True
    for k in range(len(trial)):
        if passive[k]:
            amounts[k] += step * (trial[k] - amounts[k])
    passive[blocking] = False
    amounts[blocking] = 0.0
    return False


@njit(cache=True)
def _solve_passive(gram, moment, passive, lift, trial, inverse):  # type: ignore[no-untyped-def]
    """Unconstrained minimum over the passive unknowns, and the inverse of their Gram matrix.

    Gauss–Jordan by hand: the matrix is positive definite and so small that a library's call
    would cost more than the work.
    """
    n = len(moment)
    members = np.empty(n, np.int64)
    count = 0
    for k in range(n):
        trial[k] = 0.0
        if passive[k]:
            members[count] = k
            count += 1
    small = np.empty((count, count))
    for a in range(count):
        for b in range(count):
            small[a, b] = gram[members[a], members[b]]
        small[a, a] += lift
    for p in range(count):
        _pivot(small, p)
    inverse[:] = 0
    for a in range(count):
        for b in range(count):
            inverse[members[a], members[b]] = small[a, b]
            trial[members[a]] += small[a, b] * moment[members[b]]


@njit(cache=True)
def _pivot(matrix, p):  # type: ignore[no-untyped-def]
    """One step of Gauss–Jordan inversion in place."""
    n = len(matrix)
    pivot = 1 / matrix[p, p]
    matrix[p, p] = 1.0
    for j in range(n):
        matrix[p, j] *= pivot
    for k in range(n):
        if k != p:
            factor = matrix[k, p]
            matrix[k, p] = 0.0
            for j in range(n):
                matrix[k, j] -= factor * matrix[p, j]


def diffusion_mixture(spread_px: NDArray[np.float64], range_px: float) -> NDArray[np.float64]:
    """Diffuse light as a mixture of Gaussian spreads.

    A point source in a scattering medium that is attenuated over a distance d shines as
    e^{−r/d}/(2π d r) on the surface (diffusion, Green's function), whose transform is
    1/√(1 + k²d²) = ∫ e^{−k²σ²/2} over σ = d |z| with z of the standard normal distribution. Each
    σ is shared out to the two spreads beside it, linearly in log σ; below the least spread,
    between it and 0, by its variance.

    Parameters
    ----------
    spread_px
        (n,), standard deviations, 0 first, then increasing and finite.
    range_px
        d in projector pixels.

    Returns
    -------
    (n,), ≥ 0, sum 1.
    """
    sigma = range_px * ndtri(0.5 + (np.arange(_QUANTILES) + 0.5) / (2 * _QUANTILES))
    least = spread_px[1]
    mixture = np.zeros(len(spread_px))
    short = sigma < least
    variance = (sigma[short] / least) ** 2
    mixture[:2] += np.sum(1 - variance), np.sum(variance)
    at = np.interp(np.log(sigma[~short]), np.log(spread_px[1:]), np.arange(1, len(spread_px)))
    below = np.minimum(at.astype(np.int64), len(spread_px) - 2)
    np.add.at(mixture, below, 1 - (at - below))
    np.add.at(mixture, below + 1, at - below)
    normalised: NDArray[np.float64] = mixture / mixture.sum()
    return normalised
