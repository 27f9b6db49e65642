"""Edges between surfaces, placed sub-pixel exactly after the surfaces have been painted."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image, IntArray
from visual_servo_epipolar.simulation.rendering.raster import NEAR, Raster, View
from visual_servo_epipolar.simulation.rendering.surfaces import Scene

REACH = 2  # pixels looked at on either side of an edge


class Crossings(NamedTuple):
    """Pixels crossed by edges of surfaces: one a row where an edge is steep, or one a column."""

    pixels: IntArray  # index into the flat image
    inwards: IntArray  # index step to the next pixel across the edge, towards the surface
    shares: FloatArray  # how much of the pixel the surface covers
    owners: IntArray  # the surface whose edge it is


def smooth_edges(image: Image, raster: Raster, crossings: Crossings) -> None:
    """
    Mix the pixels of ``image``, shape (H, W), that an edge cuts, by covered area.

    Where the edge of a surface crosses a pixel and the surface is seen on its inner side, the
    pixel takes as much of either side as the edge leaves it. Pixels that were painted although
    they lie wholly outside of the edge are taken from their neighbour.
    """
    pixels, inwards, shares, owners = crossings
    flat, surface_at = image.reshape(-1), _surfaces(raster)
    beside = surface_at(pixels - inwards)
    cut = np.flatnonzero((surface_at(pixels + inwards) == owners) & (beside != owners))
    at, step, owner = pixels[cut], inwards[cut], owners[cut]
    here = surface_at(at)
    inside = flat.take(np.where(here == owner, at, at + step)).astype(np.float64)
    outside = flat.take(np.where(here == beside[cut], at, at - step))
    over = np.flatnonzero(beside == owners)
    over = over[surface_at(pixels[over]) == owners[over]]
    stuck, step = pixels[over] - inwards[over], inwards[over]
    wrong = surface_at(stuck - step) != owners[over]
    taken = flat[(stuck - step)[wrong]]
    slivers = None
    if raster.thin.any():
        slivers = _slivers(crossings, flat, surface_at, raster.shown[raster.thin])
    # All is read before anything is written.
    flat[at] = np.rint(outside + shares[cut] * (inside - outside))
    flat[stuck[wrong]] = taken
    if slivers is not None:
        flat[slivers[0]] = slivers[1]


def _surfaces(raster: Raster) -> Callable[[IntArray], IntArray]:
    """Return what gives the surface seen at pixels, by their index into the flat image."""
    ids, surfaces = raster.ids.ravel(), np.array([-1, *(strip.surface for strip in raster.strips)])
    return lambda pixels: surfaces.take(ids.take(pixels))


def _slivers(
    crossings: Crossings, flat: Image, surface_at: Callable[[IntArray], IntArray], thin: IntArray
) -> tuple[IntArray, FloatArray]:
    """Return the pixels in which both edges of a thin surface lie, and their grey values."""
    is_thin = np.zeros(int(crossings.owners.max(initial=0)) + 1, bool)
    is_thin[thin[thin < len(is_thin)]] = True
    keep = np.flatnonzero(is_thin.take(crossings.owners))
    pixels, inwards, shares, owners = (values[keep] for values in crossings)
    order = np.lexsort((inwards, pixels, owners))
    one, two = order[:-1], order[1:]
    pairs = (pixels[one] == pixels[two]) & (owners[one] == owners[two])
    one, two = (
        one[pairs & (inwards[one] == -inwards[two])],
        two[pairs & (inwards[one] == -inwards[two])],
    )
    at, step, owner = pixels[one], inwards[two], owners[one]
    # Edge one has the surface before it, edge two after it: one covers the rest from the far side.
    before, after = 1.0 - shares[two], 1.0 - shares[one]
    inside = np.full(len(at), -1)
    for place in (at - step, at + step, at):
        inside = np.where(surface_at(place) == owner, place, inside)
    left = np.where(surface_at(at - step) == owner, at - 2 * step, at - step)
    right = np.where(surface_at(at + step) == owner, at + 2 * step, at + step)
    mixed = before * flat[left] + after * flat[right] + (1.0 - before - after) * flat[inside]
    valid = (inside >= 0) & (before + after <= 1.0)
    return at[valid], np.rint(mixed[valid])


def crossed(scene: Scene, view: View, raster: Raster) -> Crossings:
    """Walk along all edges of the surfaces in view."""
    ends, owners = _edges(scene, view, raster.shown)
    delta = ends[:, 1] - ends[:, 0]
    steep = np.abs(delta[:, 1]) > np.abs(delta[:, 0])
    # Corners go clockwise on screen, so the inside is to the right of an edge.
    inward = np.where(steep, -np.sign(delta[:, 1]), np.sign(delta[:, 0])).astype(np.int64)
    along, across = np.where(steep[:, None, None], ends[:, :, ::-1], ends).transpose(2, 0, 1)
    length = np.where(steep, view.height, view.width)
    first = np.maximum(np.ceil(along.min(axis=1)), 0.0).astype(np.int64)
    last = np.minimum(np.floor(along.max(axis=1)), length - 1.0).astype(np.int64)
    counts = np.maximum(last - first + 1, 0)
    slope = (across[:, 1] - across[:, 0]) / np.where(counts > 0, along[:, 1] - along[:, 0], 1.0)
    starts = np.cumsum(counts) - counts
    position = np.arange(int(counts.sum())) - np.repeat(starts - first, counts)
    crossing = np.repeat(slope, counts) * position
    crossing += np.repeat(across[:, 0] - slope * along[:, 0], counts)
    farthest = np.where(steep, view.width, view.height) - 1.0 - REACH
    inside = np.flatnonzero((crossing > REACH) & (crossing < np.repeat(farthest, counts)))
    edge = np.repeat(np.arange(len(ends)), counts).take(inside)
    position, crossing = position.take(inside), crossing.take(inside)
    cell = np.rint(crossing)
    step, stride = np.where(steep, 1, view.width), np.where(steep, view.width, 1)
    shares = 0.5 - inward.take(edge) * (crossing - cell)
    pixels = cell.astype(np.int64) * step.take(edge) + position * stride.take(edge)
    return Crossings(pixels, (inward * step).take(edge), shares, owners.take(edge))


def _edges(scene: Scene, view: View, shown: IntArray) -> tuple[FloatArray, IntArray]:
    """Return the ends of all edges ahead of the camera, shape (E, 2, 2) [px], and their owners."""
    corners = view.to_camera(scene.corners[shown])
    ends = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2, 3)
    owners = np.repeat(shown, 4)
    ahead = ends[:, :, 2].max(axis=1) > NEAR
    ends, owners = ends[ahead], owners[ahead]
    depths = ends[:, :, 2]
    behind = np.nonzero(depths < NEAR)
    other = (behind[0], 1 - behind[1])
    share = (NEAR - depths[behind]) / (depths[other] - depths[behind])
    cut = ends[behind] + share[:, None] * (ends[other] - ends[behind])
    ends[behind] = cut
    fx, fy, cx, cy = view.scales
    return ends[..., :2] / ends[..., 2:] * [fx, fy] + [cx, cy], owners
