"""
Places: where on a route an image was taken, by the photographs alone.

Each descriptor of an image votes for the key views that have the nearest of all descriptors, where
it is by far the nearest; of the shortlist, a geometry must pass.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
import math

import numpy as np

from visual_servo_epipolar.core.arrays import as_gray, FloatArray, Image
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.geometry.motion import compose, relative_pose
from visual_servo_epipolar.core.routes.chain import seam
from visual_servo_epipolar.core.routes.descriptor_index import DescriptorIndex
from visual_servo_epipolar.core.routes.key_view_tracker import KeyViewTracker
from visual_servo_epipolar.core.routes.path import PathPoint
from visual_servo_epipolar.core.routes.route import Route, RouteView
from visual_servo_epipolar.core.routes.structure import SCALE_DEVIATION, ViewPose
from visual_servo_epipolar.core.tracking.canvas import Canvas
from visual_servo_epipolar.core.tracking.matchers.sift import detect
from visual_servo_epipolar.core.tracking.matching import CurrentView

MOST_KEYPOINTS = 500  # of the image that is looked for
SHORTLIST = 5  # key views that are looked at closely
KEPT = 2 * SHORTLIST  # photographs that stay in memory
STARTS = 4  # parts of the path of each, in which its place is looked for
LEAST_VOTES = 6  # of a key view to be on it
RATIO = 0.85  # of the nearest to the nearest of another place
SAME_PLACE = 4  # key views before and after that show the same
LEAST_INLIERS, LEAST_SHARE = 18, 0.6  # of a geometry that is believed
CERTAIN = 0.05  # deviation of a place that is believed, also by its witnesses alone [m]
FARTHEST = 3.0  # from the path, that the structure can tell [m]
MOST_TURN = 1.2  # from its heading, of a camera that does not see all around [rad]
LAP_APART = 0.5  # by how much a lap may differ of what is one place [m]
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
    """
    Finds images on a route; ``reason`` says why the last one was not found.

    Of a way that closes, places a ``lap`` [m] apart are one.
    """

    def __init__(self, route: Route) -> None:
        self.route, self.reason, self.lap = route, '', math.inf
        self.is_ambiguous = False  # two places fit the last image
        # A robot that stands looks at the same few photographs again and again.
        self._view = lru_cache(maxsize=KEPT)(lambda number: route.views[number].loaded())

    @cached_property
    def _seams(self) -> FloatArray:
        """By how much each key view differs from a neighbour, at most, (K,) [m]."""
        between = np.pad(np.nan_to_num(seam(self.route.views)), 1)
        return np.maximum(between[:-1], between[1:])

    @cached_property
    def _index(self) -> DescriptorIndex:
        views = self.route.views
        counts = [sum(len(each.keypoints) for each in view.appearances) for view in views]
        descriptors = [each.keypoints.descriptors for view in views for each in view.appearances]
        return DescriptorIndex(
            np.concatenate(descriptors), np.repeat(np.arange(len(views)), counts)
        )

    def votes(self, image: Image, among: range | None = None) -> FloatArray:
        """
        Return for each key view how many descriptors of an image are by far nearest to its.

        Those not ``among`` these numbers have none, and are no rivals where rooms look alike.
        """
        keypoints = detect(as_gray(image), limit=MOST_KEYPOINTS)
        votes = np.zeros(len(self.route.views))
        numbers = np.arange(len(votes)) if among is None else np.array(among)
        if not len(keypoints):
            return votes
        # Of one norm: the nearest has the largest product.
        owners, products = self._index.nearest(keypoints.descriptors, numbers)
        norm = float(np.median((keypoints.descriptors**2).sum(axis=1)))
        squared = np.maximum(2.0 * (norm - products), 0.0)
        rows, nearest = np.arange(len(squared)), squared.argmin(axis=1)
        apart = np.abs(owners - owners[rows, nearest][:, None]) > SAME_PLACE
        least = squared[rows, nearest]
        other = np.where(apart, squared, np.inf).min(axis=1)
        distinct = least < RATIO**2 * other
        near = (squared < least[:, None] / RATIO**2) & distinct[:, None] & ~apart
        # Each descriptor has one vote for a key view, however many of its are near.
        pairs = np.unique(np.stack([np.nonzero(near)[0], owners[near]]), axis=1)
        np.add.at(votes, pairs[1], 1.0)
        return votes

    def find(self, image: Image, among: range | None = None) -> Place | None:
        """
        Return where ``image``, uint8 of shape (H, W), was taken; None, and why, if unsure.

        Only the key views ``among`` these numbers are looked at, where that is not None.
        """
        self.is_ambiguous = False
        votes = self.votes(image, among)
        shortlist = [k for k in np.argsort(-votes)[:SHORTLIST].tolist() if votes[k] >= LEAST_VOTES]
        if not shortlist:
            self.reason = (
                f'no key view has {LEAST_VOTES} features in common with the image, the best has '
                f'{votes.max():.0f}; put the robot on the route, looking along it'
            )
            return None
        image = as_gray(image)
        current = CurrentView(Canvas.of(self.route.camera).painted(image))
        places = [self._verified(image, current, k) for k in shortlist]
        found = [place for place in places if place is not None]
        if not found:
            self.reason = (
                f'{len(shortlist)} key views look alike, and none fits as a place; put the robot '
                'on the route, looking along it'
            )
            return None
        most = max(place.pose.inliers for place in found)
        alike = [place for place in found if place.pose.inliers > RIVAL * most]
        best = min(alike, key=lambda place: float(np.linalg.norm(place.pose.pose[:2])))
        rivals = [
            place
            for place in alike
            if (apart := abs(place.way - best.way)) > FARTHEST
            and abs(apart - self.lap) > LAP_APART
        ]
        if rivals:
            self.is_ambiguous = True
            self.reason = (
                f'two places look alike, after {best.way:.1f} m and {rivals[0].way:.1f} m; drive '
                'on a little'
            )
            return None
        self.reason = ''
        return best

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
        views, best = self.route.views, (math.inf, number, pose, 0.0)
        for k in range(max(number - SAME_PLACE, 0), min(number + SAME_PLACE + 1, len(views))):
            # The path of a key view ends soon before and behind it.
            here = compose(relative_pose(views[k].pose, views[number].pose), pose)
            apart = np.linalg.norm(views[k].path.poses[:, :2] - here[:2], axis=1)
            nearest = int(np.argmin(apart))
            if apart[nearest] < best[0]:
                best = float(apart[nearest]), k, here, float(views[k].path.way[nearest])
        _, k, here, way = best
        return views[k].path.beside(here, way)


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
