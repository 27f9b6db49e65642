"""Malformed calibrations: one line that names the key and what was expected, whatever is there."""

import json
import re

from calibration_files import CAMCHAIN, COLMAP, ECHO, EUROC, FILES, OST_TXT, OST_YAML, TRANSFORMS
from hypothesis import example, given, settings
from hypothesis import strategies as st
import pytest
import yaml

from visual_servo_epipolar.core.cameras.plausibility import refuse_implausible
from visual_servo_epipolar.messages.camera_file import from_text

PYTHONS_WORDS = re.compile(
    r'NoneType|object|subscript|iterable|could not convert|invalid literal|not supported|'
    r'Traceback|unhashable|has no attribute|argument must|Errno|codec|dict|tuple|\bNone\b|\bTrue\b'
)
# What stands in place of a whole number, a number, a list of them, and a name.
NO_NUMBERS = [None, True, 'wide', '', [], [1.0], {}, {'a': 1}, 1e300, 10**400, float('nan')]
NO_NUMBERS += [float('inf'), '1e999', '.nan', '2026-13-45']
NO_LISTS = [None, True, 'three', 7.0, {}, {'data': None}, {'rows': 3}, [1.0] * 7, [[1.0] * 2] * 3]
NO_LISTS += [[[1.0], [1.0, 2.0]], [['a'] * 3] * 3, [None] * 9, [True] * 9, [1e300] * 9]
NO_LISTS += [[10**400] * 9, [float('nan')] * 9, [[[1.0] * 3] * 3] * 3, ['x'] * 12, [{}] * 9]
NO_NAMES = [None, True, 7, 0.5, [], ['plumb_bob'], {}]
RECTIFYING = {'projection_matrix', 'p'}
KINDS = {
    'image_width': NO_NUMBERS,
    'image_height': NO_NUMBERS,
    'width': NO_NUMBERS,
    'height': NO_NUMBERS,
    'binning_x': [*NO_NUMBERS, -1, 1.5],
    'camera_matrix': NO_LISTS,
    'k': NO_LISTS,
    'projection_matrix': NO_LISTS,
    'p': NO_LISTS,
    'distortion_coefficients': [each for each in NO_LISTS if each != [1.0] * 7],
    'd': [each for each in NO_LISTS if each != [1.0] * 7],
    'distortion_model': NO_NAMES,
    'intrinsics': NO_LISTS,
    'resolution': NO_LISTS,
    'camera_model': NO_NAMES,
    'roi': [None, True, 'all', 7, [0, 0, 640, 480]],
}
CASES = [
    (name, key, value)
    for name, text in (
        ('ost.yaml', OST_YAML),
        ('echo', ECHO),
        ('EuRoC', EUROC),
    )
    for key in KINDS
    if re.search(rf'^\s*"?{key}"?:', text, re.MULTILINE)
    for value in KINDS[key]
]
TEXTS = {'ost.yaml': OST_YAML, 'echo': ECHO, 'EuRoC': EUROC}


def refusal(text: str, **kind) -> str:
    with pytest.raises(ValueError) as caught:
        from_text(text, **kind)
    message = str(caught.value)
    assert '\n' not in message
    assert not PYTHONS_WORDS.search(message), message
    return message


def changed(name: str, key: str, value) -> str:
    document = next(yaml.safe_load_all(TEXTS[name]))
    document[key] = value
    return json.dumps(document)  # which has NaN and whole numbers of any size


@pytest.mark.parametrize(('name', 'key', 'value'), CASES)
def test_a_malformed_field_names_its_key_and_what_was_expected(name, key, value) -> None:
    message = refusal(changed(name, key, value), rectified=key in RECTIFYING)
    assert re.match(rf'{key} must (be|have) ', message), message


@pytest.mark.parametrize('key', ['cam0.intrinsics', 'cam0.distortion_coeffs', 'cam0.resolution'])
def test_of_a_camchain_the_camera_is_named_as_well(key) -> None:
    document = yaml.safe_load(CAMCHAIN)
    document['cam0'][key.split('.')[1]] = None
    assert refusal(yaml.safe_dump(document), name='cam0').startswith(f'{key} must be a list of')


@pytest.mark.parametrize(
    ('old', 'new', 'key'),
    [
        ('640\n', 'wide\n', 'image_width'),
        ('0.000000 386.500000 238.750000\n', '', 'camera_matrix'),
        ('385.250000', 'nan', 'camera_matrix'),
        ('-0.210000', '1e40', 'distortion_coefficients'),
    ],
)
def test_of_an_ost_txt_the_key_is_named(old, new, key) -> None:
    assert refusal(OST_TXT.replace(old, new)).startswith(f'{key} must be')


@pytest.mark.parametrize('key', ['image_width', 'image_height', 'camera_matrix'])
def test_a_key_that_is_missing_is_named(key) -> None:
    document = yaml.safe_load(OST_YAML)
    del document[key]
    assert f"lacks '{key}'" in refusal(yaml.safe_dump(document))


@pytest.mark.parametrize('key', ['distortion_coefficents', 'distortion_coeff', 'distortions'])
def test_a_slip_in_the_name_does_not_leave_the_distortion_out(key) -> None:
    assert f'{key} is not a key' in refusal(OST_YAML.replace('distortion_coefficients', key))


@pytest.mark.parametrize('name', FILES)
@given(data=st.data())
def test_no_damage_to_a_file_ends_in_pythons_words(name, data) -> None:
    text = FILES[name]
    place = data.draw(st.integers(0, len(text) - 1))
    length = data.draw(st.integers(0, 40))
    inserted = data.draw(
        st.sampled_from(['', '-', 'x', '[', '{', '\n', '\x00', '!!', '&a', '*a', '"'])
    )
    damaged = text[:place] + inserted + text[place + length :]
    try:
        refuse_implausible(from_text(damaged))
    except ValueError as error:
        assert '\n' not in str(error)
        assert not PYTHONS_WORDS.search(str(error)), str(error)


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


def test_whoever_has_another_format_gets_the_list() -> None:
    for text in ('', 'hello', '[]', '{"a": 1}', 'Camera.fx: 458.6\nCamera.fy: 457.3\n'):
        message = refusal(text)
        for program in ('camera_calibration', 'OpenCV', 'Kalibr', 'echo'):
            assert program in message


@pytest.mark.parametrize(('program', 'text'), [('COLMAP', COLMAP), ('nerfstudio', TRANSFORMS)])
def test_files_with_another_first_pixel_are_named_with_the_way_to_convert_them(
    program, text
) -> None:
    message = refusal(text)
    assert f'is of {program}, which is not read; write it as YAML' in message
    assert 'cx - 0.5' in message


def test_coefficients_called_k1_and_k2_are_no_camera_matrices() -> None:
    with pytest.raises(ValueError, match="^camera file lacks 'camera_matrix'"):
        from_text('width: 640\nheight: 480\nk1: 0\nk2: 0.1\n')
