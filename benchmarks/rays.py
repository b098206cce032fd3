"""Rays among the solids of a scene: what they hit, where they scatter, what a projector lights."""

# ruff: noqa: NPY002 (compiled code has no other generator; it is seeded pixel by pixel)

from __future__ import annotations

import numpy as np
from numba import njit

from benchmarks.solids import BOX, SPHERE

_EPSILON = 1e-5


@njit(inline="always")
def _unit_hit(shape, o, d):  # type: ignore[no-untyped-def] # noqa: C901, PLR0912, PLR0915
    """Nearest t > ε in the solid's own frame, and the normal there (not normalised)."""
    n = (0.0, 0.0, 0.0)
    best = np.inf
    if shape == SPHERE:
        a = d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
        b = o[0] * d[0] + o[1] * d[1] + o[2] * d[2]
        c = o[0] * o[0] + o[1] * o[1] + o[2] * o[2] - 1
        root = b * b - a * c
        if root > 0:
            root = np.sqrt(root)
            t = (-b - root) / a
            if t < _EPSILON:
                t = (-b + root) / a
            if t > _EPSILON:
                best = t
                n = (o[0] + t * d[0], o[1] + t * d[1], o[2] + t * d[2])
    elif shape == BOX:
        near, far, axis_near, axis_far = -np.inf, np.inf, 0, 0
        for k in range(3):
            if abs(d[k]) < 1e-12:
                if abs(o[k]) > 1:
                    return np.inf, n
                continue
            t0, t1 = (-1 - o[k]) / d[k], (1 - o[k]) / d[k]
            if t0 > t1:
                t0, t1 = t1, t0
            if t0 > near:
                near, axis_near = t0, k
            if t1 < far:
                far, axis_far = t1, k
        if near < far and far > _EPSILON:
            best, axis = (near, axis_near) if near > _EPSILON else (far, axis_far)
            side = 1.0 if o[axis] + best * d[axis] > 0 else -1.0
            n = (
                side if axis == 0 else 0.0,
                side if axis == 1 else 0.0,
                side if axis == 2 else 0.0,
            )
    else:
        a = d[0] * d[0] + d[2] * d[2]
        b = o[0] * d[0] + o[2] * d[2]
        c = o[0] * o[0] + o[2] * o[2] - 1
        root = b * b - a * c
        if a > 1e-14 and root > 0:
            root = np.sqrt(root)
            for t in ((-b - root) / a, (-b + root) / a):
                y = o[1] + t * d[1]
                if _EPSILON < t < best and abs(y) < 1:
                    best, n = t, (o[0] + t * d[0], 0.0, o[2] + t * d[2])
        if abs(d[1]) > 1e-12:
            for side in (-1.0, 1.0):
                t = (side - o[1]) / d[1]
                x, z = o[0] + t * d[0], o[2] + t * d[2]
                if _EPSILON < t < best and x * x + z * z < 1:
                    best, n = t, (0.0, side, 0.0)
    return best, n


@njit
def hit(solids, o, d):  # type: ignore[no-untyped-def]
    """Nearest solid: t, its index (−1 for none), outward unit normal."""
    best, which, normal = np.inf, -1, (0.0, 0.0, 0.0)
    for k in range(len(solids)):
        s = solids[k]
        x, y, z = o[0] - s[1], o[1] - s[2], o[2] - s[3]
        lo = (
            s[4] * x + s[5] * y + s[6] * z,
            s[7] * x + s[8] * y + s[9] * z,
            s[10] * x + s[11] * y + s[12] * z,
        )
        ld = (
            s[4] * d[0] + s[5] * d[1] + s[6] * d[2],
            s[7] * d[0] + s[8] * d[1] + s[9] * d[2],
            s[10] * d[0] + s[11] * d[1] + s[12] * d[2],
        )
        t, n = _unit_hit(int(s[0]), lo, ld)
        if t < best:
            best, which = t, k
            normal = (
                s[4] * n[0] + s[7] * n[1] + s[10] * n[2],
                s[5] * n[0] + s[8] * n[1] + s[11] * n[2],
                s[6] * n[0] + s[9] * n[1] + s[12] * n[2],
            )
    size = np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2) + 1e-300
    return best, which, (normal[0] / size, normal[1] / size, normal[2] / size)


@njit(inline="always")
def dot(a, b):  # type: ignore[no-untyped-def]
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(inline="always")
def along(o, d, t):  # type: ignore[no-untyped-def]
    return (o[0] + t * d[0], o[1] + t * d[1], o[2] + t * d[2])


@njit
def lobe(n, exponent):  # type: ignore[no-untyped-def]
    """A direction with density ∝ cosᵉ about n; e = 1 is Lambert's."""
    z = np.random.random() ** (1 / (exponent + 1))
    phi = 2 * np.pi * np.random.random()
    r = np.sqrt(max(1 - z * z, 0.0))
    sign = 1.0 if n[2] >= 0 else -1.0
    a = -1 / (sign + n[2])
    b = n[0] * n[1] * a
    x, y = r * np.cos(phi), r * np.sin(phi)
    return (
        x * (1 + sign * n[0] * n[0] * a) + y * b + z * n[0],
        x * sign * b + y * (sign + n[1] * n[1] * a) + z * n[1],
        -x * sign * n[0] - y * n[1] + z * n[2],
    )


@njit
def projected(p, projector):  # type: ignore[no-untyped-def]
    """Row and column of the projector pixel that lights a place, −1 for none; its distance²."""
    v = (p[0] - projector[0, 0], p[1] - projector[0, 1], p[2] - projector[0, 2])
    depth = dot(v, projector[3])
    if depth <= 0:
        return -1, -1, 1.0
    height, width = projector[4, 1], projector[4, 2]
    pixel = 2 * projector[4, 0] / width
    x = dot(v, projector[1]) / depth / pixel + width / 2
    y = dot(v, projector[2]) / depth / pixel + height / 2
    if x < 0 or y < 0 or x >= width or y >= height:
        return -1, -1, 1.0
    return int(y), int(x), dot(v, v)


@njit
def lit(solids, p, projector, inside):  # type: ignore[no-untyped-def]
    """Direction to the projector, row, column, 1/distance² and, from inside, the way out.

    The row is −1 where nothing arrives. `inside` is the solid that p lies in, −1 outside.
    """
    row, column, square = projected(p, projector)
    distance = np.sqrt(square)
    w = (
        (projector[0, 0] - p[0]) / distance,
        (projector[0, 1] - p[1]) / distance,
        (projector[0, 2] - p[2]) / distance,
    )
    way = 0.0
    if row >= 0:
        o = p
        if inside >= 0:
            way, which, _ = hit(solids, p, w)
            if which != inside:
                return -1, -1, 0.0, w, 0.0
            o = along(p, w, way)
        t, _, _ = hit(solids, o, w)
        if t < distance - way - _EPSILON:
            row = -1
    return row, column, 1 / square, w, way
