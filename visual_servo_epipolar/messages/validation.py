"""Validation of incoming images and tracks before they reach the core, live and in replay."""

from typing import Any

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.messages import read

BORDER_PX = 1.0  # a refined feature may end a little outside of the image


def checked_tracks(message: Any, camera: CameraModel) -> tuple[Features, str]:
    """Return the features of a sensor_msgs/PointCloud2; none, and a warning, if it is refused."""
    try:
        features = read.features(message)
    except ValueError as error:
        return Features(), f'tracks refused: {error}'
    return checked_features(features, camera)


def checked_features(features: Features, camera: CameraModel) -> tuple[Features, str]:
    """Return ``features``; none, and a warning, if they cannot come from ``camera``."""
    different = len(set(features.ids.tolist()))
    if different < len(features):
        return Features(), (
            f'tracks refused: of {len(features)} ids {different} differ; connect the tracks of '
            'one tracker_node'
        )
    current, desired = features.current, features.desired
    inside = camera.contains(current, margin=-BORDER_PX)
    inside &= camera.contains(desired, margin=-BORDER_PX)
    if inside.all():
        return features, ''
    return Features(), (
        f'tracks refused: {int((~inside).sum())} of {len(inside)} features lie outside an image '
        f'of {camera.width}x{camera.height} px; connect the camera_info of the camera they are '
        'tracked in'
    )


def left_out(observation: Observation, camera: CameraModel) -> str:
    """Return what to say of features that the lens cannot place, or ''."""
    if not observation.dropped:
        return ''
    whole = len(observation) + observation.dropped
    return (
        f'{observation.dropped} of {whole} features are left out: they lie where the '
        f'{camera.lens} lens of camera_info cannot be undone; calibrate it up to the edges'
    )


def of_two_cameras(topics: tuple[str, str], frames: tuple[str, str]) -> str:
    """
    Return that images and camera_info may be of two cameras, or ''.

    ``topics`` and ``frames``, frame_ids, are those of both. Some drivers leave the frame empty.
    """
    image, info = (frame.lstrip('/') for frame in frames)
    spaces = [topic.removesuffix('/compressed').rpartition('/')[0] for topic in topics]
    alike, why = spaces[0] == spaces[1], 'in two namespaces, and no frame_id tells'
    if image and info:
        alike, why = image == info, f'of the frames {image!r:.40} and {info!r:.40}'
    return '' if alike else f'{topics[0]} and {topics[1]} may be of two cameras, {why}'


def checked_image(image: Image, camera: CameraModel | str) -> CameraModel:
    """Return the camera of an ``image``; ValueError where it cannot be that, or there is none."""
    height, width = image.shape
    if isinstance(camera, str):
        raise ValueError(f'camera_info cannot be used: {camera}')
    if (width, height) != (camera.width, camera.height):
        raise ValueError(
            f'image has {width}x{height} px, its camera_info says '
            f'{camera.width}x{camera.height}; calibrate at the resolution in use'
        )
    return camera
