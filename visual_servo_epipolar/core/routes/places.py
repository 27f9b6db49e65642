"""
Places: where on a route an image was taken, by the photographs alone.

Each descriptor of an image votes for the key views that have the nearest of all descriptors, where
it is by far the nearest; of the shortlist, a geometry must pass.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
import math
from operator import itemgetter

import numpy as np

from visual_servo_epipolar.core.arrays import as_gray, FloatArray, Image
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.geometry.motion import compose, relative_pose
from visual_servo_epipolar.core.routes.chain import seam
from visual_servo_epipolar.core.routes.key_view_tracker import KeyViewTracker
from visual_servo_epipolar.core.routes.path import PathPoint
from visual_servo_epipolar.core.routes.route import (
    FARTHEST,
    OVERLAP,
    Route,
    RouteView,
    SAME_TURN,
)
from visual_servo_epipolar.core.routes.structure import SCALE_DEVIATION, ViewPose
from visual_servo_epipolar.core.tracking.canvas import Canvas
from visual_servo_epipolar.core.tracking.matchers.sift import detect, ENOUGH
from visual_servo_epipolar.core.tracking.matching import CurrentView

SHORTLIST = 5  # key views that are looked at closely
STARTS = 4  # parts of the path of each, in which its place is looked for
LEAST_VOTES = 6  # of a key view to be on it
RATIO = 0.85  # of the nearest to the nearest of another place
SAME_PLACE = 4  # key views before and after that show the same
LEAST_INLIERS, LEAST_SHARE = 18, 0.6  # of a geometry that is believed
CERTAIN = 0.05  # deviation of a place that is believed, also by its witnesses alone [m]
MOST_TURN = 1.2  # from its heading, of a camera that does not see all around [rad]
RIVAL = 0.7  # of the inliers of the best: another place with so many leaves it open


@dataclass(frozen=True, eq=False)
class Place:
    """
    Place on a route: the key ``view`` ahead, the camera's pose in its axes, the ``way`` [m].

    ``offset`` to the left of the path [m], and ``turn`` to the left of its heading [rad]. Its key
    view and a neighbour differ by ``seam`` [m].
    """

    view: int
    pose: ViewPose
    way: float
    offset: float
    turn: float
    seam: float = 0.0

    @property
    def deviation(self) -> float:
        """The deviation of its position [m], with what all features of a key view share."""
        by_image = max(self.pose.covariance[0, 0], self.pose.covariance[1, 1])
        by_scale = SCALE_DEVIATION * float(np.linalg.norm(self.pose.pose[:2]))
        return math.hypot(math.sqrt(by_image), by_scale, self.seam)


class PlaceFinder:
    """Finds images on a route; ``reason`` says why the last one was not found."""

    def __init__(self, route: Route) -> None:
        self.route, self.reason = route, ''
        # A robot that stands looks at the same few photographs again and again.
        self._view = lru_cache(maxsize=2 * SHORTLIST)(lambda number: route.views[number].loaded())

    @cached_property
    def _seams(self) -> FloatArray:
        """By how much each key view differs from a neighbour, at most, (K,) [m]."""
        between = np.pad(np.nan_to_num(seam(self.route.views)), 1)
        return np.maximum(between[:-1], between[1:])

    @cached_property
    def _descriptors(self) -> list[FloatArray]:
        """The descriptors of all photographs of each key view."""
        looks = [
            [it.keypoints.descriptors for it in view.appearances] for view in self.route.views
        ]
        return [np.concatenate(each) for each in looks]

    @cached_property
    def lap(self) -> float:
        """Way after which the route meets its own beginning [m]; inf where it does not."""
        last = self.route.views[-1]
        alike = self._alike(last.image, range((len(self.route.views) + 1) // 2))
        ways = [place.way for place in alike]
        if not alike or max(ways) - min(ways) > FARTHEST:
            return math.inf
        place = min(alike, key=_away)
        is_beside = abs(place.offset) < OVERLAP and abs(place.turn) < SAME_TURN
        return last.way - place.way if is_beside and place.way > -OVERLAP else math.inf

    def votes(self, image: Image, among: range | None = None) -> FloatArray:
        """
        Return for each key view how many descriptors of an image are by far nearest to its.

        Those not ``among`` these numbers have none, and are no rivals where rooms look alike.
        """
        keypoints = detect(as_gray(image), limit=ENOUGH)
        votes = np.zeros(len(self.route.views))
        numbers = np.arange(len(votes)) if among is None else np.array(among)
        if not len(keypoints):
            return votes
        # Of one norm: the nearest has the largest product.
        descriptors = keypoints.descriptors
        products = [
            (descriptors @ self._descriptors[k].T).max(axis=1, initial=-np.inf) for k in numbers
        ]
        norm = float(np.median((descriptors**2).sum(axis=1)))
        squared = np.maximum(2.0 * (norm - np.stack(products, axis=1)), 0.0)
        least, nearest = squared.min(axis=1), numbers[squared.argmin(axis=1)]
        apart = np.abs(numbers - nearest[:, None]) > SAME_PLACE
        other = np.where(apart, squared, np.inf).min(axis=1)
        distinct = least < RATIO**2 * other
        near = (squared < least[:, None] / RATIO**2) & distinct[:, None] & ~apart
        votes[numbers] = near.sum(axis=0)
        return votes

    def find(self, image: Image, among: range | None = None) -> Place | None:
        """
        Return where ``image``, uint8 of shape (H, W), was taken; None, and why, if unsure.

        Only the key views ``among`` these numbers are looked at, where that is not None. Of a way
        that closes, places a lap apart are one.
        """
        alike = self._alike(image, among)
        if not alike:
            return None
        best = min(alike, key=_away)
        for place in alike:
            apart = abs(place.way - best.way)
            if apart > FARTHEST and abs(apart - self.lap) > OVERLAP:
                self.reason = (
                    f'two places look alike, after {best.way:.1f} m and {place.way:.1f} m; drive '
                    'on a little'
                )
                return None
        self.reason = ''
        return best

    def _alike(self, image: Image, among: range | None) -> list[Place]:
        """Return the places that fit an image nearly as well as the best; none, and why."""
        votes = self.votes(image, among)
        shortlist = [k for k in np.argsort(-votes)[:SHORTLIST].tolist() if votes[k] >= LEAST_VOTES]
        if not shortlist:
            self.reason = (
                f'no key view has {LEAST_VOTES} features in common with the image, the best has '
                f'{votes.max():.0f}; put the robot on the route, looking along it'
            )
            return []
        image = as_gray(image)
        current = CurrentView(Canvas.of(self.route.camera).painted(image))
        places = [place for k in shortlist if (place := self._verified(image, current, k))]
        if not places:
            self.reason = (
                f'{len(shortlist)} key views look alike, and none fits as a place; put the robot '
                'on the route, looking along it'
            )
        most = max((place.pose.inliers for place in places), default=0)
        return [place for place in places if place.pose.inliers > RIVAL * most]

    def _verified(self, image: Image, current: CurrentView, number: int) -> Place | None:
        view = self._view(number)
        found = _located(image, current, view, self.route.camera)
        if found is None:
            return None
        point = self._beside(number, found.pose)
        place = Place(number, found, *point[:3], self._seams[number])
        is_turned = abs(point.turn) > MOST_TURN and not self.route.camera.wraps
        is_near = abs(point.offset) < FARTHEST and not is_turned
        return place if is_near and place.deviation < CERTAIN else None

    def _beside(self, number: int, pose: FloatArray) -> PathPoint:
        """Return where a pose in axes of a key view is beside the path, by the next key view."""
        own, first = self.route.views[number], max(number - SAME_PLACE, 0)
        samples = []
        for view in self.route.views[first : number + SAME_PLACE + 1]:
            # The path of a key view ends soon before and behind it.
            here = compose(relative_pose(view.pose, own.pose), pose)
            apart = np.linalg.norm(view.path.poses[:, :2] - here[:2], axis=1)
            samples.append((apart.min(), view.path, here, view.path.way[apart.argmin()]))
        _, path, here, way = min(samples, key=itemgetter(0))
        return path.beside(here, float(way))


def _away(place: Place) -> float:
    """Return how far a place is from its key view [m]."""
    return float(np.linalg.norm(place.pose.pose[:2]))


def _located(
    image: Image, current: CurrentView, view: RouteView, camera: CameraModel
) -> ViewPose | None:
    """Return where an image was taken, by matching it with one key view; None if that fails."""
    tracker = KeyViewTracker(view, camera)
    features = tracker.match(image, current)
    parts = np.array_split(view.path.poses, min(STARTS, len(view.path.poses)))
    places = [place for part in parts if (place := tracker.place(features, part)) is not None]
    best = max(places, key=lambda place: place.inliers, default=None)
    # What is not matched is looked for where the structure predicts it from there.
    again = None if best is None else tracker.locate(image, best.pose)
    if best is not None and again is not None and again.inliers > best.inliers:
        best, features = again, tracker.features
    if best is None or best.inliers < max(LEAST_INLIERS, LEAST_SHARE * len(features)):
        return None
    return best if best.unaided < CERTAIN else None
