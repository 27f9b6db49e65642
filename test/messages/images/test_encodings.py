"""What cameras send: every encoding gives the grey levels of the scene."""

import cv2
import numpy as np
import pytest
from sensor_msgs.msg import CompressedImage, Image
from tagged_pictures import huge, tagged, TAGS

from visual_servo_epipolar.messages import read
from visual_servo_epipolar.messages.encodings import ENCODINGS, LARGEST, picture

BLUE, GREEN, RED = 30, 90, 200
GRAY = round(0.114 * BLUE + 0.587 * GREEN + 0.299 * RED)
MOSAIC_GRAY = (BLUE + 2 * GREEN + RED + 2) // 4
SHADE = {'b': BLUE, 'g': GREEN, 'r': RED, 'a': 255}


def message(pixels: np.ndarray, encoding: str, *, padding: int = 0) -> Image:
    """Return ``pixels``, shape (H, W, bytes of a pixel), with padded rows."""
    rows = pixels.reshape(len(pixels), -1)
    padded = np.pad(rows, ((0, 0), (0, padding)), constant_values=77)
    raw = Image(encoding=encoding, height=len(pixels), width=pixels.shape[1])
    raw.step = padded.shape[1]
    raw.data.frombytes(padded.tobytes())
    below = len(pixels) // 2 * getattr(ENCODINGS.get(encoding), 'planar', False)
    raw.data.frombytes(bytes(range(200, 200 + 5)) * (below * padded.shape[1] // 5 + 1))
    del raw.data[(len(pixels) + below) * padded.shape[1] :]
    return raw


def of_one_colour(order: str) -> np.ndarray:
    return np.full((6, 8, len(order)), [SHADE[name] for name in order], np.uint8)


@pytest.mark.parametrize('padding', [0, 5])
@pytest.mark.parametrize('encoding', ['bgr8', 'rgb8', 'bgra8', 'rgba8'])
def test_colours_have_the_same_grey_whatever_their_order(encoding, padding) -> None:
    order = encoding[:-1]
    gray = read.gray(message(of_one_colour(order), encoding, padding=padding))
    np.testing.assert_array_equal(gray, np.full((6, 8), GRAY))


PATTERNS = ['rggb', 'bggr', 'gbrg', 'grbg']


@pytest.mark.parametrize('pattern', PATTERNS)
def test_a_mosaic_has_the_grey_of_its_colour(pattern) -> None:
    mosaic = np.empty((6, 8, 1), np.uint8)
    for number, name in enumerate(pattern):
        mosaic[number // 2 :: 2, number % 2 :: 2] = SHADE[name]
    gray = read.gray(message(mosaic, f'bayer_{pattern}8'))
    np.testing.assert_array_equal(gray, np.full((6, 8), MOSAIC_GRAY))


@pytest.mark.parametrize('pattern', PATTERNS)
def test_a_mosaic_moves_no_edge_and_has_no_pattern_in_grey(pattern) -> None:
    """Of a grey scene each site is filtered alike, so that a shifted scene is a shifted image."""
    scene = np.random.default_rng(0).integers(0, 256, (32, 40, 1), dtype=np.uint8)
    gray = read.gray(message(scene, f'bayer_{pattern}8')).astype(int)
    shifted = read.gray(message(scene[1:, 1:], f'bayer_{pattern}8')).astype(int)
    np.testing.assert_array_equal(gray[2:-1, 2:-1], shifted[1:-1, 1:-1])
    dot = np.zeros((9, 9, 1), np.uint8)
    dot[4, 4] = 160
    spread = read.gray(message(dot, f'bayer_{pattern}8')).astype(int)
    np.testing.assert_array_equal(spread, spread[::-1, ::-1])
    assert spread[4, 4] == spread.max()


@pytest.mark.parametrize(
    ('encoding', 'offset'), [('yuv422', 1), ('uyvy', 1), ('yuv422_yuy2', 0), ('yuyv', 0)]
)
def test_the_luminance_is_the_grey(encoding, offset) -> None:
    shades = np.arange(48, dtype=np.uint8).reshape(6, 8)
    pixels = np.full((6, 8, 2), 128, np.uint8)
    pixels[..., offset] = shades
    np.testing.assert_array_equal(read.gray(message(pixels, encoding)), shades)


PLANAR = [name for name, kind in ENCODINGS.items() if kind.planar]


@pytest.mark.parametrize('padding', [0, 5])
@pytest.mark.parametrize('encoding', PLANAR)
def test_the_grey_is_the_plane_above_those_of_the_colours(encoding, padding) -> None:
    shades = np.arange(48, dtype=np.uint8).reshape(6, 8, 1)
    raw = message(shades, encoding, padding=padding)
    np.testing.assert_array_equal(read.gray(raw), shades[..., 0])
    raw.data.frombytes(b'page')  # buffers of drivers end at a page
    np.testing.assert_array_equal(read.gray(raw), shades[..., 0])
    if not padding:
        counted = message(shades, encoding)
        counted.step = len(counted.data) // 6  # colours may be counted into the rows
        np.testing.assert_array_equal(read.gray(counted), shades[..., 0])


def compressed(suffix: str, image: np.ndarray) -> CompressedImage:
    raw = CompressedImage(format=f'bgr8; {suffix[1:]} compressed bgr8')
    raw.data.frombytes(cv2.imencode(suffix, image)[1].tobytes())
    return raw


@pytest.mark.parametrize('encoding', list(ENCODINGS))
def test_images_of_a_row_a_column_or_a_pixel_are_grey_or_refused(encoding) -> None:
    kind = ENCODINGS[encoding]
    for shape in ((1, 1), (1, 9), (9, 1), (2, 2), (3, 1), (1, 2)):
        raw = message(np.full((*shape, kind.channels), 9, np.uint8), encoding)
        cut = message(np.full((*shape, kind.channels), 9, np.uint8), encoding)
        cut.data.pop()
        with pytest.raises(ValueError, match=f'image data must hold {shape[0]} rows'):
            read.gray(cut)
        try:
            assert read.gray(raw).shape == shape
        except ValueError as error:
            assert 'cannot be converted to grey' in str(error)


@pytest.mark.parametrize('target', ['', ' ', '{encoding}', 'mono8', 'bgr8'])
@pytest.mark.parametrize('pattern', PATTERNS)
def test_a_mosaic_compressed_without_loss_is_the_raw_one_or_what_it_was_made(
    pattern, target
) -> None:
    mosaic = np.random.default_rng(2).integers(0, 256, (24, 32), dtype=np.uint8)
    encoding = f'bayer_{pattern}8'
    raw = compressed('.png', np.dstack([mosaic] * 3) if target == 'bgr8' else mosaic)
    raw.format = f'{encoding}; png compressed {target.format(encoding=encoding)}'
    plain = 'mono8' if '8' in target and '{' not in target else encoding
    np.testing.assert_array_equal(read.gray(raw), read.gray(message(mosaic[..., None], plain)))


def test_a_mosaic_in_a_jpeg_is_interpolated() -> None:
    mosaic = np.empty((48, 64), np.uint8)
    for number, name in enumerate('grbg'):
        mosaic[number // 2 :: 2, number % 2 :: 2] = SHADE[name]
    raw = compressed('.jpg', mosaic)
    raw.format = 'bayer_grbg8; jpeg compressed '
    assert np.abs(read.gray(raw)[4:-4, 4:-4].astype(int) - MOSAIC_GRAY).max() <= 4
    raw.format = 'bayer_grbg8; jpeg compressed bgr8'  # it was made of colours
    assert np.ptp(read.gray(raw)[4:-4, 4:-4].astype(int)) > 100


@pytest.mark.parametrize('suffix', ['.png', '.jpg'])
def test_damage_of_a_picture_is_an_image_or_one_line(suffix) -> None:
    rng = np.random.default_rng(1)
    whole = compressed(suffix, rng.integers(0, 256, (40, 60), dtype=np.uint8))
    for _ in range(200):
        raw = CompressedImage(format=whole.format, data=whole.data[:])
        for place in rng.integers(0, len(raw.data), 4):
            raw.data[int(place)] = int(rng.integers(0, 256))
        try:
            assert read.gray(raw).dtype == np.uint8
        except ValueError as error:
            assert '\n' not in str(error)


IMAGE = cv2.GaussianBlur(
    np.random.default_rng(0).integers(0, 256, (24, 40), dtype=np.uint8), None, 2.0
)
KINDS = ('jpeg', 'png')
ROUNDING = 3  # grey levels of a fine JPEG


def live(data: bytes) -> np.ndarray:
    return read.gray(CompressedImage(format='jpeg', data=data))


def of_file(data: bytes) -> np.ndarray:
    return picture(data, 'goal.png')


def test_colour_is_compressed_to_the_same_grey() -> None:
    gray = read.gray(compressed('.png', of_one_colour('bgr')))
    np.testing.assert_array_equal(gray, np.full((6, 8), GRAY))


PNG_16 = cv2.imencode('.png', IMAGE.astype(np.uint16) << 4)[1].tobytes()
NO_BITS = 'must be a picture of 8 bits, got uint16; give a JPEG'
NO_PICTURE = r"a compressed image \('jpeg'\) must be a complete .*, got {} bytes"
ANSWERED = [
    *(
        (live, it, NO_PICTURE.format(len(it)))
        for it in (b'', b'\xff\xd8', b'not an image', b'\x89PNG\r\n\x1a\n' + b'0' * 5)
    ),
    *((live, huge(it, 60_000), f'1 to {LARGEST} pixels, got 60000x60000') for it in KINDS),
    *((reader, PNG_16, NO_BITS) for reader in (live, of_file)),
    *(
        (of_file, tagged(IMAGE, 'jpeg', it), r'goal.png has an orientation tag, .*; store them up')
        for it in TAGS[1:]
    ),
    *(
        (of_file, start + 8 * b'a', 'goal.png')
        for start in (b'II*\0', b'\x89PNG\r\n\x1a\n', b'P5 40000 40000 255\n')
    ),
]


@pytest.mark.parametrize(('reader', 'data', 'words'), ANSWERED)
def test_what_cannot_be_used_is_answered_in_a_line_and_nothing_is_printed(
    reader, data, words, capfd
) -> None:
    with pytest.raises(ValueError, match=words):
        reader(data)
    assert capfd.readouterr() == ('', '')


READERS = pytest.mark.parametrize('reader', [live, of_file])


@READERS
@pytest.mark.parametrize('kind', KINDS)
def test_pixels_are_as_they_are_stored(kind, reader) -> None:
    gray = reader(tagged(IMAGE, kind, 1))
    assert np.abs(gray.astype(int) - IMAGE).max() <= (ROUNDING if kind == 'jpeg' else 0)


@READERS
@pytest.mark.parametrize('kind', KINDS)
def test_a_picture_cut_short_is_one_line(kind, reader) -> None:
    whole = tagged(IMAGE, kind, 1)
    for length in range(0, len(whole) - 8, 37):
        try:
            assert reader(whole[:length]).shape == IMAGE.shape and reader is of_file
        except ValueError as error:
            assert '\n' not in str(error)


@READERS
def test_what_follows_a_jpeg_does_no_harm(reader) -> None:
    """Phones put films and other pictures behind it."""
    whole = tagged(IMAGE, 'jpeg', 1)
    np.testing.assert_array_equal(reader(whole + b'film' * 99), reader(whole))


def test_the_end_of_a_thumbnail_is_not_that_of_the_picture() -> None:
    whole = tagged(IMAGE, 'jpeg', 1)
    thumbnail = b'\xff\xe1' + (2 + len(whole)).to_bytes(2, 'big') + whole
    carrying = whole[:2] + thumbnail + whole[2:]
    np.testing.assert_array_equal(live(carrying), live(whole))
    with pytest.raises(ValueError, match='must be a complete JPEG'):
        live(carrying[: len(carrying) - len(whole) // 4])


@pytest.mark.parametrize('suffix', ['.bmp', '.pgm', '.webp', '.tiff'])
def test_a_file_of_another_kind_is_read_where_opencv_does(suffix) -> None:
    lossless = [cv2.IMWRITE_WEBP_QUALITY, 101] if suffix == '.webp' else []
    data = cv2.imencode(suffix, IMAGE, lossless)[1].tobytes()
    np.testing.assert_array_equal(of_file(data), IMAGE)
