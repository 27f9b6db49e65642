"""Draws light.jpg: each light beside its photograph. `python light_figure.py [TARGET.jpg]`."""

from pathlib import Path
import sys

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.light import LightSettings
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings

CAMERA = CameraSettings(
    width=640,
    height=512,
    focal_length=384.6153846,
    principal_u=317.25,
    principal_v=255.75,
)
START = Pose.from_start(0.4, -1.5, 4.0)
TILE = (300, 240)
ROWS = (
    ('noon', 'none'),
    ('ceiling', 'none'),
    ('dusk', 'none'),
    ('lamp_right', 'none'),
    ('lamp_side', 'none'),
    ('dark', 'none'),
    ('window', 'door'),
    ('dusk', 'monitor'),
)


def draw() -> Image:
    """Return photograph, image by a fixed and image by an automatic exposure, a row a light."""
    rows = []
    for light, changed in ROWS:
        tiles = []
        for exposure in ('fixed', 'auto'):
            settings = LightSettings(
                light=light, photograph_light='noon', changed=changed, exposure=exposure
            )
            camera = CameraSimulator(CAMERA, None, settings)
            if not tiles:
                tiles.append(_tile(camera.photograph(), 'photograph, noon'))
            name = light if changed == 'none' else f'{light}, {changed}'
            tiles.append(_tile(camera.capture(START, 0), f'{name}, {exposure}'))
        rows.append(np.hstack(tiles))
    return np.asarray(np.vstack(rows), np.uint8)


def _tile(image: Image, title: str) -> Image:
    """Return a small copy of ``image``, shape (H, W), under its title and mean grey."""
    tile = cv2.resize(image, TILE, interpolation=cv2.INTER_AREA)
    tile = cv2.copyMakeBorder(tile, 20, 0, 0, 4, cv2.BORDER_CONSTANT, value=255)
    words = f'{title}: mean {image.mean():.0f}'
    cv2.putText(tile, words, (2, 14), cv2.FONT_HERSHEY_SIMPLEX, 0.42, 0, 1, cv2.LINE_AA)
    return np.asarray(tile, np.uint8)


if __name__ == '__main__':
    target = sys.argv[1] if len(sys.argv) > 1 else str(Path(__file__).with_name('light.jpg'))
    cv2.imwrite(target, draw(), [cv2.IMWRITE_JPEG_QUALITY, 82])
