"""Two photographs on the command line: a clear answer whatever they show, by any camera file."""

import math
from pathlib import Path
import re

from calibration_files import CAMCHAIN
from command_line import refusal
import cv2
from durations import few_of
from inspected import assert_right, CAMERA, inspect, kept, SMALL
import numpy as np
import pytest
import small_cameras
import yaml

from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.cameras.registry import scaled
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.messages.camera_file import to_document
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.cameras import CameraSettings

START = (0.8, -3.0, 10.0)
SAME_PLACE = r'taken from the same place: a parallax of 0\.\d\d px is too small for epipoles'


@pytest.fixture(scope='module')
def photographs(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp('photographs')
    world = CameraSimulator(CameraSettings(**SMALL))
    elsewhere = CameraSimulator(CameraSettings(**SMALL, scene='wall', scene_seed=9))
    hand = CameraSimulator(CameraSettings(**SMALL, tilt=0.07, roll=0.05))
    current = world.capture(Pose.from_start(*START), 0)
    images = {
        'desired': world.photograph(),
        'current': current,
        'turned': world.capture(Pose.from_start(0.0, 0.0, 8.0), 1),
        'elsewhere': elsewhere.photograph(),
        'hand': hand.capture(Pose.from_start(*START), 0),
        'tilted': hand.capture(Pose.from_start(0.0, 0.0, 5.0), 1),
        'stepped': world.capture(Pose.from_start(0.0, -0.05, 3.0), 1),
        'half': cv2.resize(current, (320, 240), interpolation=cv2.INTER_AREA),
        'cropped': current[:300],
        'blank': np.full((480, 640), 90, np.uint8),
    }
    (folder / 'text.png').write_text('not a picture')
    return kept(folder, images)


@pytest.mark.parametrize(('current', 'tolerance'), [('current', 0.2), ('half', 0.8)])
def test_the_bearings_are_those_of_the_true_poses(photographs, current, tolerance) -> None:
    code, result = inspect(photographs, current)
    assert (code, result['trusted']) == (0, True)
    # 0.1 px of 385 px are 0.015 deg; a baseline of 3 m makes ten times that of it. Of an image
    # halved it is 0.2 px of 192: 0.3 deg, of which two and a half may be.
    assert_right(result, START, tolerance)
    assert result['sigma'] == -1
    assert result['inliers'] > 40


def test_the_attitude_of_the_camera_is_estimated(tmp_path: Path, capsys) -> None:
    tilt, roll = 12.0, -5.0
    angles = {'tilt': math.radians(tilt), 'roll': math.radians(roll)}
    world = CameraSimulator(CameraSettings(**SMALL, **angles))
    leaning = world.capture(Pose.from_start(*START), 0)
    kept(tmp_path, {'desired': world.photograph(), 'leaning': leaning})
    code, result = inspect(tmp_path, 'leaning')
    assert (code, result['trusted'], result['planar']) == (0, True, True)
    assert result['tilt_deg'] == pytest.approx(tilt, abs=1.0)
    assert result['roll_deg'] == pytest.approx(roll, abs=2.0)
    assert 'deg (down positive) and rolled by -' in capsys.readouterr().out
    truth = Bearings.from_pose(Pose.from_start(*START))
    assert result['bearing_current_deg'] == pytest.approx(math.degrees(truth.current), abs=1.0)


@pytest.mark.parametrize(
    ('current', 'rotation', 'tolerance'), [('desired', 0.0, 1e-6), ('turned', 8.0, 0.02)]
)
def test_from_the_same_place_the_rotation_is_reported_without_epipoles(
    photographs, capsys, current, rotation, tolerance
) -> None:
    code, result = inspect(photographs, current)
    assert (code, result['trusted'], result['epipole_current_px']) == (1, False, None)
    assert re.fullmatch(SAME_PLACE, result['reason'])
    assert result['rotation_deg'] == pytest.approx(rotation, abs=tolerance)
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == f'NOT trusted: {result["reason"]}'
    assert re.fullmatch(r'\d+ matches, parallax 0.0 px', lines[1])
    assert re.fullmatch(rf'heading [+-]{rotation:.2f} deg \(left positive\)', lines[2])


NEARLY = 'taken from nearly the same place, or of what is far away:'


@pytest.mark.parametrize(
    ('current', 'rotation', 'words'),
    [
        ('tilted', 5.0, SAME_PLACE),
        ('stepped', 3.0, NEARLY),  # a small step
        ('elsewhere', None, '.'),
        ('blank', None, '.'),
    ],
)
def test_a_pair_without_epipoles_is_not_trusted(photographs, current, rotation, words) -> None:
    code, result = inspect(photographs, current)
    assert (code, result['trusted']) == (1, False)
    assert re.match(words, result['reason'])
    if rotation is not None:
        assert result['rotation_deg'] == pytest.approx(rotation, abs=0.2)


def test_a_hand_held_pair_falls_back_to_the_general_geometry(photographs: Path, capsys) -> None:
    """Level axes come by the mount of the camera, where that is given."""
    truth = math.degrees(Bearings.from_pose(Pose.from_start(*START)).desired)
    for frame, options in (
        ('camera', ()),
        ('ground', ('--tilt', '2', '--mount-deviation', '2')),
    ):
        code, result = inspect(photographs, 'hand', *options)
        assert (code, result['planar'], result['frame']) == (0, False, frame)
        assert 'general epipolar geometry' in result['reason']
        assert result['bearing_desired_deg'] == pytest.approx(truth, abs=0.5)
        shown = capsys.readouterr().out
        assert ('in axes of the cameras, not level' in shown) == (frame == 'camera')


SQUARE = small_cameras.sized(600, 600, 384.6, 299.5, 299.5)


@pytest.fixture(scope='module', params=[0.0, 20.0], ids=['level', 'leaning'])
def square_pair(request) -> tuple[np.ndarray, np.ndarray]:
    world = CameraSimulator(CameraSettings(**SQUARE, tilt=math.radians(request.param)))
    return world.photograph(), world.capture(Pose.from_start(*START), 0)


def turned(image: np.ndarray, angle: float) -> np.ndarray:
    """Return a square image turned counterclockwise by ``angle`` [deg]."""
    height, width = image.shape
    matrix = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), angle, 1.0)
    return cv2.warpAffine(image, matrix, (width, height))


