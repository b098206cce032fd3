"""The spectrum of ranges of a pixel's light: non-negative least squares, compiled.

D(P), the correlation slope at pitch P, is the sum over all light of its response at P. With
x_r ≥ 0 the light of range r,

    D(P) = Σ_r A_r(P) x_r,    Σ_r x_r = white.

Each small problem is solved to its exact minimum on the normal equations by the active sets of
Lawson and Hanson (Solving Least Squares Problems, 1974, chapter 23), from a guess, such as what a
neighbour came to, instead of from 0: what the guess makes negative is let go until nothing is,
which is a feasible beginning. Exchanging many unknowns at once (block principal pivoting) goes in
circles among the nearly parallel responses of neighbouring ranges.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from processing.numerics.elementary import deviate, log
from processing.ranges.kernels import compiled

# Gradients below this, relative to the right-hand side, count as zero.
_TOLERANCE = 1e-10
# Keeps nearly parallel responses solvable; relative to the mean diagonal.
RIDGE = 1e-9
_QUANTILES = 2000


@compiled
def solve_spectrum(  # type: ignore[no-untyped-def]
    gram, moment, passive, amounts, factor, members, trial
):  # fmt: skip
    """Minimise xᵀ G x − 2 mᵀ x over x ≥ 0.

    Parameters
    ----------
    gram
        float64, (n, n), G = Aᵀ A of the weighted responses; n is small.
    moment
        float64, (n,), m = Aᵀ b.
    passive
        bool, (n,): which x are guessed to be positive; receives which are.
    amounts
        float64, (n,), receives x.
    factor, members
        float64, (n, n), and int64, (n,), receive what `solve_passive` takes.
    trial
        float64, (n,), to work on.

    Returns
    -------
    Number of positive x.
    """
    n = len(moment)
    trace, largest = 0.0, 1e-300
    for k in range(n):
        trace += gram[k, k]
        largest = max(largest, abs(moment[k]))
    lift, least = RIDGE * trace / n, _TOLERANCE * largest
    count = _begin(gram, moment, lift, passive, amounts, factor, members)
    for _ in range(3 * n):
        chosen, steepest = -1, least
        for k in range(n):
            if not passive[k]:
                slope = moment[k]
                for c in range(count):
                    slope -= gram[k, members[c]] * amounts[members[c]]
                if slope > steepest:
                    chosen, steepest = k, slope
        if chosen < 0:
            break
        passive[chosen] = True
        for _ in range(n):
            count = _factorise(gram, lift, passive, factor, members)
            solve_passive(factor, members, count, moment, trial)
            if _step_towards(trial, amounts, passive):
                break
    return count


@compiled
def _begin(gram, moment, lift, passive, amounts, factor, members):  # type: ignore[no-untyped-def]
    """Solve with what is guessed to be positive, and let go what is not, until nothing is left."""
    negative = True
    while negative:
        count = _factorise(gram, lift, passive, factor, members)
        solve_passive(factor, members, count, moment, amounts)
        negative = False
        for c in range(count):
            if amounts[members[c]] < 0:
                passive[members[c]] = False
                negative = True
    return count


@compiled
def _step_towards(trial, amounts, passive):  # type: ignore[no-untyped-def]
    """Go to the trial as far as all stay ≥ 0; whether it was reached. What hits 0 is let go."""
    step, blocking = 1.0, -1
    for k in range(len(trial)):
        if passive[k] and trial[k] <= 0:
            reach = amounts[k] / (amounts[k] - trial[k]) if amounts[k] > 0 else 0.0
            if reach < step:
                step, blocking = reach, k
    if blocking < 0:
        # A slice would have the compiler add words for two shapes that differ, for seconds.
        for k in range(len(trial)):
            amounts[k] = trial[k]
        return True
    for k in range(len(trial)):
        if passive[k]:
            amounts[k] += step * (trial[k] - amounts[k])
    passive[blocking] = False
    amounts[blocking] = 0.0
    return False


@compiled
def solve_passive(factor, members, count, right, solution):  # type: ignore[no-untyped-def]
    """Solve with G over the positive x alone; 0 elsewhere.

    Parameters
    ----------
    factor, members, count
        Of `solve_spectrum`.
    right, solution
        float64, (n,); the latter is written.
    """
    solution[:] = 0
    for a in range(count):
        value = right[members[a]]
        for b in range(a):
            value -= factor[a, b] * solution[members[b]]
        solution[members[a]] = value * factor[a, a]
    for a in range(count - 1, -1, -1):
        value = solution[members[a]]
        for b in range(a + 1, count):
            value -= factor[b, a] * solution[members[b]]
        solution[members[a]] = value * factor[a, a]


@compiled
def _factorise(gram, lift, passive, factor, members):  # type: ignore[no-untyped-def]
    """Cholesky factor over the passive unknowns, its diagonal inverted; their number.

    By hand: the matrix is so small that a library's call would cost more than the work, and its
    bits would depend on the processor.
    """
    count = 0
    for k in range(len(passive)):
        if passive[k]:
            members[count] = k
            count += 1
    for a in range(count):
        row = gram[members[a]]
        for b in range(a):
            value = row[members[b]]
            for c in range(b):
                value -= factor[a, c] * factor[b, c]
            factor[a, b] = value * factor[b, b]
        value = row[members[a]] + lift
        for c in range(a):
            value -= factor[a, c] * factor[a, c]
        # What rounding leaves of parallel responses is no less than the ridge.
        factor[a, a] = 1 / np.sqrt(max(value, lift))
    return count


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
    sigma = range_px * deviate(0.5 + (np.arange(_QUANTILES) + 0.5) / (2 * _QUANTILES))
    least = spread_px[1]
    mixture = np.zeros(len(spread_px))
    short = sigma < least
    variance = (sigma[short] / least) ** 2
    mixture[:2] += np.sum(1 - variance), np.sum(variance)
    at = np.interp(log(sigma[~short]), log(spread_px[1:]), np.arange(1, len(spread_px)))
    below = np.minimum(at.astype(np.int64), len(spread_px) - 2)
    np.add.at(mixture, below, 1 - (at - below))
    np.add.at(mixture, below + 1, at - below)
    normalised: NDArray[np.float64] = mixture / mixture.sum()
    return normalised
