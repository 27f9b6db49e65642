"""Tracking in an image message, live and in replay: what cannot be tracked is refused in words."""

from dataclasses import dataclass
from typing import Any

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.cameras.registry import camera_of_size
from visual_servo_epipolar.core.errors import TrackingError
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.messages import read
from visual_servo_epipolar.messages.validation import checked_image


@dataclass(frozen=True, slots=True, eq=False)
class TrackingResult:
    """Result of tracking in an image: no features, and a warning, if it is refused."""

    features: Features
    image: Image | None
    warning: str
    camera: CameraModel | None = None


def track(
    tracker: Tracker,
    message: Any,
    camera: CameraModel | str,
    *,
    projection: str = '',
) -> TrackingResult:
    """
    Track features in an image message; ``camera`` may be the reason why there is none.

    Where it is '' the size of the image tells it, by its ``projection``.
    """
    image: Image | None = None
    try:
        gray = read.gray(message)
        if camera == '':
            camera = camera_of_size(projection, (gray.shape[1], gray.shape[0]))
        known = checked_image(gray, camera)
        image = gray
        tracker.see_through(known)
        features = tracker.track(image)
    except (ValueError, TrackingError) as error:
        return TrackingResult(Features(), image, f'image refused: {error}')
    return TrackingResult(features, image, tracker.reason, known)
