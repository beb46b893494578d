"""The nearest point of a convex hull in the plane, compiled with numba.

numba keeps what it compiled of a caller in another file when only this one changes:
after a change here, clear the caches (`__pycache__/*.nb*`).
"""

import numba

from ..body.body import Floats, Ints
from ._compiler_cache import warn_uncached


def _find_cache() -> bool:
    """Whether numba can keep what it compiles: beside this file or in the home."""
    try:
        numba.njit(cache=True)(_find_cache)  # compiles nothing yet
    except RuntimeError:
        warn_uncached("numba", "some 5 s", "NUMBA_CACHE_DIR")
        return False
    return True


JIT = dict(cache=_find_cache(), nogil=True, fastmath=False, error_model="numpy")
_ORIGIN_TOLERANCE = 1e-7  # [m] the hull holds the origin when this close to it; chosen


@numba.njit(**JIT)
def find_nearest_on_hull(flat: Floats, m: int, simplex: Ints) -> int:
    """Find the point of a plane hull that is nearest to the origin, by GJK.

    Args:
        flat: (M, 2) points [m].
        simplex: (2) to fill: rows of the points that carry the nearest one.

    Returns:
        The size of that simplex: 1 vertex, 2 edge, 3 inside.
    """
    best = 0
    for i in range(1, m):
        if flat[i, 0] ** 2 + flat[i, 1] ** 2 < flat[best, 0] ** 2 + flat[best, 1] ** 2:
            best = i
    simplex[0] = best
    x, y = flat[best, 0], flat[best, 1]
    size = 1
    for _ in range(m + 4):
        norm = x * x + y * y
        if norm < _ORIGIN_TOLERANCE * _ORIGIN_TOLERANCE:
            return 3
        far = _find_support(flat, m, x, y, norm - 1e-10)
        if far < 0:
            return size
        if size == 2 and _contains_origin(flat, simplex[0], simplex[1], far):
            return 3
        # the nearest point of the edges between it and the simplex
        keep, kx, ky, kn, is_edge = simplex[0], 0.0, 0.0, 1e30, False
        for s in range(size):
            v = simplex[s]
            ex, ey = flat[far, 0] - flat[v, 0], flat[far, 1] - flat[v, 1]
            t = -(flat[v, 0] * ex + flat[v, 1] * ey) / (ex * ex + ey * ey)
            edge, t = 0.0 < t < 1.0, min(max(t, 0.0), 1.0)
            px, py = flat[v, 0] + t * ex, flat[v, 1] + t * ey
            if px * px + py * py < kn:
                kn, kx, ky, is_edge = px * px + py * py, px, py, edge
                keep = v if (edge or t == 0.0) else far
        simplex[0] = keep
        size = 1
        if is_edge:
            simplex[1] = far
            size = 2
        x, y = kx, ky
    return size


@numba.njit(inline="always", **JIT)
def _find_support(flat: Floats, m: int, x: float, y: float, low: float) -> int:
    """The point farthest against (x, y), -1 where none is below `low` along it."""
    far = -1
    for i in range(m):
        dot = flat[i, 0] * x + flat[i, 1] * y
        if dot < low:
            far, low = i, dot
    return far


@numba.njit(inline="always", **JIT)
def _contains_origin(flat: Floats, a: int, b: int, c: int) -> bool:
    """Whether the triangle a b c holds the origin."""
    d1 = flat[a, 0] * flat[b, 1] - flat[a, 1] * flat[b, 0]
    d2 = flat[b, 0] * flat[c, 1] - flat[b, 1] * flat[c, 0]
    d3 = flat[c, 0] * flat[a, 1] - flat[c, 1] * flat[a, 0]
    return (d1 >= 0 and d2 >= 0 and d3 >= 0) or (d1 <= 0 and d2 <= 0 and d3 <= 0)
