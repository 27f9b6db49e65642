"""A message that cannot be used is one clear ValueError."""

from diagnostic_msgs.msg import DiagnosticArray
import numpy as np
import pytest

from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.geometry.motion import Pose, STANDSTILL
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.messages import read, write

NAN = float('nan')


def image():
    return write.image(np.zeros((4, 6), np.uint8), 'mono8', 0, 'camera')


def info():
    return write.camera_info(Camera(640, 480, 400.0, 400.0, 320.0, 240.0), 0, 'camera')


def tracks():
    value = Features(
        ids=[1, 2], current=np.ones((2, 2)), desired=np.ones((2, 2)), ages=[1, 1], errors=[0, 0]
    )
    return write.features(value, 0, 'camera')


def test_a_truncated_image_is_refused() -> None:
    message = image()
    message.data.pop()
    with pytest.raises(ValueError, match='4 rows of 6 bytes.* got 23 bytes.* truncated'):
        read.gray(message)


def test_a_row_shorter_than_its_pixels_is_refused() -> None:
    message = image()
    message.encoding = 'bgr8'
    with pytest.raises(ValueError, match='at least 18 each'):
        read.gray(message)


@pytest.mark.parametrize('encoding', ['', '32FC1', 'bayer_rggb', 'nv99'])
def test_an_encoding_that_is_not_known_is_refused(encoding) -> None:
    message = image()
    message.encoding = encoding
    with pytest.raises(ValueError, match=f'one of mono8, .* got {encoding!r}'):
        read.gray(message)


@pytest.mark.parametrize('side', ['width', 'height'])
def test_an_empty_image_is_refused(side) -> None:
    message = image()
    setattr(message, side, 0)
    with pytest.raises(ValueError, match='image is empty'):
        read.gray(message)


@pytest.mark.parametrize(
    ('index', 'value', 'reason'),
    [
        (0, 0.0, 'K\\[0\\] = 0 means an uncalibrated camera'),
        (0, -400.0, 'focal lengths must be positive'),
        (0, NAN, 'intrinsics must be finite'),
        (2, float('inf'), 'intrinsics must be finite'),
        (1, 200.0, 'the skew must be small, got K\\[1\\] = 200 px'),
        *((index, NAN, 'intrinsics must be finite') for index in range(9)),
        *((index, 0.5, r'the rows of K must be \(fx, s, cx\)') for index in (3, 6, 7)),
        (8, 0.0, r'the rows of K must be \(fx, s, cx\)'),
    ],
)
def test_a_matrix_that_no_camera_has_is_refused(index, value, reason) -> None:
    message = info()
    message.k[index] = value
    with pytest.raises(ValueError, match=reason):
        read.camera(message)


def test_an_empty_camera_info_is_refused() -> None:
    message = info()
    message.width = 0
    with pytest.raises(ValueError, match='image size must be positive'):
        read.camera(message)


@pytest.mark.parametrize(('model', 'd'), [('omni', [0.1] * 4), ('plumb_bob', [0.1] * 3)])
def test_a_distortion_that_is_not_known_is_refused(model, d) -> None:
    message = info()
    message.distortion_model, message.d = model, d
    with pytest.raises(ValueError, match=f'{model!r} with {len(d)}; rectify'):
        read.camera(message)


@pytest.mark.parametrize('name', read.TRACK_FIELDS)
def test_tracks_without_a_field_are_refused(name) -> None:
    message = tracks()
    message.fields = [field for field in message.fields if field.name != name]
    with pytest.raises(ValueError, match=f'missing {name};'):
        read.features(message)


def test_a_cloud_of_something_else_is_refused() -> None:
    message = tracks()
    message.fields = []
    with pytest.raises(ValueError, match='connect the tracks of a tracker_node'):
        read.features(message)


def test_truncated_tracks_are_refused() -> None:
    message = tracks()
    message.data.pop()
    with pytest.raises(ValueError, match='2 rows of 60 bytes, got 119 bytes'):
        read.features(message)


@pytest.mark.parametrize('datatype', [0, 9, 255])
def test_tracks_of_no_known_datatype_are_refused(datatype) -> None:
    message = tracks()
    message.fields[1].datatype = datatype
    with pytest.raises(ValueError, match='unknown datatype: u;'):
        read.features(message)


@pytest.mark.parametrize('change', ['offset', 'point_step'])
def test_rows_too_short_for_their_fields_are_refused(change) -> None:
    message = tracks()
    if change == 'offset':
        message.fields[1].offset = 53
    else:
        message.point_step = 0
    with pytest.raises(ValueError):
        read.features(message)


def test_tracks_at_no_place_are_refused() -> None:
    value = Features(ids=[1], current=[[1, 2]], desired=[[1, 2]], ages=[0], errors=[0])
    message = write.features(value, 0, 'camera')
    rows = np.frombuffer(message.data, write.TRACK_LAYOUT)
    rows['u'] = NAN
    with pytest.raises(ValueError, match='current must be finite, got 1 rows'):
        read.features(message)


@pytest.mark.parametrize('value', [NAN, float('inf'), -float('inf')])
@pytest.mark.parametrize('stamped', [False, True])
def test_a_twist_that_is_not_finite_is_refused(value, stamped) -> None:
    message = write.twist_stamped(STANDSTILL, 0, 'base') if stamped else write.twist(STANDSTILL)
    (message.twist if stamped else message).angular.z = value
    with pytest.raises(ValueError, match='a twist must be finite'):
        read.twist(message)


@pytest.mark.parametrize(
    ('x', 'w', 'words'),
    [
        (NAN, 1.0, 'a pose must be finite'),
        (0.0, NAN, 'must be a quaternion of length 1, got length nan'),
        (0.0, 0.0, 'must be a quaternion of length 1, got length 0'),
    ],
)
def test_a_pose_that_is_none_is_refused(x: float, w: float, words: str) -> None:
    message = write.odometry(Pose(1, 2, 0), STANDSTILL, 0, 'world', 'base')
    message.pose.pose.position.x, message.pose.pose.orientation.w = x, w
    with pytest.raises(ValueError, match=words):
        read.pose(message)


def test_diagnostics_without_a_status_are_refused() -> None:
    with pytest.raises(ValueError, match='must have a status'):
        read.diagnosis(DiagnosticArray())


def test_more_names_than_numbers_are_refused() -> None:
    message = write.telemetry({'a': 1.0}, 0, '')
    message.name = ['a', 'b']
    with pytest.raises(ValueError):
        read.telemetry(message)
