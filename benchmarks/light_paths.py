"""A small path tracer that traces light once and answers for every pattern.

Each path from the camera is connected, at every place where light scatters, to the projector: the
projector pixel that it meets there, what it carries and by which way it came (direct, below the
surface of one translucent object, anything else) are all that a pattern needs. Frames are summed
while paths are traced, so neither paths nor a transport matrix are stored, and the parts of the
light are exact for the frames, whatever the number of paths.

Scenes are made of ellipsoids, boxes and cylinders, each Lambertian with a texture, with a glossy
lobe (modified Phong, energy-conserving), or translucent: a Lambertian coat over a homogeneous,
isotropically scattering medium, walked at random. Its boundary is either matched in index (light
passes straight) or rough (light enters and leaves with a cosine distribution).
"""

# ruff: noqa: NPY002 (compiled code has no other generator; it is seeded pixel by pixel)

from __future__ import annotations

import numpy as np
from numba import njit, prange

from benchmarks.rays import along, dot, hit, lit, lobe, projected
from benchmarks.solids import CHECKS, UNIFORM

_LONGEST = 600
_BOUNCES = 8

# Upper ends of the bins of range, in projector pixels; the last bin has none.
RANGE_EDGES_PX = tuple(2.0 ** (k / 2) for k in range(19))

# Columns of the table of solids.
_CENTRE, _INVERSE, _COLOURS, _TEXTURE, _SCALE, _GLOSS, _EXPONENT = 1, 4, 13, 19, 20, 21, 22
_EXTINCTION, _MEDIUM, _COAT, _MATCHED = 23, 24, 27, 28

# How a path goes on from a surface.
_LOST, _AWAY, _INTO = 0, 1, 2


@njit
def _albedo(s, p, channel):  # type: ignore[no-untyped-def]
    """Texture of a solid at a place, in the solid's directions but in units of length."""
    first, second = s[_COLOURS + channel], s[_COLOURS + 3 + channel]
    if s[_TEXTURE] == UNIFORM:
        return first
    x, y, z = s[_SCALE] * (p[0] - s[1]), s[_SCALE] * (p[1] - s[2]), s[_SCALE] * (p[2] - s[3])
    if s[_TEXTURE] == CHECKS:
        odd = (np.floor(x + 0.17) + np.floor(y + 0.31) + np.floor(z + 0.43)) % 2
        return first if odd == 0 else second
    wave = np.sin(5.1 * x + 2.3 * np.sin(3.7 * y + 1.3 * z)) + np.sin(
        4.3 * y - 2.9 * z + 1.9 * np.sin(6.1 * x)
    )
    part = 0.5 + 0.25 * wave
    return first * part + second * (1 - part)


@njit(fastmath=True)
def _deposit(contrast, down, right, red, green, blue):  # type: ignore[no-untyped-def]
    for m in range(len(down)):
        code = down[m] * right[m]
        contrast[0, m] += red * code
        contrast[1, m] += green * code
        contrast[2, m] += blue * code


