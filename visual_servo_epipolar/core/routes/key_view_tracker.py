"""Key view tracker: the features of one key view in the images, and where these were taken."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from visual_servo_epipolar.core.arrays import as_gray, FloatArray, Image
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.errors import TrackingError
from visual_servo_epipolar.core.routes.route import Appearance, in_memory, RouteView
from visual_servo_epipolar.core.routes.structure import Localizer, ViewPose
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.core.tracking.matchers.base import Keypoints
from visual_servo_epipolar.core.tracking.matchers.sift import detect
from visual_servo_epipolar.core.tracking.matching import (
    BORDER,
    CurrentView,
    LIMIT,
    match,
    view_of_keypoints,
    warps_of,
)
from visual_servo_epipolar.core.tracking.photographs import FEW
from visual_servo_epipolar.core.tracking.robust_geometry import EPIPOLAR_PX
from visual_servo_epipolar.core.tracking.sampling import inside_border, patch_radius
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import MARGIN, Tracker
from visual_servo_epipolar.core.tracking.warps import Warps

SETTINGS = TrackerSettings(min_features=FEW)
ENOUGH = TrackerSettings.min_features  # of a photograph that is good enough: the first one rules


class KeyViewTracker:
    """Tracker of one key view: ``features`` of the last image, and why it was not placed."""

    def __init__(self, view: RouteView, camera: CameraModel) -> None:
        self._view, self._camera = view, camera
        self._localizer = Localizer(view.structure, camera)
        self._tracked = [_TrackedAppearance(view, view.appearances[0], camera)]
        self._used = self._tracked[0]
        self.begun, self.reason = False, ''
        self.features = Features()

    def locate(self, image: Image, near: FloatArray) -> ViewPose | None:
        """Return where ``image``, uint8 of shape (H, W), was taken, ``near`` a pose, (3,)."""
        # After a gap they are where the pose has them.
        for anew in (False, True) if self.begun else (True,):
            if anew:
                self.begin(image, near)
            self.features = self._used.track(image)
            found = self.place(self.features, near)
            if found is not None:
                break
        self.begun = found is not None
        if found is None:
            self.reason = self._used.tracker.reason or (
                f'{len(self.features)} features of the key view are in sight, and do not agree on '
                'a place, or only those of what may have been moved'
            )
        return found

    def match(self, image: Image, current: CurrentView) -> Features:
        """Return its features in ``image``, whose keypoints are ``current``, wherever it is."""
        best = Features()
        for tracked in self._appearances():
            try:
                features = tracked.match(image, current)
            except TrackingError as error:
                self.reason = str(error)
                continue
            if len(features) > len(best):
                best, self._used = features, tracked
            if len(best) >= ENOUGH:
                break
        return best

    def place(self, features: Features, near: FloatArray) -> ViewPose | None:
        """Return where ``features`` are seen from, near poses, (3,) or (K, 3); None if unsure."""
        return self._localizer.locate(features.ids, features.current, near)

    def begin(self, image: Image, near: FloatArray) -> None:
        """Look for the features where they are seen from a pose ``near``, (3,)."""
        image, most = as_gray(image), 0
        for tracked in self._appearances():
            count = tracked.expect(image, self._expected(near, tracked.appearance))
            if count > most:
                most, self._used = count, tracked
            if count >= ENOUGH:
                break
        self.begun = most >= SETTINGS.min_features

    def appearance(self, image: Image, features: Features) -> Appearance:
        """Return ``image`` as another photograph of the key view, by the ``features`` in it."""
        border = patch_radius(image.shape) + BORDER
        shown = inside_border(features.current, image.shape, border)
        rows, pixels = features.ids[shown], features.current[shown]
        keypoints = _described(self._view.keypoints.take(rows), pixels, image)
        return Appearance(in_memory(image.copy()), keypoints, rows)

    def _appearances(self) -> Iterator['_TrackedAppearance']:
        """Yield the photographs, the first one first; others are read when they are needed."""
        for number, appearance in enumerate(self._view.appearances):
            if number == len(self._tracked):
                self._tracked.append(_TrackedAppearance(self._view, appearance, self._camera))
            yield self._tracked[number]

    def _expected(self, pose: FloatArray, appearance: Appearance) -> Warps:
        """Return how the features of a photograph are seen from a pose, (3,)."""
        rows, pixels = appearance.rows, appearance.keypoints.pixels
        current = self._camera.pixels(self._localizer.rays_seen(pose))[rows]
        ids = np.flatnonzero(self._camera.contains(current, margin=MARGIN))
        scales = self._localizer.distances(np.zeros(3)) / self._localizer.distances(pose)
        return Warps(ids, pixels[ids], current[ids], scales[rows][ids, None, None] * np.eye(2))


class _TrackedAppearance:
    """A photograph of a key view, and its tracker; features are those of the structure."""

    def __init__(self, view: RouteView, appearance: Appearance, camera: CameraModel) -> None:
        self.appearance, self._view = appearance, view
        self.tracker = Tracker(SETTINGS, camera, as_many=False)
        canvas, keypoints = self.tracker.canvas, appearance.keypoints
        self._desired = view_of_keypoints(
            canvas.painted(as_gray(appearance.load())),
            replace(keypoints, pixels=canvas.pixels_of_canvas(keypoints.pixels)),
            canvas=canvas,
        )
        self.tracker.set_view(self._desired)

    def expect(self, image: Image, warps: Warps) -> int:
        """Begin anew with ``warps`` in pixels of images; return how many features are there."""
        on_canvas = self.tracker.canvas.pixels_of_canvas
        current, desired = on_canvas(warps.current), on_canvas(warps.desired)
        return self.tracker.expect(image, replace(warps, current=current, desired=desired))

    def track(self, image: Image) -> Features:
        """Return the features in the next image."""
        features = self.tracker.track(image)
        rows = self.appearance.rows[features.ids]
        return replace(features, ids=rows, desired=self._view.structure.pixels[rows])

    def match(self, image: Image, current: CurrentView) -> Features:
        """Return the features in an image, wherever it is; TrackingError where it is another."""
        warps = warps_of(match(self._desired, current), self._desired)
        if self.tracker.expect(image, warps) < SETTINGS.min_features:
            return Features()
        return self.track(image)


def _described(keypoints: Keypoints, pixels: FloatArray, image: Image) -> Keypoints:
    """Return ``keypoints`` at other ``pixels``, (N, 2), described by ``image`` where it can."""
    assert isinstance(keypoints.tuning, int)
    today = detect(as_gray(image), limit=LIMIT, enlargement=keypoints.tuning)
    descriptors = keypoints.descriptors.copy()
    if len(today):
        squared = ((pixels[:, None] - today.pixels[None]) ** 2).sum(axis=2)
        same = squared.min(axis=1, initial=np.inf) < EPIPOLAR_PX**2
        descriptors[same] = today.descriptors[squared[same].argmin(axis=1)]
    return replace(keypoints, pixels=pixels, descriptors=descriptors)
