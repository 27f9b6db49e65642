"""Calibrations of other programs: each format gives the camera that was calibrated."""

import json
import re

from calibration_files import (
    CAMCHAIN,
    COLMAP,
    ECHO,
    EUROC,
    FILES,
    FISHEYE,
    OPENCV_XML,
    OPENCV_YAML,
    OST_TXT,
    OST_YAML,
    PINHOLE,
    PLUMB_BOB,
    TRANSFORMS,
)
import cv2
from hypothesis import example, given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import floats
import yaml

from visual_servo_epipolar.core.cameras.equidistant import Equidistant
from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.cameras.plausibility import refuse_implausible
from visual_servo_epipolar.messages.camera_file import from_text, to_document

EXPECTED = Camera(640, 480, *PINHOLE, PLUMB_BOB)
RECTIFIED = Camera(640, 480, 360.5, 361.25, 323.5, 239.5)
BARE = 'Kalibr', 'OpenCV YAML'  # files without a projection
SEEN = np.array([[0.1, -0.2, 1.0], [-0.4, 0.2, 1.0], [0.6, 0.4, 1.0]])


def assert_alike(camera, expected) -> None:
    assert (type(camera), camera.width, camera.height) == (type(expected), 640, 480)
    np.testing.assert_allclose(camera.pixels(SEEN), expected.pixels(SEEN), atol=1e-9)


def refusal(text: str, **kind) -> str:
    with pytest.raises(ValueError) as caught:
        from_text(text, **kind)
    assert '\n' not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize('program', FILES)
def test_the_camera_is_that_of_the_calibration_whatever_people_do_to_text_files(program) -> None:
    text = FILES[program]
    assert_alike(from_text(text), EXPECTED)
    assert_alike(from_text('\ufeff\n' + text.replace('\n', '\r\n') + '\n\n'), EXPECTED)


@pytest.mark.parametrize('program', ['ost.yaml', 'ost.txt', 'ros2 topic echo', 'rostopic echo'])
def test_the_projection_is_that_of_rectified_images(program) -> None:
    assert from_text(FILES[program], rectified=True) == RECTIFIED


def by_columns(text: str) -> str:
    """Return an ost.yaml with its matrix written column by column."""
    text = text.replace('322.25 ', '  0. ').replace('238.75 ', '  0. ')
    return text.replace('0.     ,   0.     ,   1.', '322.25, 238.75, 1.')


LACKS = "lacks 'camera_matrix' of one camera; supported are camera_calibration.*OpenCV.*Kalibr"
CONVERT = 'Of another program, write it as YAML: image_width.*COLMAP and nerfstudio cx - 0.5'
CAMERAS = 'the cameras cam0, cam1, cam2, got'
ANSWERED = [
    *(
        (FILES[it], {'rectified': True}, "lacks 'proj.* which rectified images need")
        for it in BARE
    ),
    (OST_TXT.replace('-0.000300 0.000000', '-0.000300'), {}, r'use ost\.yaml instead of ost\.txt'),
    (re.sub(r'image_(width|height): .*\n', '', OPENCV_YAML), {}, "lacks 'image_width'; add the i"),
    (CAMCHAIN, {}, f'{CAMERAS} no name; choose one, as in FILE#cam0'),
    (CAMCHAIN, {'name': 'cam9'}, f'{CAMERAS} cam9; choose one'),
    (CAMCHAIN, {'name': 'cam2'}, r'cam2\.camera_model must be pinhole, got .omni.: omni'),
    (OST_TXT + OST_TXT.replace('322.25', '321.25'), {}, LACKS),
    (by_columns(OST_YAML), {}, 'K is transposed'),
    (OPENCV_XML.replace('camera_matrix', 'something'), {}, LACKS),
    (OST_TXT.replace('640\n', 'wide\n'), {}, '^image_width must be'),
    (OST_TXT.replace('0.000000 386.500000 238.750000\n', ''), {}, '^camera_matrix must be'),
    (OST_TXT.replace('385.250000', 'nan'), {}, '^camera_matrix must be'),
    (OST_TXT.replace('-0.210000', '1e40'), {}, '^distortion_coefficients must be'),
    *(
        (OST_YAML.replace('distortion_coefficients', it), {}, f'{it} is not a key')
        for it in ('distortion_coefficents', 'dist_coeffs', 'distortions')
    ),
    *(
        (text, {}, LACKS)
        for text in ('', '[]', '{"a": 1}', 'Camera.fx: 458.6\nCamera.fy: 457.3\n')
    ),
    *((it, {}, CONVERT) for it in (COLMAP, TRANSFORMS, 'M1: [1, 0, 0, 0, 1, 0, 0, 0, 1]')),
    ('width: 640\nheight: 480\nk1: 0\nk2: 0.1\n', {}, f'^camera file {LACKS}'),
    *((f'a: {it}', {}, 'camera') for it in ('2020-13-45', '!!timestamp x')),
]