@njit(parallel=True)
def trace(  # type: ignore[no-untyped-def]
    solids, camera, projector, down, right, side, seed, contrast, truth, ranges, places
):
    """Trace every pixel; see `benchmarks.rendering.render` and `render_parts`.

    What it finds is added to the last four, which begin as zeros.

    Parameters
    ----------
    solids, camera, projector
        `benchmarks.solids.solid_table`, `View.axes`.
    down, right
        float32, (rows, m) and (columns, m): products of these are summed.
    side, seed
        Root of the number of paths a pixel; of their chance.
    contrast
        float32, (pixels, kinds, 3, m), receives the sums, for each kind of light (1: all
        together; 3: direct, below the surface, the rest).
    truth
        (3, pixels, 3), receives the light.
    ranges
        (pixels, 2, 3, bins), receives light that is not direct by kind, colour and range;
        see `RANGE_EDGES_PX`; no bins: not wanted.
    places
        (pixels, 6), receives rows, columns and weight of where direct light arrives, summed, and
        of what the pixel sees, shadows left aside.
    """
    height, width = int(camera[4, 1]), int(camera[4, 2])
    for pixel in prange(height * width):
        np.random.seed(seed * 1_000_003 + pixel)
        row, column = pixel // width, pixel % width
        for k in range(side * side):
            scale = 2 * camera[4, 0] / width
            x = (column + (k % side + np.random.random()) / side - width / 2) * scale
            y = (row + (k // side + np.random.random()) / side - height / 2) * scale
            norm = 1 / np.sqrt(1 + x * x + y * y)
            d = (
                norm * (camera[3, 0] + x * camera[1, 0] + y * camera[2, 0]),
                norm * (camera[3, 1] + x * camera[1, 1] + y * camera[2, 1]),
                norm * (camera[3, 2] + x * camera[1, 2] + y * camera[2, 2]),
            )
            o = (camera[0, 0], camera[0, 1], camera[0, 2])
            _follow(
                solids, projector, down, right, o, d, 1 / (side * side), contrast[pixel],
                truth[:, pixel], ranges[pixel], places[pixel],
            )  # fmt: skip


@njit
def _note_range(ranges, place, row, column, given):  # type: ignore[no-untyped-def]
    """Add light to the bin of the distance on the projector from the path's own place."""
    if ranges.shape[1]:
        away = np.sqrt((row - place[0]) ** 2 + (column - place[1]) ** 2)
        k = 0
        while k < ranges.shape[1] - 1 and away >= RANGE_EDGES_PX[k]:
            k += 1
        for c in range(3):
            ranges[c, k] += given[c]


@njit
def _note_place(own, row, column, weight):  # type: ignore[no-untyped-def]
    own[0] += weight * row
    own[1] += weight * column
    own[2] += weight


@njit
def _light_inside(  # type: ignore[no-untyped-def]
    solids, projector, down, right, p, inside, carried, sums, part, ranges, place
):
    """Connect a place in a medium to the projector, straight through its boundary."""
    s = solids[inside]
    row, column, fall, _, way = lit(solids, p, projector, inside)
    if row >= 0:
        passed = (1 - s[_COAT]) * np.exp(-s[_EXTINCTION] * way)
        given = carried * (passed * fall / (4 * np.pi))
        part += given
        _note_range(ranges, place, row, column, given)
        _deposit(sums, down[row], right[column], given[0], given[1], given[2])


@njit
def _light_surface(  # type: ignore[no-untyped-def]
    solids, projector, down, right, p, n, mirror, which, rough_exit, carried, sums, part
):
    """Connect a place on a surface to the projector: by coat and gloss, or by its pores.

    Row and column of the projector pixel that lights it (−1: none), and what it gave.
    """
    s = solids[which]
    given = np.zeros(3)
    row, column, fall, w, _ = lit(solids, p, projector, -1)
    incident = dot(w, n)
    if row < 0 or incident <= 0:
        return row, column, given
    glossy = 0.0
    if not rough_exit and s[_GLOSS] > 0:
        near = max(dot(mirror, w), 0.0)
        glossy = s[_GLOSS] * (s[_EXPONENT] + 2) / (2 * np.pi) * near ** s[_EXPONENT]
    for c in range(3):
        matt = 1 / np.pi
        if not rough_exit:
            matt = (1 - s[_GLOSS]) * s[_COAT] * _albedo(s, p, c) / np.pi
        given[c] = carried[c] * (matt + glossy) * incident * fall
    part += given
    _deposit(sums, down[row], right[column], given[0], given[1], given[2])
    return row, column, given


@njit
def _follow(  # type: ignore[no-untyped-def] # noqa: C901, PLR0912, PLR0915 (one loop, one path)
    solids, projector, down, right, o, d, share, sums, parts, ranges, own
):
    """Follow one path.

    What it gathers goes to `sums` (kind, colour, pattern), `parts` (kind, colour), `ranges` (kind,
    colour, bin) and `own` (direct light's rows, columns and weight; the same of the places seen).
    """
    last = len(sums) - 1
    place = (np.inf, np.inf)
    carried = np.full(3, share)
    kind, inside, bounces = 0, -1, 0
    for _ in range(_LONGEST):
        t, which, n = hit(solids, o, d)
        if which < 0:
            return
        rough_exit = False
        if inside >= 0:
            s = solids[inside]
            free = -np.log(1 - np.random.random()) / s[_EXTINCTION]
            p = along(o, d, min(free, t))
            if free < t:
                for c in range(3):
                    carried[c] *= s[_MEDIUM + c]
                if s[_MATCHED] > 0:
                    _light_inside(
                        solids, projector, down, right, p, inside, carried,
                        sums[min(kind, last)], parts[kind], ranges[kind - 1], place,
                    )  # fmt: skip
                o, d = p, _any_way()
                if not _survives(carried, share):
                    return
                continue
            if np.random.random() < s[_COAT]:
                o, d = p, lobe((-n[0], -n[1], -n[2]), 1.0)
                continue
            inside = -1
            if s[_MATCHED] > 0:
                kind, o = 2, p
                continue
            rough_exit = True
        else:
            p = along(o, d, t)
            s = solids[which]
        # A surface that light leaves to the outside: by its coat, its glossy lobe or its pores.
        cosine = dot(d, n)
        if not rough_exit and cosine > 0:
            return
        mirror = (d[0] - 2 * cosine * n[0], d[1] - 2 * cosine * n[1], d[2] - 2 * cosine * n[2])
        if bounces == 0 and inside < 0 and not rough_exit:
            row, column, _ = projected(p, projector)
            if row >= 0:
                place = (float(row), float(column))
                _note_place(own[3:], row, column, share)
        row, column, given = _light_surface(
            solids, projector, down, right, p, n, mirror, which, rough_exit, carried,
            sums[min(kind, last)], parts[kind],
        )  # fmt: skip
        if row >= 0 and kind > 0:
            _note_range(ranges[kind - 1], place, row, column, given)
        elif row >= 0:
            _note_place(own[:3], row, column, given.sum())
        bounces += 1
        if bounces > _BOUNCES or not _survives(carried, share):
            return
        goes, d = _leave(s, p, n, d, mirror, rough_exit, carried)
        if goes == _LOST:
            return
        if goes == _INTO:
            inside = which
        kind, o = 1 if goes == _INTO and kind == 0 else 2, p


@njit
def _leave(s, p, n, d, mirror, rough_exit, carried):  # type: ignore[no-untyped-def]
    """How a path goes on from a surface, and where to; what it carries is changed accordingly."""
    if rough_exit:
        return _AWAY, lobe(n, 1.0)
    if np.random.random() < s[_GLOSS]:
        away = lobe(mirror, s[_EXPONENT])
        leaving = dot(away, n)
        carried *= leaving * (s[_EXPONENT] + 2) / (s[_EXPONENT] + 1)
        return _AWAY if leaving > 0 else _LOST, away
    if np.random.random() < s[_COAT]:
        for c in range(3):
            carried[c] *= _albedo(s, p, c)
        return _AWAY, lobe(n, 1.0)
    # Nothing bends the light at the boundary of a medium that is matched to the air.
    return _INTO, d if s[_MATCHED] > 0 else lobe((-n[0], -n[1], -n[2]), 1.0)


@njit
def _any_way():  # type: ignore[no-untyped-def]
    """A direction, each as likely as any other."""
    z = 2 * np.random.random() - 1
    phi = 2 * np.pi * np.random.random()
    r = np.sqrt(max(1 - z * z, 0.0))
    return r * np.cos(phi), r * np.sin(phi), z


@njit
def _survives(carried, share):  # type: ignore[no-untyped-def]
    """Russian roulette once little is carried."""
    most = max(carried[0], carried[1], carried[2]) / share
    if most >= 0.3:
        return True
    if np.random.random() * 0.3 >= most:
        return False
    carried *= 0.3 / most
    return True
