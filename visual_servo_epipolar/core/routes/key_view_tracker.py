"""Key view tracker: the features of one key view in the images, and where these were taken."""

import numpy as np

from visual_servo_epipolar.core.arrays import as_gray, FloatArray, Image
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.errors import TrackingError
from visual_servo_epipolar.core.routes.route import RouteView
from visual_servo_epipolar.core.routes.structure import Localizer, ViewPose
from visual_servo_epipolar.core.tracking.alignment.warps import Warps
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.core.tracking.matching import (
    CurrentView,
    match,
    view_of_keypoints,
)
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import Tracker

MARGIN = 8.0  # from the border of the image, of what is expected in it [px]
SETTINGS = TrackerSettings(max_features=60, min_features=20)


class KeyViewTracker:
    """Tracker of one key view: ``features`` of the last image, and why it was not placed."""

    def __init__(
        self, view: RouteView, camera: CameraModel, settings: TrackerSettings = SETTINGS
    ) -> None:
        self._view, self._camera = view, camera
        self._localizer = Localizer(view.structure, camera)
        self._tracker = Tracker(settings)
        self._desired = view_of_keypoints(view.image, view.keypoints)
        self._tracker.set_view(self._desired)
        self.begun, self.reason = False, ''
        self.features = Features()

    def locate(self, image: Image, near: FloatArray) -> ViewPose | None:
        """Return where ``image``, uint8 of shape (H, W), was taken, ``near`` a pose, (3,)."""
        was_begun = self.begun
        if not was_begun:
            self.begin(image, near)
        self.features = features = self._tracker.track(image)
        found = self.place(features, near)
        if found is None and was_begun:  # after a gap they are where the pose has them
            self.begin(image, near)
            self.features = features = self._tracker.track(image)
            found = self.place(features, near)
        self.begun = found is not None
        if found is None:
            count = len(features)
            self.reason = self._tracker.reason or (
                f'{count} features of the key view are in sight, and do not agree on a place'
            )
        return found

    def match(self, image: Image, current: CurrentView) -> Features:
        """Return its features in ``image``, whose keypoints are ``current``, wherever it is."""
        try:
            matches = match(self._desired, current)
        except TrackingError as error:
            self.reason = str(error)
            return Features()
        ids = matches.indices
        desired = self._desired.keypoints.pixels[ids]
        warps = Warps(ids, desired, matches.pixels, matches.scales[:, None, None] * np.eye(2))
        if self._tracker.expect(image, warps) < SETTINGS.min_features:
            return Features()
        return self._tracker.track(image)

    def place(self, features: Features, near: FloatArray) -> ViewPose | None:
        """Return where ``features`` are seen from, ``near`` a pose, (3,); None if unsure."""
        return self._localizer.locate(features.ids, features.current, near)

    def begin(self, image: Image, near: FloatArray) -> None:
        """Look for the features where they are seen from a pose ``near``, (3,)."""
        warps = self._expected(near)
        self.begun = self._tracker.expect(as_gray(image), warps) >= SETTINGS.min_features

    def _expected(self, pose: FloatArray) -> Warps:
        """Return how the photograph's features are seen from a pose, (3,)."""
        pixels = self._view.structure.pixels
        current = self._camera.pixels(self._localizer.rays_seen(pose))
        ids = np.flatnonzero(self._camera.contains(current, margin=MARGIN))
        scales = self._localizer.distances(np.zeros(3)) / self._localizer.distances(pose)
        return Warps(ids, pixels[ids], current[ids], scales[ids, None, None] * np.eye(2))
