"""What becomes of an image or of tracks on the way to the core: for nodes and replay alike."""

from dataclasses import dataclass
from typing import Any

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.geometry.camera import Camera
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.messages import read

BORDER_PX = 1.0  # a refined feature may end a little outside of the image


@dataclass(frozen=True, slots=True, eq=False)
class Tracking:
    """What was found in an image: none, and why, where the image or its camera is refused."""

    features: Features
    image: Image | None
    complaint: str


def track(tracker: Tracker, message: Any, camera: Camera | str) -> Tracking:
    """Track features in a sensor_msgs/Image; ``camera`` may be the reason why there is none."""
    image: Image | None = None
    try:
        gray = read.gray(message)
        _check_size(gray, camera)
        image = gray
        features = tracker.track(image)
    except ValueError as error:
        return Tracking(Features(), image, f'image refused: {error}')
    return Tracking(features, image, tracker.reason)


def tracks(message: Any, camera: Camera) -> tuple[Features, str]:
    """Return the features in a sensor_msgs/PointCloud2: none, and why, where it is refused."""
    try:
        features = read.features(message)
    except ValueError as error:
        return Features(), f'tracks refused: {error}'
    return believed(features, camera)


def believed(features: Features, camera: Camera) -> tuple[Features, str]:
    """Return ``features``: none, and why, if they cannot come from ``camera``."""
    current, desired = features.current, features.desired
    inside = camera.contains(current, margin=-BORDER_PX) & camera.contains(
        desired, margin=-BORDER_PX
    )
    if inside.all():
        return features, ''
    return Features(), (
        f'tracks refused: {int((~inside).sum())} of {len(features)} features lie outside an image '
        f'of {camera.width}x{camera.height} px; connect the camera_info of the camera they are '
        'tracked in'
    )


def _check_size(image: Image, camera: Camera | str) -> None:
    height, width = image.shape
    if isinstance(camera, str):
        raise ValueError(f'camera_info cannot be used: {camera}')
    if (width, height) != (camera.width, camera.height):
        raise ValueError(
            f'image has {width}x{height} px, its camera_info says '
            f'{camera.width}x{camera.height}; calibrate at the resolution in use'
        )
