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
    a, b, c, d = plane
    sides = [a * x + b * y + c * z + d for x, y, z in polygon]
    if min(sides) >= 0.0:
        return polygon
    corners: Polygon = []
    before, side_before = polygon[-1], sides[-1]
    for point, side in zip(polygon, sides, strict=True):
        if (side >= 0.0) != (side_before >= 0.0):
            t = side_before / (side_before - side)
            (x0, y0, z0), (x1, y1, z1) = before, point
            corners.append((x0 + t * (x1 - x0), y0 + t * (y1 - y0), z0 + t * (z1 - z0)))
        if side >= 0.0:
            corners.append(point)
        before, side_before = point, side
    return corners


def strips(polygon: Polygon, *, sections: bool) -> Iterator[tuple[int, Polygon]]:
    """
    Cut a polygon at fixed depths, and across in ``sections`` if so wished.

    Yields with each part on which side of the image it is: -1, 0 in the middle, or 1.
    """
    depths = [z for _, _, z in polygon]
    first = math.floor(math.log(min(depths), STRIP_RATIO) + 1e-9)
    last = math.ceil(math.log(max(depths), STRIP_RATIO) - 1e-9)
    for k in range(first, max(last, first + 1)):
        strip = polygon
        if k > first:
            strip = clipped(strip, (0.0, 0.0, 1.0, -(STRIP_RATIO**k)))
        if k < last - 1 and strip:
            strip = clipped(strip, (0.0, 0.0, -1.0, STRIP_RATIO ** (k + 1)))
        if len(strip) > 2:
            yield from _sections(strip) if sections else ((0, strip),)


def _sections(strip: Polygon) -> Iterator[tuple[int, Polygon]]:
    slopes = [x / z for x, _, z in strip]
    low, high = min(slopes), max(slopes)
    for left, right in zip((-math.inf, *SECTIONS), (*SECTIONS, math.inf), strict=True):
        part = strip
        if left > low:
            part = clipped(part, (1.0, 0.0, -left, 0.0))
        if right < high and part:
            part = clipped(part, (-1.0, 0.0, right, 0.0))
        if left < high and right > low and len(part) > 2:
            yield (left >= 0.0) - (right <= 0.0), part


def breadth(outline: Outline) -> float:
    """Return the mean width [px] of a convex outline [px]: its area over half its perimeter."""
    area = perimeter = 0.0
    for k, (x, y) in enumerate(outline):
        x0, y0 = outline[k - 1]
        area += x0 * y - x * y0
        perimeter += math.hypot(x - x0, y - y0)
    return abs(area) / perimeter if perimeter > 0.0 else 0.0
