"""Convex polygons in camera axes, in plain Python: they have four to nine corners."""

from collections.abc import Iterator
import math
from typing import TypeAlias

Corner: TypeAlias = tuple[float, float, float]
Polygon: TypeAlias = list[Corner]
Plane: TypeAlias = tuple[float, float, float, float]
Outline: TypeAlias = list[tuple[float, float]]

STRIP_RATIO = 1.4  # farthest over nearest depth within one strip
SECTIONS = (-0.33, 0.33)  # x / z at which the strips of floor and ceiling are cut


def clipped(polygon: Polygon, plane: Plane) -> Polygon:
    """Return what of a convex polygon has a x + b y + c z + d >= 0."""
    return split(polygon, plane)[0]


def split(polygon: Polygon, plane: Plane) -> tuple[Polygon, Polygon]:
    """Return what of a convex polygon has a x + b y + c z + d >= 0, and what has less."""
    a, b, c, d = plane
    return _parted(polygon, [a * x + b * y + c * z + d for x, y, z in polygon])


def _parted(polygon: Polygon, sides: list[float]) -> tuple[Polygon, Polygon]:
    """Return what of a convex polygon, whose corners have ``sides``, has 0 or more, and less."""
    if min(sides) >= 0.0:
        return polygon, []
    if max(sides) < 0.0:
        return [], polygon
    inside: Polygon = []
    outside: Polygon = []
    before, side_before = polygon[-1], sides[-1]
    for point, side in zip(polygon, sides, strict=True):
        if (side >= 0.0) != (side_before >= 0.0):
            t = side_before / (side_before - side)
            (x0, y0, z0), (x1, y1, z1) = before, point
            corner = x0 + t * (x1 - x0), y0 + t * (y1 - y0), z0 + t * (z1 - z0)
            inside.append(corner)
            outside.append(corner)
        (inside if side >= 0.0 else outside).append(point)
        before, side_before = point, side
    return inside, outside


def strips(polygon: Polygon, *, sections: bool) -> Iterator[tuple[int, Polygon]]:
    """
    Cut a polygon at fixed depths, and across in ``sections`` if so wished.

    Yields with each part on which side of the image it is: -1, 0 in the middle, or 1.
    """
    depths = [z for _, _, z in polygon]
    first = math.floor(math.log(min(depths), STRIP_RATIO) + 1e-9)
    last = math.ceil(math.log(max(depths), STRIP_RATIO) - 1e-9)
    for k in range(first + 1, last):
        depth = STRIP_RATIO**k
        polygon, strip = _parted(polygon, [z - depth for _, _, z in polygon])
        if len(strip) > 2:
            yield from _sections(strip) if sections else ((0, strip),)
    if len(polygon) > 2:
        yield from _sections(polygon) if sections else ((0, polygon),)


def _sections(strip: Polygon) -> Iterator[tuple[int, Polygon]]:
    for side, slope in zip((-1, 0), SECTIONS, strict=True):
        if not strip:
            return
        strip, part = _parted(strip, [x - slope * z for x, _, z in strip])
        if len(part) > 2:
            yield side, part
    if len(strip) > 2:
        yield 1, strip


def breadth(outline: Outline) -> float:
    """Return the mean width [px] of a convex outline [px]: its area over half its perimeter."""
    area = perimeter = 0.0
    for k, (x, y) in enumerate(outline):
        x0, y0 = outline[k - 1]
        area += x0 * y - x * y0
        perimeter += math.hypot(x - x0, y - y0)
    return abs(area) / perimeter if perimeter > 0.0 else 0.0
