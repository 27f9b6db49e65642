"""Pictures of every kind: as they are stored, whole, upright, of a size that can be."""

import cv2
import numpy as np
import pytest
from sensor_msgs.msg import CompressedImage
from tagged_pictures import huge, KINDS, tagged, TAGS, tiff

from visual_servo_epipolar.messages import read
from visual_servo_epipolar.messages.encodings import GrayReader
from visual_servo_epipolar.messages.pictures import (
    is_upside_down,
    LARGEST,
    LARGEST_FILE,
)

IMAGE = cv2.GaussianBlur(
    np.random.default_rng(0).integers(0, 256, (24, 40), dtype=np.uint8), None, 2.0
)
ROUNDING = 3  # grey levels of a fine JPEG


def live(data: bytes) -> np.ndarray:
    return read.gray(CompressedImage(format='jpeg', data=data))


def of_file(data: bytes) -> np.ndarray:
    return GrayReader().picture(data, 'goal.png')


READERS = pytest.mark.parametrize('reader', [live, of_file])


@READERS
@pytest.mark.parametrize('kind', KINDS)
def test_pixels_are_as_they_are_stored(kind, reader) -> None:
    gray = reader(tagged(IMAGE, kind, 1))
    assert np.abs(gray.astype(int) - IMAGE).max() <= (ROUNDING if kind == 'jpeg' else 0)


@READERS
@pytest.mark.parametrize('tag', TAGS[1:])
@pytest.mark.parametrize('kind', KINDS)
def test_a_picture_whose_tag_turns_it_is_refused_by_name(kind, tag, reader) -> None:
    with pytest.raises(ValueError, match=f"('jpeg'|goal.png).* has the orientation tag {tag}"):
        reader(tagged(IMAGE, kind, tag))


@pytest.mark.parametrize('kind', KINDS)
def test_one_upside_down_is_turned_for_who_turns_k(kind) -> None:
    data = tagged(IMAGE[::-1, ::-1], kind, 3)
    assert is_upside_down(data) and not is_upside_down(tagged(IMAGE, kind, 1))
    gray = GrayReader().picture(data, 'goal.png', turn=True)
    assert np.abs(gray.astype(int) - IMAGE).max() <= (ROUNDING if kind == 'jpeg' else 0)
    with pytest.raises(ValueError, match='goal.png has the orientation tag 6'):
        GrayReader().picture(tagged(IMAGE, kind, 6), 'goal.png', turn=True)


@pytest.mark.parametrize('tag', [0, 9, 999])
def test_a_tag_that_tells_nothing_is_none(tag) -> None:
    assert np.array_equal(of_file(tagged(IMAGE, 'png', tag)), IMAGE)


@pytest.mark.parametrize('order', ['<', '>'])
@pytest.mark.parametrize('bits', [10, 12, 16])
def test_those_of_16_bits_are_as_bright_as_of_8(bits, order) -> None:
    deep = IMAGE.astype(np.uint16) << (bits - 8)
    deep[0, 0] = 255 << (bits - 8)  # one that is bright tells how many there are
    upright = [reader(tiff(deep, order)) for reader in (live, of_file)]
    turned = GrayReader().picture(tiff(deep, order, tag=3), 'goal.png', turn=True)
    for gray in (*upright, turned[::-1, ::-1]):
        np.testing.assert_array_equal(gray.ravel()[1:], IMAGE.ravel()[1:])


@READERS
def test_file_and_message_have_the_same_grey(reader) -> None:
    deep = IMAGE.astype(np.uint16) << 2
    raw = read.gray(CompressedImage(format='16UC1; png compressed ', data=png(deep)))
    np.testing.assert_array_equal(reader(png(deep)), raw)


def png(image: np.ndarray) -> bytes:
    return cv2.imencode('.png', image)[1].tobytes()


@READERS
@pytest.mark.parametrize('kind', KINDS)
def test_a_header_of_too_many_pixels_is_one_line(kind, reader) -> None:
    largest = {live: LARGEST, of_file: LARGEST_FILE}[reader]
    side = 16_384 if kind == 'webp' else 60_000  # its canvas is of 24 bits, OpenCV's of 14
    if kind == 'webp' and reader is of_file:
        side = 2**24 - 1
    with pytest.raises(ValueError, match=f'1 to {largest} pixels, got {side}x{side}') as refusal:
        reader(huge(kind, side))
    assert '\n' not in str(refusal.value)


@pytest.mark.parametrize(
    'data',
    [
        b'P5 40000 40000 255\n' + b'0' * 99,
        b'BM' + b'\0' * 12 + (40).to_bytes(4, 'little') + (40_000).to_bytes(4, 'little') * 2,
    ],
)
def test_a_file_of_another_kind_that_claims_as_many_is_one_line(data) -> None:
    with pytest.raises(ValueError, match='goal.png.* decoded') as refusal:
        of_file(data)
    assert '\n' not in str(refusal.value)


@READERS
@pytest.mark.parametrize('kind', KINDS)
def test_a_picture_cut_short_is_refused(kind, reader) -> None:
    whole = tagged(IMAGE, kind, 3)
    for length in range(0, len(whole) - 8, 37):
        with pytest.raises(ValueError, match=r"'jpeg'|goal\.png") as refusal:
            reader(whole[:length])
        assert '\n' not in str(refusal.value)


@READERS
def test_what_follows_a_jpeg_does_no_harm(reader) -> None:
    """Phones put films and other pictures behind it."""
    whole = tagged(IMAGE, 'jpeg', 1)
    np.testing.assert_array_equal(reader(whole + b'film' * 99), reader(whole))


@READERS
def test_the_end_of_a_thumbnail_is_not_that_of_the_picture(reader) -> None:
    whole = tagged(IMAGE, 'jpeg', 1)
    thumbnail = b'\xff\xe1' + (2 + len(whole)).to_bytes(2, 'big') + whole
    carrying = whole[:2] + thumbnail + whole[2:]
    np.testing.assert_array_equal(reader(carrying), reader(whole))
    with pytest.raises(ValueError, match='must be a complete JPEG'):
        reader(carrying[: len(carrying) - len(whole) // 4])


@READERS
@pytest.mark.parametrize('kind', ['float32', 'int32'])
def test_pixels_of_other_types_are_refused(reader, kind) -> None:
    with pytest.raises(ValueError, match=f'pixels must be uint8 or uint16, got {kind}'):
        reader(tiff(IMAGE.astype(kind)))


@pytest.mark.parametrize('start', [b'II*\0', b'MM\0*', b'II+\0', b'\x89PNG\r\n\x1a\n'])
def test_a_damaged_file_is_refused_and_nothing_is_printed(start, capfd) -> None:
    with pytest.raises(ValueError, match='goal.png'):
        of_file(start + 8 * b'a')
    assert capfd.readouterr() == ('', '')


@pytest.mark.parametrize('suffix', ['.bmp', '.pgm'])
def test_a_file_of_another_kind_is_read_where_opencv_does(suffix) -> None:
    data = cv2.imencode(suffix, IMAGE)[1].tobytes()
    np.testing.assert_array_equal(of_file(data), IMAGE)
