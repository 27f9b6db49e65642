"""Two photographs for `visual_servo inspect`: a camera, the command, and what is true of them."""

import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest
import small_cameras

from visual_servo_epipolar.commands.main import main
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import Pose

SMALL = small_cameras.sized(640, 480, 384.6, 327.0, 233.0)
CAMERA = """
image_width: 640
image_height: 480
camera_name: test
camera_matrix: {rows: 3, cols: 3, data: [384.6, 0, 327, 0, 384.6, 233, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}
"""


def kept(folder: Path, images: dict[str, np.ndarray], camera: str = CAMERA) -> Path:
    """Write images by name, and a camera file; return their folder."""
    for name, image in images.items():
        assert cv2.imwrite(str(folder / f'{name}.png'), image)
    (folder / 'camera.yaml').write_text(camera)
    return folder


def inspect(folder: Path, current: str, *more: str, desired: str = 'desired') -> tuple[int, dict]:
    """Inspect two photographs of a folder by its camera file; return the exit code and JSON."""
    result = folder / f'{current}.json'
    result.unlink(missing_ok=True)
    images = [str(folder / f'{name}.png') for name in (desired, current)]
    options = ['--camera', str(folder / 'camera.yaml'), '--json', str(result), *more]
    code = main(['inspect', *images, *options])
    return code, json.loads(result.read_text()) if result.exists() else {}


def assert_right(result: dict, start: tuple[float, float, float], tolerance: float) -> None:
    """Hold bearings and rotation [deg] against those of a pose."""
    truth = Bearings.from_pose(Pose.from_start(*start))
    true = [*map(math.degrees, (truth.current, truth.desired)), start[2]]
    names = 'bearing_current_deg', 'bearing_desired_deg', 'rotation_deg'
    assert [result[name] for name in names] == pytest.approx(true, abs=tolerance)