def inspect_square(folder: Path, desired: np.ndarray, current: np.ndarray) -> tuple[int, dict]:
    cv2.imwrite(str(folder / 'desired.png'), desired)
    cv2.imwrite(str(folder / 'current.png'), current)
    camera = CAMERA.replace('640', '600').replace('480', '600')
    (folder / 'camera.yaml').write_text(camera.replace('327', '299.5').replace('233', '299.5'))
    return inspect(folder, 'current')


@pytest.mark.parametrize('angle', few_of([-135, -45, 30, 90, 180], keep=(0, 2)))
def test_a_photograph_rolled_against_the_other_is_refused(tmp_path, square_pair, angle) -> None:
    desired, current = square_pair
    code, result = inspect_square(tmp_path, desired, turned(current, angle))
    assert code == 1
    assert not result['trusted']
    named = re.match(
        r'the current photograph is rolled by (\d+) deg (counter)?clockwise', result['reason']
    )
    assert named, result['reason']
    assert int(named[1]) == pytest.approx(abs(angle), abs=4)  # a turn of a leaning camera, too
    assert abs(angle) == 180 or bool(named[2]) == (angle > 0)


@pytest.mark.parametrize('angle', few_of([-90, 30, 45]))
def test_two_photographs_rolled_alike_are_refused(tmp_path: Path, square_pair, angle: int) -> None:
    code, result = inspect_square(tmp_path, *(turned(image, angle) for image in square_pair))
    assert code == 1
    assert not result['trusted']
    named = re.search(r'rolled by (-?\d+) deg', result['reason'])
    assert named, result['reason']
    assert abs(int(named[1])) == pytest.approx(abs(angle), abs=6)


def test_a_mount_that_is_no_angle_is_bad_input(photographs: Path, capsys) -> None:
    for text, reason in (('91', 'not an angle from -90 to 90 deg'), ('nan', 'not finite')):
        with pytest.raises(SystemExit):
            inspect(photographs, 'current', '--tilt', text)
        assert reason in capsys.readouterr().err


@pytest.mark.parametrize(
    ('current', 'words'),
    [
        ('text', 'must be a picture of 8 bits'),
        ('cropped', 'aspect ratio'),
        ('missing', 'cannot be read'),
    ],
)
def test_what_is_of_no_such_camera_is_bad_input(photographs, capsys, current, words) -> None:
    code, _ = inspect(photographs, current)
    errors = capsys.readouterr().err
    assert code == 2
    assert words in errors
    assert errors.count('\n') == 1


UPRIGHT = CAMERA.replace('width: 640', 'width: 480').replace('height: 480', 'height: 640')


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        (UPRIGHT.replace('327, 0, 384.6, 233', '233, 0, 384.6, 327'), 'with the pixels as stored'),
        ('image_width: 640', 'lacks'),
        ('a: [', 'not YAML'),
        (CAMERA.replace('384.6', '0.0'), 'focal lengths must be positive'),
    ],
)
def test_a_bad_camera_file_is_bad_input(photographs, tmp_path, capsys, text, words) -> None:
    (tmp_path / 'camera.yaml').write_text(text)
    images = [str(photographs / f'{name}.png') for name in ('desired', 'current')]
    assert words in refusal(capsys, 'inspect', *images, '--camera', str(tmp_path / 'camera.yaml'))


