"""Route: key views along a way that was driven once, with the path between them."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image, IntArray
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.cameras.plausibility import (
    are_alike,
    CALIBRATION_DEG,
    differences,
)
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.routes.path import TaughtPath
from visual_servo_epipolar.core.routes.structure import LocalStructure
from visual_servo_epipolar.core.tracking.matchers.base import Keypoints
from visual_servo_epipolar.core.tracking.photographs import superfluous

MOST_IMAGES = 200  # of a way, in memory
FARTHEST = 3.0  # that a structure tells from its path [m]; the next key view is half as far away
SAME_TURN = 0.35  # between neighbours, or of the end of a lap from its beginning [rad]
OVERLAP = 0.35  # of a structure beyond the neighbours, where a lap may close as well [m]


@dataclass(frozen=True, eq=False)
class Appearance:
    """
    Appearance of a key view on one day: a photograph, and which features it shows.

    ``load`` returns the image, uint8 of shape (H, W), which may lie on a disk; its n ``keypoints``
    are the features ``rows``, (n,), of the structure.
    """

    load: Callable[[], Image]
    keypoints: Keypoints
    rows: IntArray


@dataclass(frozen=True, slots=True)
class Bridge:
    """
    Bridge: a stretch before a key view that no key view shows, by the odometry.

    It is ``way`` [m] long and turns by ``turn`` to the left [rad], to ``deviation`` [m] and
    ``turn_deviation`` [rad].
    """

    way: float
    turn: float
    deviation: float
    turn_deviation: float


@dataclass(frozen=True, eq=False)
class RouteView:
    """
    Key view: a photograph on the way, and what was learnt of the scene in it.

    ``load`` returns its image, uint8 of shape (H, W), which may lie on a disk; its ``keypoints``
    are the features of the ``structure``, row by row; ``path`` is the taught one around it.
    ``way`` [m] is where it was taken, ``pose``, (3,), where in axes of the first key view. At a
    station the robot ends exactly. ``renewed`` is how it looked on other days. A ``bridge`` leads
    to it where it shares no image with the key view before.
    """

    load: Callable[[], Image]
    keypoints: Keypoints
    structure: LocalStructure
    path: TaughtPath
    way: float
    pose: FloatArray
    is_station: bool = False
    renewed: tuple[Appearance, ...] = ()
    bridge: Bridge | None = None

    @property
    def image(self) -> Image:
        """The photograph."""
        return self.load()

    @property
    def appearances(self) -> tuple[Appearance, ...]:
        """The photograph with all of its features, and those of other days."""
        first = Appearance(self.load, self.keypoints, np.arange(len(self.keypoints)))
        return (first, *self.renewed)

    def loaded(self) -> 'RouteView':
        """Return the key view with its photographs in memory."""
        first, *renewed = (replace(each, load=in_memory(each.load())) for each in self.appearances)
        return replace(self, load=first.load, renewed=tuple(renewed))

    def superfluous(
        self, image: Image, pixels: FloatArray, rows: IntArray, most: int
    ) -> int | None:
        """
        Return which photograph tells least of other light where ``image`` is one more.

        It shows features ``rows``, (n,), at ``pixels``, (n, 2). The first photograph is number 0
        and always stays, the new one is the last. None: all may stay, as there are no more than
        ``most`` beside the first.
        """
        images = [
            self._shifted(each.load(), each.keypoints.pixels, each.rows)
            for each in self.appearances
        ]
        return superfluous([*images, self._shifted(image, pixels, rows)], most + 1)

    def _shifted(self, image: Image, pixels: FloatArray, rows: IntArray) -> Image:
        """Return an image moved to where the first shows its features: so that light differs."""
        shift = np.rint(np.median(pixels - self.structure.pixels[rows], axis=0)).astype(int)
        return np.roll(image, (-shift[1], -shift[0]), (0, 1))

    def renewed_by(self, appearance: Appearance, most: int) -> 'RouteView':
        """Return the key view with at most so many photographs beside its first one."""
        pixels = appearance.keypoints.pixels
        out = self.superfluous(appearance.load(), pixels, appearance.rows, most)
        kept = [*self.renewed, appearance]
        if out is not None:
            del kept[out - 1]
        return replace(self, renewed=tuple(kept))


def in_memory(image: Image) -> Callable[[], Image]:
    """Return what loads an ``image`` that is there already."""
    return lambda: image


@dataclass(frozen=True, eq=False)
class Route:
    """Route: its ``camera``, and at least two key views in the order in which they were taken."""

    camera: CameraModel
    views: tuple[RouteView, ...]

    def __post_init__(self) -> None:
        if len(self.views) < 2:
            raise ValueError(
                f'a route must have two key views or more, got {len(self.views)}; drive farther '
                'while it is recorded'
            )
        ways = np.array([view.way for view in self.views])
        rising = np.append(np.diff(ways) > 0.0, np.isfinite(ways[-1]))
        if not rising.all():
            k = int(np.argmin(rising))
            following = ways[k + 1 : k + 2].tolist()
            raise ValueError(
                f'ways of key views must be finite and rise, got {ways[k]:g} m of number {k}'
                f'{"".join(f" before {way:g} m" for way in following)}; teach the route again'
            )
        for k, view in enumerate(self.views):
            if view.pose.shape != (3,) or not np.isfinite(view.pose).all():
                raise ValueError(
                    f'the pose of a key view must be three finite numbers, got {view.pose} of '
                    f'number {k}; teach the route again'
                )

    def seen_by(self, camera: CameraModel) -> 'Route':
        """
        Return the route with learnt features at the pixels where ``camera`` shows their rays.

        Photographs and keypoints stay what the camera that taught it saw. Raises InputError if
        that is another camera, not the same one calibrated anew.
        """
        self.check_camera(camera)
        if camera == self.camera:
            return self
        views = []
        for view in self.views:
            pixels = camera.pixels(self.camera.rays(view.structure.pixels))
            views.append(replace(view, structure=replace(view.structure, pixels=pixels)))
        return Route(camera, tuple(views))

    def check_camera(self, camera: CameraModel) -> None:
        """Raise InputError if the route was taught with another camera, by more than 1 deg."""
        mine, its = (self.camera.width, self.camera.height), (camera.width, camera.height)
        if mine != its:
            raise InputError(
                f'the route was taught at {mine[0]}x{mine[1]}, the camera gives '
                f'{its[0]}x{its[1]}; set that resolution, or teach the route anew'
            )
        if not are_alike(self.camera, camera):
            raise InputError(
                f'the route was taught with another camera: {differences(self.camera, camera)}, '
                f'{CALIBRATION_DEG:g} at most; use the camera of then, or teach the route anew'
            )

    @property
    def length(self) -> float:
        """Length of the way from the first to the last key view [m]."""
        return self.views[-1].way - self.views[0].way

    @property
    def stations(self) -> list[int]:
        """Numbers of the key views that are stations."""
        return [k for k, view in enumerate(self.views) if view.is_station]
