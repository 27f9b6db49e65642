"""A matcher of one's own: ORB, which is quicker than SIFT and finds less."""

import cv2
import numpy as np

from visual_servo_epipolar.core.tracking.matchers.base import Keypoints, mutual_nearest


class Orb:
    """Binary descriptors, as vectors of zeros and ones; sizes and angles are not told."""

    def describe(self, image, *, limit, border):
        """Return the keypoints of a photograph."""
        points, descriptors = cv2.ORB_create(limit).detectAndCompute(image, None)
        if descriptors is None:
            return Keypoints.empty()
        pixels, ones = np.array([point.pt for point in points]), np.ones(len(points))
        return Keypoints(pixels, ones, 0.0 * ones, np.float32(np.unpackbits(descriptors, axis=1)))

    def detect(self, image, tuning, *, limit, quick):
        """Return the keypoints of a current image."""
        return self.describe(image, limit=limit, border=0.0)

    def pairs(self, desired, current):
        """Return those that are each other's nearest."""
        return mutual_nearest(desired.descriptors, current.descriptors)


ORB = Orb()