@pytest.mark.parametrize(('text', 'kind', 'words'), ANSWERED)
def test_what_cannot_be_used_is_answered_in_a_line(text, kind, words) -> None:
    assert re.search(words, refusal(text, **kind))


MATRICES = {
    'a list': '[385.25, 0, 322.25, 0, 386.5, 238.75, 0, 0, 1]',
    'rows': '[[385.25, 0, 322.25], [0, 386.5, 238.75], [0, 0, 1]]',
    'rows in data': '{rows: 3, data: [[385.25, 0, 322.25], [0, 386.5, 238.75], [0, 0, 1]]}',
    'data alone': '{data: [385.25, 0, 322.25, 0, 386.5, 238.75, 0, 0, 1]}',
    'text': '385.25 0 322.25 0 386.5 238.75 0 0 1',
    'twice as large': '[770.5, 0, 644.5, 0, 773, 477.5, 0, 0, 2]',
    'exponents': '[3.8525e2, 0, 322.25e0, 0, 386.5, 238.75, 0, 0, 1e0]',
}


@pytest.mark.parametrize('key', ['camera_matrix', 'K', 'k'])
@pytest.mark.parametrize('matrix', MATRICES)
@pytest.mark.parametrize('distortion', ['distortion_coefficients: [[{}]]', 'D: {{data: [{}]}}'])
def test_a_matrix_is_read_as_people_write_it(key, matrix, distortion) -> None:
    coefficients = distortion.format(', '.join(map(str, PLUMB_BOB)))
    size = 'width: 640\nheight: 480' if key == 'K' else 'image_width: 640\nimage_height: 480'
    assert_alike(from_text(f'{size}\n{key}: {MATRICES[matrix]}\n{coefficients}\n'), EXPECTED)


@pytest.mark.parametrize('suffix', ['.yml', '.xml', '.json'])
@given(fx=floats(300.0, 500.0), skew=floats(-5.0, 5.0), d=st.tuples(*[floats(-0.1, 0.1)] * 5))
def test_what_opencv_writes_is_read_to_the_last_digit(suffix, fx, skew, d) -> None:
    flags = cv2.FileStorage_WRITE | cv2.FileStorage_MEMORY
    file = cv2.FileStorage(suffix, flags)
    file.write('image_width', 640)
    file.write('image_height', 480)
    file.write('camera_matrix', np.array([[fx, skew, 320.5], [0.0, 400.0, 240.5], [0, 0, 1.0]]))
    file.write('distortion_coefficients', np.array([d]).T)
    camera = from_text(file.releaseAndGetString())
    assert camera == Camera(640, 480, fx, 400.0, 320.5, 240.5, d, skew=skew)


@pytest.mark.parametrize('lens', ['fisheye_model: 1', 'distortion_model: kannala_brandt4'])
def test_a_fisheye_of_opencv_is_one(lens) -> None:
    four = OPENCV_YAML.replace('rows: 5', 'rows: 4')
    four = four.replace('-3.0000000000000000e-04, 0. ]', '-3e-04 ]')
    expected = Equidistant(640, 480, *PINHOLE, PLUMB_BOB[:4])
    assert_alike(from_text(f'{four}{lens}\n'), expected)
    assert_alike(from_text(f'{four}fisheye_model: 0\n'), EXPECTED)
    assert 'may be those of a pinhole or of a fisheye; add distortion_model' in refusal(four)


def test_which_of_several_cameras_is_asked_for() -> None:
    assert_alike(from_text(CAMCHAIN, name='cam0'), EXPECTED)
    fisheye = Equidistant(640, 480, 190.5, 190.75, 318.25, 241.5, FISHEYE)
    assert from_text(CAMCHAIN, name='cam1') == fisheye


