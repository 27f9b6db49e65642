"""What cameras send: every encoding gives the grey levels of the scene."""

import cv2
import numpy as np
import pytest
from sensor_msgs.msg import CompressedImage, Image

from visual_servo_epipolar.messages import read
from visual_servo_epipolar.messages.encodings import (
    BRIGHT,
    DARK,
    ENCODINGS,
    GrayReader,
)
from visual_servo_epipolar.messages.pictures import LARGEST

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
    below = int(len(pixels) * getattr(ENCODINGS.get(encoding), 'chroma', 0.0))
    raw.data.frombytes(bytes(range(200, 200 + 5)) * (below * padded.shape[1] // 5 + 1))
    del raw.data[(len(pixels) + below) * padded.shape[1] :]
    return raw


def of_one_colour(order: str) -> np.ndarray:
    return np.full((6, 8, len(order)), [SHADE[name] for name in order], np.uint8)


@pytest.mark.parametrize('padding', [0, 5])
@pytest.mark.parametrize('encoding', ['bgr8', 'rgb8', 'bgra8', 'rgba8', '8UC3', '8UC4'])
def test_colours_have_the_same_grey_whatever_their_order(encoding, padding) -> None:
    order = {'8UC3': 'bgr', '8UC4': 'bgra'}.get(encoding, encoding[:-1])
    gray = read.gray(message(of_one_colour(order), encoding, padding=padding))
    np.testing.assert_array_equal(gray, np.full((6, 8), GRAY))


@pytest.mark.parametrize('bits', [8, 16])
@pytest.mark.parametrize('pattern', ['rggb', 'bggr', 'gbrg', 'grbg'])
def test_a_mosaic_has_the_grey_of_its_colour(pattern, bits) -> None:
    mosaic = np.empty((6, 8, 1), np.uint8)
    for number, name in enumerate(pattern):
        mosaic[number // 2 :: 2, number % 2 :: 2] = SHADE[name]
    if bits == 16:
        mosaic = (mosaic.astype('<u2') << 8).view(np.uint8)
    gray = read.gray(message(mosaic, f'bayer_{pattern}{bits}'))
    np.testing.assert_array_equal(gray, np.full((6, 8), MOSAIC_GRAY))


@pytest.mark.parametrize('pattern', ['rggb', 'bggr', 'gbrg', 'grbg'])
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


@pytest.mark.parametrize('big', [False, True])
@pytest.mark.parametrize('encoding', ['mono16', '16UC1'])
def test_of_16_bits_the_upper_half_counts(encoding, big) -> None:
    values = np.arange(48, dtype=np.uint16).reshape(6, 8, 1) * 1000
    raw = message(values.astype('>u2' if big else '<u2').view(np.uint8), encoding, padding=3)
    raw.is_bigendian = int(big)
    np.testing.assert_array_equal(read.gray(raw), values[..., 0] // 256)


@pytest.mark.parametrize(
    ('encoding', 'offset'),
    [('yuv422', 1), ('uyvy', 1), ('yuv422_yuy2', 0), ('yuyv', 0), ('yuy2', 0)],
)
def test_the_luminance_is_the_grey(encoding, offset) -> None:
    shades = np.arange(48, dtype=np.uint8).reshape(6, 8)
    pixels = np.full((6, 8, 2), 128, np.uint8)
    pixels[..., offset] = shades
    np.testing.assert_array_equal(read.gray(message(pixels, encoding)), shades)


PLANAR = [name for name, kind in ENCODINGS.items() if kind.chroma]


@pytest.mark.parametrize('padding', [0, 5])
@pytest.mark.parametrize('encoding', [*PLANAR, 'YUV420', 'NV12'])
def test_the_grey_is_the_plane_above_those_of_the_colours(encoding, padding) -> None:
    shades = np.arange(48, dtype=np.uint8).reshape(6, 8, 1)
    raw = message(shades, encoding.lower(), padding=padding)
    raw.encoding = encoding
    np.testing.assert_array_equal(read.gray(raw), shades[..., 0])
    raw.data.frombytes(b'page')  # buffers of drivers end at a page
    np.testing.assert_array_equal(read.gray(raw), shades[..., 0])


@pytest.mark.parametrize('encoding', PLANAR)
def test_colours_may_be_counted_into_the_rows(encoding) -> None:
    shades = np.arange(48, dtype=np.uint8).reshape(6, 8, 1)
    raw = message(shades, encoding)
    raw.step = len(raw.data) // 6
    np.testing.assert_array_equal(read.gray(raw), shades[..., 0])


@pytest.mark.parametrize(
    ('code', 'encoding'),
    [
        (cv2.COLOR_BGR2YUV_I420, 'yuv420'),
        (cv2.COLOR_BGR2YUV_YV12, 'yv12'),
    ],
)
def test_planes_are_those_that_opencv_writes(code, encoding) -> None:
    rng = np.random.default_rng(0)
    scene = cv2.GaussianBlur(rng.integers(0, 256, (48, 64, 3), dtype=np.uint8), None, 3.0)
    planes = cv2.cvtColor(scene, code)
    raw = Image(encoding=encoding, height=48, width=64, step=64)
    raw.data.frombytes(planes.tobytes())
    gray = cv2.cvtColor(scene, cv2.COLOR_BGR2GRAY).astype(float)
    luminance = (read.gray(raw).astype(float) - 16.0) * 255.0 / 219.0  # video levels
    assert np.abs(luminance - gray).max() <= 2.0


@pytest.mark.parametrize('encoding', ['mono8', 'bgr8', 'yuyv'])
def test_other_images_that_are_called_planar_are_refused(encoding) -> None:
    kind = ENCODINGS[encoding]
    raw = message(np.zeros((6, 8, kind.channels), np.uint8), encoding)
    raw.encoding = 'nv12'
    with pytest.raises(ValueError, match='bytes of colours, got .* truncated or mislabelled'):
        read.gray(raw)


@pytest.mark.parametrize('encoding', list(ENCODINGS))
def test_an_image_cut_short_is_refused_in_every_encoding(encoding) -> None:
    kind = ENCODINGS[encoding]
    raw = message(np.zeros((6, 8, kind.channels * kind.depth), np.uint8), encoding)
    raw.data.pop()
    with pytest.raises(ValueError, match='image data must hold 6 rows'):
        read.gray(raw)


def compressed(suffix: str, image: np.ndarray) -> CompressedImage:
    raw = CompressedImage(format=f'bgr8; {suffix[1:]} compressed bgr8')
    raw.data.frombytes(cv2.imencode(suffix, image)[1].tobytes())
    return raw


def test_png_is_exact_and_jpeg_nearly() -> None:
    image = cv2.GaussianBlur(
        np.random.default_rng(0).integers(0, 256, (40, 60), dtype=np.uint8), None, 3.0
    )
    np.testing.assert_array_equal(read.gray(compressed('.png', image)), image)
    gray = read.gray(compressed('.jpg', image))
    assert np.abs(gray.astype(int) - image).max() <= 4


def test_colour_is_compressed_to_the_same_grey() -> None:
    gray = read.gray(compressed('.png', of_one_colour('bgr')))
    np.testing.assert_array_equal(gray, np.full((6, 8), GRAY))


@pytest.mark.parametrize(
    'data', [b'', b'\xff\xd8', b'not an image', b'\x89PNG\r\n\x1a\n' + b'0' * 5]
)
def test_what_is_no_picture_is_refused(data) -> None:
    raw = CompressedImage(format='jpeg')
    raw.data.frombytes(data)
    reason = rf"a compressed image \('jpeg'\) must be a complete .*, got {len(data)} bytes"
    with pytest.raises(ValueError, match=reason):
        read.gray(raw)


@pytest.mark.parametrize('suffix', ['.png', '.jpg', '.tiff', '.webp'])
def test_a_picture_cut_short_is_refused(suffix) -> None:
    whole = compressed(suffix, np.random.default_rng(0).integers(0, 256, (40, 60), dtype=np.uint8))
    for length in range(0, len(whole.data) - 8, 7):
        with pytest.raises(ValueError, match='a compressed image'):
            read.gray(CompressedImage(format=whole.format, data=whole.data[:length]))


def test_a_huge_picture_is_refused_before_it_takes_memory() -> None:
    raw = compressed('.png', np.zeros((4, 4), np.uint8))
    raw.data[16:24] = type(raw.data)('B', (60_000).to_bytes(4, 'big') * 2)
    with pytest.raises(ValueError, match=f'1 to {LARGEST} pixels, got 60000x60000'):
        read.gray(raw)


@pytest.mark.parametrize('bits', [10, 12, 14, 16])
@pytest.mark.parametrize('encoding', ['mono16', '16UC1', 'bayer_rggb16', 'bgr16'])
def test_a_sensor_of_fewer_bits_is_as_bright_as_one_of_8(encoding, bits) -> None:
    channels = ENCODINGS[encoding].channels
    grays = np.repeat(np.full((6, 8, 1), 250, np.uint8), channels, axis=2)
    pixels = (grays.astype('<u2') << (bits - 8)).view(np.uint8)
    raw = message(pixels.reshape(6, 8, 2 * channels), encoding)
    np.testing.assert_array_equal(read.gray(raw), np.full((6, 8), 250))


def grays_of(reader: GrayReader, brightest: int) -> int:
    """Return the grey level of an image of 16 bits that is as bright everywhere."""
    pixels = np.full((6, 8, 1), brightest, '<u2').view(np.uint8)
    return int(read.gray(message(pixels, 'mono16'), reader)[0, 0])


def reader_that_has_refused(times: int, brightest: int, reason: str) -> GrayReader:
    """Return a reader of 10 bits that has refused brighter images so many times in a row."""
    reader = GrayReader()
    assert grays_of(reader, 1000) == 250
    for _ in range(times):
        with pytest.raises(ValueError, match=reason):
            grays_of(reader, brightest)
    return reader


def test_a_dark_image_of_a_sensor_keeps_its_range_and_is_not_taken_for_one_of_fewer_bits() -> None:
    reader = GrayReader()
    for brightest, shade in ((4000, 250), (1500, 93), (100, 100), (50, 50), (3000, 187)):
        assert grays_of(reader, brightest) == shade


def test_a_lamp_in_the_dark_does_not_take_the_range_of_the_rest() -> None:
    reader, pixels = GrayReader(), np.arange(100, 130, dtype='<u2')[:, None].repeat(40, axis=1)
    pixels[:4, :8] = 4095
    image = read.gray(message(pixels[:, :, None].view(np.uint8), 'mono16'), reader)
    assert (image[0, 0], image[-1, -1]) == (255, 129)
    assert len(np.unique(image[4:])) == 26


def test_a_damaged_image_does_not_make_those_after_it_dark() -> None:
    reason = 'grey levels of 16 bits, earlier ones 10; it is'
    reader = reader_that_has_refused(BRIGHT - 1, 65_000, reason)
    assert grays_of(reader, 1000) == 250
    with pytest.raises(ValueError, match='grey levels of 16 bits'):
        grays_of(reader, 65_000)


def test_a_sensor_that_is_set_to_more_bits_is_believed_after_a_few_images() -> None:
    reader = reader_that_has_refused(BRIGHT - 1, 4000, 'grey levels of 12 bits')
    assert [grays_of(reader, value) for value in (4000, 1500)] == [250, 93]


def test_a_sensor_whose_images_stay_dark_has_fewer_bits() -> None:
    """The first image may have been the damaged one."""
    reader = GrayReader()
    assert grays_of(reader, 65_000) == 253
    assert {grays_of(reader, 1000) for _ in range(DARK)} == {250}
    with pytest.raises(ValueError, match='grey levels of 16 bits, earlier ones 10'):
        grays_of(reader, 65_000)


@pytest.mark.parametrize('encoding', list(ENCODINGS))
def test_images_of_a_row_a_column_or_a_pixel_are_grey_or_refused(encoding) -> None:
    kind = ENCODINGS[encoding]
    for shape in ((1, 1), (1, 9), (9, 1), (2, 2), (3, 1), (1, 2)):
        raw = message(np.full((*shape, kind.channels * kind.depth), 9, np.uint8), encoding)
        try:
            assert read.gray(raw).shape == shape
        except ValueError as error:
            assert 'cannot be converted to grey' in str(error)


PATTERNS = ['rggb', 'bggr', 'gbrg', 'grbg']


def mosaic_of(pattern: str, bits: int) -> np.ndarray:
    """Return the mosaic of a coloured scene with edges, of which every pixel counts."""
    scene = np.random.default_rng(2).integers(0, 256, (24, 32, 3), dtype=np.uint8)
    scene[:, 16:] //= 3
    mosaic = np.empty((24, 32), np.uint16)
    for number, name in enumerate(pattern):
        rows, columns = slice(number // 2, None, 2), slice(number % 2, None, 2)
        mosaic[rows, columns] = scene[rows, columns, 'rgb'.index(name)]
    return mosaic.astype(np.uint8) if bits == 8 else mosaic << 4  # 12 bits of 16


@pytest.mark.parametrize('target', ['', ' ', '{encoding}'])
@pytest.mark.parametrize('suffix', ['.png', '.tiff'])
@pytest.mark.parametrize('bits', [8, 16])
@pytest.mark.parametrize('pattern', PATTERNS)
def test_a_mosaic_compressed_without_loss_is_that_which_is_sent_raw(
    pattern, bits, suffix, target
) -> None:
    mosaic, encoding = mosaic_of(pattern, bits), f'bayer_{pattern}{bits}'
    sent = message(mosaic.view(np.uint8).reshape(24, 32, bits // 8), encoding)
    raw = compressed(suffix, mosaic)
    raw.format = f'{encoding}; {suffix[1:]} compressed {target.format(encoding=encoding)}'
    np.testing.assert_array_equal(read.gray(raw), read.gray(sent))


@pytest.mark.parametrize('suffix', ['.png', '.tiff'])
@pytest.mark.parametrize('target', ['bgr8', 'mono8'])
def test_a_mosaic_that_was_made_colours_or_grey_is_left_as_it_is(suffix, target) -> None:
    image = np.random.default_rng(0).integers(0, 256, (24, 32), dtype=np.uint8)
    raw = compressed(suffix, image if target == 'mono8' else np.dstack([image] * 3))
    raw.format = f'bayer_rggb8; {suffix[1:]} compressed {target}'
    np.testing.assert_array_equal(read.gray(raw), image)


def test_a_mosaic_in_a_jpeg_is_interpolated() -> None:
    mosaic = np.empty((48, 64), np.uint8)
    for number, name in enumerate('grbg'):
        mosaic[number // 2 :: 2, number % 2 :: 2] = SHADE[name]
    raw = compressed('.jpg', mosaic)
    raw.format = 'bayer_grbg8; jpeg compressed '
    assert np.abs(read.gray(raw)[4:-4, 4:-4].astype(int) - MOSAIC_GRAY).max() <= 4
    raw.format = 'bayer_grbg8; jpeg compressed bgr8'  # it was made of colours
    assert np.ptp(read.gray(raw)[4:-4, 4:-4].astype(int)) > 100


@pytest.mark.parametrize('bits', [8, 10, 12, 14, 16])
@pytest.mark.parametrize('suffix', ['.png', '.tiff'])
def test_a_picture_of_16_bits_is_as_bright_as_one_of_8(suffix, bits) -> None:
    values = np.full((6, 8), 250 << (bits - 8), np.uint16)
    np.testing.assert_array_equal(read.gray(compressed(suffix, values)), np.full((6, 8), 250))


@pytest.mark.parametrize('suffix', ['.png', '.jpg', '.tiff', '.webp'])
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