def test_the_overlay_is_a_picture(photographs: Path) -> None:
    overlay = photographs / 'new' / 'overlay.png'
    inspect(photographs, 'current', '--out', str(overlay))
    assert cv2.imread(str(overlay)).shape == (480, 640, 3)
    assert [path.name for path in overlay.parent.iterdir()] == ['overlay.png']


TRUE = CameraSettings(**SMALL).camera


def inspected_by(camera: str | Camera, photographs: Path, folder: Path, *more: str):
    """Inspect photographs by a camera file that is written into ``folder``."""
    if isinstance(camera, Camera):
        camera = yaml.safe_dump(to_document(camera))
    (folder / 'camera.yaml').write_text(camera)
    return inspect(photographs, 'current', '--camera', str(folder / 'camera.yaml'), *more)


def test_a_camera_is_named_after_the_file(photographs, tmp_path, capsys) -> None:
    assert inspected_by(CAMCHAIN, photographs, tmp_path)[0] == 2
    assert 'has the cameras cam0, cam1, cam2, got no name' in capsys.readouterr().err
    assert inspect(photographs, 'current', '--camera', f'{tmp_path}/camera.yaml#cam2')[0] == 2
    assert 'cam2.camera_model must be pinhole' in capsys.readouterr().err


@pytest.mark.parametrize('scale', [0.5, 2.0])
def test_a_focal_length_that_the_matches_contradict_is_not_trusted(
    photographs, tmp_path, scale
) -> None:
    wrong = Camera(640, 480, scale * TRUE.fx, scale * TRUE.fy, TRUE.cx, TRUE.cy)
    code, result = inspected_by(wrong, photographs, tmp_path)
    assert (code, result['trusted']) == (1, False)
    assert f'a focal length of {scale * TRUE.fx:.0f} px, and they say' in result['reason']


TILTED = 'is what a level camera seems to have where K is of another image'


@pytest.mark.parametrize(
    ('scale', 'words'),
    few_of([(0.9, ''), (1.1, '')]) + few_of([(1.25, TILTED), (1.4, TILTED), (2.0, TILTED)]),
)
def test_a_k_that_is_off_is_not_trusted_though_it_were_a_crop(
    photographs, tmp_path, scale, words
) -> None:
    off = scaled(TRUE, (640, 480), scale, scale)
    code, result = inspected_by(off, photographs, tmp_path, '--cropped')
    assert (code, result['trusted']) == (1, False)
    assert words in result['reason']


def test_a_crop_is_right_with_cropped(photographs: Path, tmp_path: Path, capsys) -> None:
    for name in ('desired', 'current'):
        image = cv2.imread(str(photographs / f'{name}.png'))[:, 200:]
        cv2.imwrite(str(tmp_path / f'{name}.png'), image)
    crop = Camera(440, 480, TRUE.fx, TRUE.fy, TRUE.cx - 200.0, TRUE.cy)
    assert inspected_by(crop, tmp_path, tmp_path)[0] == 2
    assert 'say that the image is a crop (cropped)' in capsys.readouterr().err
    code, result = inspected_by(crop, tmp_path, tmp_path, '--cropped')
    assert code == 0
    assert_right(result, START, 0.3)


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
    for name, pose in (('desired', (0.0, 0.0, 0.0)), ('current', START)):
        images[f'raw_{name}'] = image = world.capture(Pose.from_start(*pose), 0)
        rectified = cv2.remap(image, maps[..., 0], maps[..., 1], cv2.INTER_LANCZOS4)
        images[f'rectified_{name}'] = rectified
    return kept(tmp_path_factory.mktemp('fisheye'), images, FILE)


@pytest.mark.parametrize('kind', ['raw', 'rectified'])
def test_the_bearings_by_a_fisheye_are_those_of_the_true_poses(wide, kind) -> None:
    overlay = wide / f'{kind}_overlay.png'
    options = ['--out', str(overlay), *(['--rectified'] if kind == 'rectified' else [])]
    code, told = inspect(wide, f'{kind}_current', *options, desired=f'{kind}_desired')
    assert code == 0
    assert_right(told, START, 0.4)
    bearing, focal = math.radians(told['bearing_current_deg']), FISHEYE['focal_length']
    abscissa = 400.0 * math.tan(bearing) if kind == 'rectified' else focal * bearing
    assert told['epipole_current_px'] == pytest.approx(abscissa, abs=0.1)
    assert overlay.stat().st_size > 10_000