LENSES = (
    EXPECTED,
    Camera(640, 480, *PINHOLE, skew=4.0),
    Camera(
        640, 480, *PINHOLE, (0.4, 0.1, 5e-4, -3e-4, 0.01, 0.7, 0.2, 0.02), 'rational_polynomial'
    ),
    Equidistant(640, 480, *PINHOLE, FISHEYE, skew=-1e-13),
)


@pytest.mark.parametrize('camera', LENSES)
def test_what_is_written_is_read(camera) -> None:
    assert from_text(yaml.safe_dump(to_document(camera))) == camera


def test_binning_and_region_of_a_printed_camera_info_count() -> None:
    camera = from_text(ECHO.replace('binning_x: 0\nbinning_y: 0', 'binning_x: 2\nbinning_y: 2'))
    assert (camera.width, camera.fx) == (320, 192.625)
    camera = from_text(ECHO.replace('x_offset: 0', 'x_offset: 200'))
    assert (camera.width, camera.cx) == (440, 122.25)


@pytest.mark.parametrize('program', FILES)
def test_k_of_another_resolution_is_refused_from_every_file(program) -> None:
    # A file without its size, for images of half the resolution: K tells it.
    text = FILES[program]
    for side in ('640', '480'):
        text = text.replace(side, str(int(side) // 2))
    assert re.search('320x240 px, got .*: K fits an image of 640x480 px', refusal(text))
    assert from_text(text, cropped=True).width == 320


# What stands in place of a whole number, a list of numbers, and a name.
NO_NUMBERS = [None, 'wide', [1.0], {'a': 1}, 10**400, float('nan')]
NO_LISTS = [None, 'three', {'rows': 3}, [[1.0], [1.0, 2.0]], [None] * 9, [float('nan')] * 9]
KINDS = {
    'image_width': NO_NUMBERS,
    'height': NO_NUMBERS,
    'binning_x': [*NO_NUMBERS, -1, 1.5],
    'camera_matrix': [*NO_LISTS, [1.0] * 7],
    'projection_matrix': NO_LISTS,
    'd': NO_LISTS,
    'distortion_model': [None, 7, ['plumb_bob']],
    'intrinsics': [*NO_LISTS, 7.0],
    'resolution': NO_LISTS,
    'roi': [None, 'all', [0, 0, 640, 480]],
}
TEXTS = {'ost.yaml': OST_YAML, 'echo': ECHO, 'EuRoC': EUROC}
CASES = [
    (name, key, value)
    for name, text in TEXTS.items()
    for key in KINDS
    if re.search(rf'^\s*"?{key}"?:', text, re.MULTILINE)
    for value in KINDS[key]
]


@pytest.mark.parametrize(('name', 'key', 'value'), CASES)
def test_a_malformed_field_names_its_key_and_what_was_expected(name, key, value) -> None:
    document = next(yaml.safe_load_all(TEXTS[name]))
    document[key] = value
    message = refusal(json.dumps(document), rectified=key == 'projection_matrix')
    assert re.match(rf'{key} must (be|have) ', message), message


@pytest.mark.parametrize('key', ['cam0.intrinsics', 'cam0.distortion_coeffs', 'cam0.resolution'])
def test_of_a_camchain_the_camera_is_named_as_well(key) -> None:
    document = yaml.safe_load(CAMCHAIN)
    document['cam0'][key.split('.')[1]] = None
    assert refusal(yaml.safe_dump(document), name='cam0').startswith(f'{key} must be a list of')


@pytest.mark.parametrize('name', ['ost.txt', 'OpenCV XML', 'Kalibr'])
@given(data=st.data())
def test_no_damage_to_a_file_is_more_than_a_line(name, data) -> None:
    text = FILES[name]
    place = data.draw(st.integers(0, len(text) - 1))
    length = data.draw(st.integers(0, 40))
    inserted = data.draw(st.sampled_from(['', '-', 'x', '[', '{', '\n', '\x00', '!!', '*a', '"']))
    try:
        refuse_implausible(from_text(text[:place] + inserted + text[place + length :]))
    except ValueError as error:
        assert '\n' not in str(error)


@settings(max_examples=20)
@given(text=st.text(max_size=200))
@example('[' * 100_000)
@example('{' * 100_000)
@example('<a>' * 100_000)
@example('a: &a [*a]')
@example('camera_matrix: &a [*a]')
@example('camera_matrix: 2026-13-45')
@example('1 PINHOLE 640 480')
@example('1 PINHOLE 640 480 1\n2')
def test_what_is_no_camera_file_gets_the_list_or_a_reason(text) -> None:
    refusal(text)
