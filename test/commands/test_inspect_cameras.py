"""Two photographs and the camera files of many programs: right, or refused with the reason."""

import math
from pathlib import Path

from calibration_files import CAMCHAIN
import cv2
from durations import few_of
from inspected import assert_right, inspect, kept
import numpy as np
import pytest
import yaml

from visual_servo_epipolar.commands.main import main
from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.cameras.registry import scaled
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.messages.camera_file import to_document
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.cameras import CameraSettings

START = (1.0, -3.5, 8.0)
SIZE = {'width': 640, 'height': 480}
SMALL = {**SIZE, 'focal_length': 385.0, 'principal_u': 322.25, 'principal_v': 238.75}
TRUE = CameraSettings(**SMALL).camera


@pytest.fixture(scope='module')
def photographs(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp('photographs')
    world = CameraSimulator(CameraSettings(**SMALL))
    poses = {'desired': (0.0, 0.0, 0.0), 'current': START}
    images = {name: world.capture(Pose.from_start(*pose), 0) for name, pose in poses.items()}
    return kept(folder, images)


def inspected_by(folder: Path, camera: str | Camera, *more: str) -> tuple[int, dict]:
    if isinstance(camera, Camera):
        camera = yaml.safe_dump(to_document(camera))
    (folder / 'camera.yaml').write_text(camera)
    return inspect(folder, 'current', *more)


def test_a_camera_is_named_after_the_file(photographs: Path, capsys) -> None:
    assert inspected_by(photographs, CAMCHAIN)[0] == 2
    assert 'has the cameras cam0, cam1, cam2, got no name' in capsys.readouterr().err
    images = [str(photographs / f'{name}.png') for name in ('desired', 'current')]
    named = f'{photographs / "camera.yaml"}#cam2'
    assert main(['inspect', *images, '--camera', named]) == 2
    assert 'cam2.camera_model must be pinhole' in capsys.readouterr().err


@pytest.mark.parametrize('scale', [0.5, 2.0])
def test_a_focal_length_that_the_matches_contradict_is_not_trusted(photographs, scale) -> None:
    wrong = Camera(640, 480, scale * TRUE.fx, scale * TRUE.fy, TRUE.cx, TRUE.cy)
    code, result = inspected_by(photographs, wrong)
    assert (code, result['trusted']) == (1, False)
    assert f'a focal length of {scale * 385:.0f} px, and they say' in result['reason']


TILTED = 'is what a level camera seems to have where K is of another image'


@pytest.mark.parametrize(
    ('scale', 'words'),
    few_of([(0.9, ''), (1.1, '')]) + few_of([(1.25, TILTED), (1.4, TILTED), (2.0, TILTED)]),
)
def test_a_k_that_is_off_is_not_trusted_though_it_were_a_crop(photographs, scale, words) -> None:
    code, result = inspected_by(photographs, scaled(TRUE, (640, 480), scale, scale), '--cropped')
    assert (code, result['trusted']) == (1, False)
    assert words in result['reason']


def test_a_crop_is_right_with_cropped(photographs: Path, tmp_path: Path, capsys) -> None:
    for name in ('desired', 'current'):
        image = cv2.imread(str(photographs / f'{name}.png'))[:, 200:]
        cv2.imwrite(str(tmp_path / f'{name}.png'), image)
    crop = Camera(440, 480, TRUE.fx, TRUE.fy, TRUE.cx - 200.0, TRUE.cy)
    assert inspected_by(tmp_path, crop)[0] == 2
    assert 'say that the image is a crop (cropped)' in capsys.readouterr().err
    code, result = inspected_by(tmp_path, crop, '--cropped')
    assert code == 0
    assert_right(result, START, 0.3)


START_WIDE = (0.8, -3.0, 10.0)
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
def wide(tmp_path_factory) -> Path:
    settings = CameraSettings(**FISHEYE, distortion_model='equidistant')
    world, images = CameraSimulator(settings), {}
    u, v = np.meshgrid(np.arange(800.0), np.arange(640.0))
    rays = RECTIFIED.rays(np.stack([u.ravel(), v.ravel()], axis=1))
    maps = settings.camera.pixels(rays).reshape(640, 800, 2).astype(np.float32)
    for name, pose in (('desired', (0.0, 0.0, 0.0)), ('current', START_WIDE)):
        images[f'raw_{name}'] = image = world.capture(Pose.from_start(*pose), 0)
        rectified = cv2.remap(image, maps[..., 0], maps[..., 1], cv2.INTER_LANCZOS4)
        images[f'rectified_{name}'] = rectified
    return kept(tmp_path_factory.mktemp('fisheye'), images, FILE)


@pytest.mark.parametrize('kind', ['raw', 'rectified'])
def test_the_bearings_are_those_of_the_true_poses(wide, kind) -> None:
    overlay = wide / f'{kind}_overlay.png'
    options = ['--out', str(overlay), *(['--rectified'] if kind == 'rectified' else [])]
    code, told = inspect(wide, f'{kind}_current', *options, desired=f'{kind}_desired')
    assert code == 0
    assert_right(told, START_WIDE, 0.4)
    bearing, focal = math.radians(told['bearing_current_deg']), FISHEYE['focal_length']
    abscissa = 400.0 * math.tan(bearing) if kind == 'rectified' else focal * bearing
    assert told['epipole_current_px'] == pytest.approx(abscissa, abs=0.1)
    assert overlay.stat().st_size > 10_000
