"""Two photographs and the camera files of many programs: right, or refused with the reason."""

import json
import math
from pathlib import Path

from calibration_files import CAMCHAIN, FILES
import cv2
from durations import few_of
import numpy as np
import pytest
import yaml

from visual_servo_epipolar.commands.main import main
from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.cameras.registry import scaled
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.messages.camera_file import to_document
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings

START = (1.0, -3.5, 8.0)
SIZE = {'width': 640, 'height': 480}
SMALL = {**SIZE, 'focal_length': 385.0, 'principal_u': 322.25, 'principal_v': 238.75}
TRUE = CameraSettings(**SMALL).camera
SHEAR_PX = 4.0  # of the last row against the first


@pytest.fixture(scope='module')
def photographs(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp('photographs')
    world = CameraSimulator(CameraSettings(**SMALL))
    shear = np.array([[1.0, SHEAR_PX / 480.0, -SHEAR_PX / 480.0 * TRUE.cy], [0.0, 1.0, 0.0]])
    for name, pose in (('desired', (0.0, 0.0, 0.0)), ('current', START)):
        image = world.capture(Pose.from_start(*pose), 0)
        sheared = cv2.warpAffine(image, shear, (640, 480), flags=cv2.INTER_LANCZOS4)
        assert cv2.imwrite(str(folder / f'{name}.png'), image)
        assert cv2.imwrite(str(folder / f'sheared_{name}.png'), sheared)
    return folder


def inspect(folder: Path, camera: str | Camera, *more: str, kind: str = '') -> tuple[int, dict]:
    if isinstance(camera, Camera):
        camera = yaml.safe_dump(to_document(camera))
    result = folder / 'result.json'
    result.unlink(missing_ok=True)
    (folder / 'camera').write_text(camera)
    images = [str(folder / f'{kind}{name}.png') for name in ('desired', 'current')]
    options = [*images, '--camera', str(folder / 'camera'), '--json', str(result), *more]
    code = main(['inspect', *options])
    return code, json.loads(result.read_text()) if result.exists() else {}


def assert_right(result: dict, tolerance: float) -> None:
    truth = Bearings.from_pose(Pose.from_start(*START))
    assert result['rotation_deg'] == pytest.approx(START[2], abs=tolerance)
    assert result['bearing_current_deg'] == pytest.approx(
        math.degrees(truth.current), abs=tolerance
    )
    assert result['bearing_desired_deg'] == pytest.approx(
        math.degrees(truth.desired), abs=tolerance
    )


def test_skew_is_undone(photographs: Path) -> None:
    skew = SHEAR_PX / 480.0 * TRUE.fy
    sheared = Camera(640, 480, TRUE.fx, TRUE.fy, TRUE.cx, TRUE.cy, skew=skew)
    code, result = inspect(photographs, sheared, kind='sheared_')
    assert code == 0
    assert_right(result, 0.1)


# Those are of a lens that distorts, of 386 px: other rays, by a degree in the corners.
PLAIN = {name: text for name, text in FILES.items() if name in ('Kalibr', 'OpenCV XML')}


@pytest.mark.parametrize('program', few_of([*PLAIN]))
def test_camera_files_are_known_by_what_is_in_them(photographs: Path, program: str) -> None:
    text = PLAIN[program].replace('-0.21', '0.0').replace('0.06', '0.0')
    text = text.replace('-2.1000000000000000e-01 6.0000000000000000e-02', '0. 0.')
    code, result = inspect(photographs, text)
    assert code == 0
    assert_right(result, 0.3)


def test_a_camera_is_named_after_the_file(photographs: Path, capsys) -> None:
    assert inspect(photographs, CAMCHAIN)[0] == 2
    assert 'has the cameras cam0, cam1, cam2, got no name' in capsys.readouterr().err
    images = [str(photographs / f'{name}.png') for name in ('desired', 'current')]
    named = f'{photographs / "camera"}#cam2'
    assert main(['inspect', *images, '--camera', named]) == 2
    assert 'cam2.camera_model must be pinhole' in capsys.readouterr().err


def test_the_size_is_that_of_the_photographs_where_the_file_has_none(
    photographs: Path, tmp_path: Path, capsys
) -> None:
    text = f'K: {TRUE.matrix.tolist()}\n'
    code, result = inspect(photographs, text)
    assert code == 0
    assert_right(result, 0.2)
    half = cv2.resize(cv2.imread(str(photographs / 'current.png')), (320, 240))
    cv2.imwrite(str(tmp_path / 'current.png'), half)
    (tmp_path / 'camera').write_text(text)
    images = [str(photographs / 'desired.png'), str(tmp_path / 'current.png')]
    assert main(['inspect', *images, '--camera', str(tmp_path / 'camera')]) == 2
    assert 'no image size; add image_width and image_height to it' in capsys.readouterr().err


@pytest.mark.parametrize(
    'scale',
    few_of([0.25, 1 / 3, 0.5, 2 / 3, 0.75, 0.8, 1.25, 4 / 3, 1.5, 2, 3, 4], keep=(1, 6, 9)),
)
def test_k_of_another_resolution_is_refused(photographs: Path, scale: float, capsys) -> None:
    code, _ = inspect(photographs, scaled(TRUE, (640, 480), scale, scale))
    assert code == 2
    expected = f'K fits an image of {640 * scale:.0f}x{480 * scale:.0f} px'
    assert expected in capsys.readouterr().err


@pytest.mark.parametrize('scale', [0.5, 2.0])
def test_a_focal_length_that_the_matches_contradict_is_not_trusted(
    photographs: Path, scale: float
) -> None:
    wrong = Camera(640, 480, scale * TRUE.fx, scale * TRUE.fy, TRUE.cx, TRUE.cy)
    code, result = inspect(photographs, wrong)
    assert (code, result['trusted']) == (1, False)
    assert f'a focal length of {scale * 385:.0f} px, and they say' in result['reason']


@pytest.mark.parametrize('scale', few_of([0.9, 1.1]))
def test_a_k_that_is_a_tenth_off_is_not_trusted(photographs: Path, scale: float) -> None:
    code, result = inspect(photographs, scaled(TRUE, (640, 480), scale, scale), '--cropped')
    assert (code, result['trusted']) == (1, False)


@pytest.mark.parametrize('scale', few_of([1.25, 1.4, 2.0]))
def test_a_tilt_that_a_wrong_k_makes_is_doubted_though_it_were_a_crop(
    photographs: Path, scale: float
) -> None:
    code, result = inspect(photographs, scaled(TRUE, (640, 480), scale, scale), '--cropped')
    assert (code, result['trusted']) == (1, False)
    assert 'is what a level camera seems to have where K is of another image' in result['reason']


def test_a_crop_is_right_where_it_is_told(photographs: Path, tmp_path: Path, capsys) -> None:
    for name in ('desired', 'current'):
        image = cv2.imread(str(photographs / f'{name}.png'))[:, 200:]
        cv2.imwrite(str(tmp_path / f'{name}.png'), image)
    crop = Camera(440, 480, TRUE.fx, TRUE.fy, TRUE.cx - 200.0, TRUE.cy)
    assert inspect(tmp_path, crop)[0] == 2
    assert 'say that the image is a crop (cropped)' in capsys.readouterr().err
    code, result = inspect(tmp_path, crop, '--cropped')
    assert code == 0
    assert_right(result, 0.3)
