"""Two photographs through a fisheye, raw and rectified: the same answer."""

import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from visual_servo_epipolar.commands.main import main
from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings

START = (0.8, -3.0, 10.0)
FISHEYE = {'width': 800, 'height': 640, 'principal_u': 399.5, 'principal_v': 319.5}
FISHEYE |= {'focal_length': 800.0 / math.pi}
RECTIFIED = Camera(800, 640, 400.0, 400.0, 399.5, 319.5)
FILE = """
image_width: 800
image_height: 640
camera_matrix: {rows: 3, cols: 3, data: [254.648, 0, 399.5, 0, 254.648, 319.5, 0, 0, 1]}
distortion_model: fisheye
distortion_coefficients: {rows: 1, cols: 4, data: [0, 0, 0, 0]}
projection_matrix: {rows: 3, cols: 4, data: [400, 0, 399.5, 0, 0, 400, 319.5, 0, 0, 0, 1, 0]}
"""


@pytest.fixture(scope='module')
def photographs(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp('fisheye')
    settings = CameraSettings(**FISHEYE, distortion_model='equidistant')
    world = CameraSimulator(settings)
    u, v = np.meshgrid(np.arange(800.0), np.arange(640.0))
    rays = RECTIFIED.rays(np.stack([u.ravel(), v.ravel()], axis=1))
    maps = settings.camera.pixels(rays).reshape(640, 800, 2).astype(np.float32)
    for name, pose in (('desired', (0.0, 0.0, 0.0)), ('current', START)):
        image = world.capture(Pose.from_start(*pose), 0)
        rectified = cv2.remap(image, maps[..., 0], maps[..., 1], cv2.INTER_LANCZOS4)
        assert cv2.imwrite(str(folder / f'raw_{name}.png'), image)
        assert cv2.imwrite(str(folder / f'rectified_{name}.png'), rectified)
    (folder / 'camera.yaml').write_text(FILE)
    return folder


@pytest.mark.parametrize('kind', ['raw', 'rectified'])
def test_the_bearings_are_those_of_the_true_poses(photographs: Path, kind: str) -> None:
    result, overlay = photographs / f'{kind}.json', photographs / f'{kind}_overlay.png'
    code = main(
        [
            'inspect',
            *(str(photographs / f'{kind}_{name}.png') for name in ('desired', 'current')),
            *('--camera', str(photographs / 'camera.yaml')),
            *('--json', str(result), '--out', str(overlay)),
            *(['--rectified'] if kind == 'rectified' else []),
        ]
    )
    told, truth = json.loads(result.read_text()), Bearings.from_pose(Pose.from_start(*START))
    assert code == 0
    assert told['bearing_current_deg'] == pytest.approx(math.degrees(truth.current), abs=0.4)
    assert told['bearing_desired_deg'] == pytest.approx(math.degrees(truth.desired), abs=0.4)
    assert told['rotation_deg'] == pytest.approx(START[2], abs=0.3)
    bearing = math.radians(told['bearing_current_deg'])
    abscissa = (
        400.0 * math.tan(bearing) if kind == 'rectified' else FISHEYE['focal_length'] * bearing
    )
    assert told['epipole_current_px'] == pytest.approx(abscissa, abs=0.1)
    assert overlay.stat().st_size > 10_000


def test_a_camera_file_without_p_cannot_be_of_rectified_photographs(
    photographs: Path, tmp_path: Path, capsys
) -> None:
    lines = [line for line in FILE.splitlines() if 'projection' not in line]
    (tmp_path / 'camera.yaml').write_text('\n'.join(lines))
    images = [str(photographs / f'rectified_{name}.png') for name in ('desired', 'current')]
    code = main(['inspect', *images, '--camera', str(tmp_path / 'camera.yaml'), '--rectified'])
    assert code == 2
    assert "camera file lacks 'projection_matrix'" in capsys.readouterr().err
