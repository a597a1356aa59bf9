"""Where a point and a triangle, or two segments, are nearest to each other. Compiled."""

from __future__ import annotations

from typing import Any

from toppling.models.compiled import inner
from toppling.models.ground.vectors import dot, minus, plus


@inner
def nearest(p: Any, a: Any, b: Any, c: Any) -> tuple[int, tuple[float, float, float]]:
    """Where a triangle is nearest to a point: 0 its face, 1 to 3 a corner, 4 to 6 the edge from corner 1 to 3 on."""
    ab, ac, ap = minus(b, a), minus(c, a), minus(p, a)
    d1, d2 = dot(ab, ap), dot(ac, ap)
    if d1 <= 0.0 and d2 <= 0.0:
        return 1, (a[0], a[1], a[2])
    bp = minus(p, b)
    d3, d4 = dot(ab, bp), dot(ac, bp)
    if d3 >= 0.0 and d4 <= d3:
        return 2, (b[0], b[1], b[2])
    cp = minus(p, c)
    d5, d6 = dot(ab, cp), dot(ac, cp)
    if d6 >= 0.0 and d5 <= d6:
        return 3, (c[0], c[1], c[2])
    vc = d1 * d4 - d3 * d2
    va = d3 * d6 - d5 * d4
    vb = d5 * d2 - d1 * d6
    least = -1e-9 * (va + vb + vc)
    if vc < least and d1 >= 0.0 and d3 <= 0.0:
        return 4, plus(a, d1 / (d1 - d3), ab)
    if va < least and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        share = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return 5, plus(b, share, minus(c, b))
    if vb < least and d2 >= 0.0 and d6 <= 0.0:
        return 6, plus(a, d2 / (d2 - d6), ac)
    whole = 1.0 / (va + vb + vc)
    return 0, plus(plus(a, vb * whole, ab), vc * whole, ac)


@inner
def between(a: Any, way: Any, c: Any, other: Any) -> tuple[float, float, float]:
    """Shares of two segments where they are nearest, and their squared distance there."""
    from_c = minus(a, c)
    aa, bb, ab = dot(way, way), dot(other, other), dot(way, other)
    af, bf = dot(way, from_c), dot(other, from_c)
    det = aa * bb - ab * ab
    s = (ab * bf - af * bb) / det if det > 1e-12 * aa * bb else 0.5
    s = min(max(s, 0.0), 1.0)
    t = (ab * s + bf) / bb
    if t < 0.0 or t > 1.0:
        t = min(max(t, 0.0), 1.0)
        s = min(max((ab * t - af) / aa, 0.0), 1.0)
    gap = minus(plus(a, s, way), plus(c, t, other))
    return s, t, dot(gap, gap)
