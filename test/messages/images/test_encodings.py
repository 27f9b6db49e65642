"""What cameras send: every encoding gives the grey levels of the scene."""

import cv2
import numpy as np
import pytest
from sensor_msgs.msg import CompressedImage, Image
from tagged_pictures import huge, KINDS, tagged, TAGS, tiff

from visual_servo_epipolar.messages import read
from visual_servo_epipolar.messages.encodings import BRIGHT, DARK, ENCODINGS, GrayReader
from visual_servo_epipolar.messages.pictures import is_upside_down, LARGEST, LARGEST_FILE

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
@pytest.mark.parametrize('encoding', ['bgr8', 'rgb8', 'bgra8', 'rgba8'])
def test_colours_have_the_same_grey_whatever_their_order(encoding, padding) -> None:
    order = encoding[:-1]
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
    ('encoding', 'offset'), [('yuv422', 1), ('uyvy', 1), ('yuv422_yuy2', 0), ('yuyv', 0)]
)
def test_the_luminance_is_the_grey(encoding, offset) -> None:
    shades = np.arange(48, dtype=np.uint8).reshape(6, 8)
    pixels = np.full((6, 8, 2), 128, np.uint8)
    pixels[..., offset] = shades
    np.testing.assert_array_equal(read.gray(message(pixels, encoding)), shades)


PLANAR = [name for name, kind in ENCODINGS.items() if kind.chroma]


@pytest.mark.parametrize('padding', [0, 5])
@pytest.mark.parametrize('encoding', PLANAR)
def test_the_grey_is_the_plane_above_those_of_the_colours(encoding, padding) -> None:
    shades = np.arange(48, dtype=np.uint8).reshape(6, 8, 1)
    raw = message(shades, encoding, padding=padding)
    np.testing.assert_array_equal(read.gray(raw), shades[..., 0])
    raw.data.frombytes(b'page')  # buffers of drivers end at a page
    np.testing.assert_array_equal(read.gray(raw), shades[..., 0])


@pytest.mark.parametrize('encoding', PLANAR)
def test_colours_may_be_counted_into_the_rows(encoding) -> None:
    shades = np.arange(48, dtype=np.uint8).reshape(6, 8, 1)
    raw = message(shades, encoding)
    raw.step = len(raw.data) // 6
    np.testing.assert_array_equal(read.gray(raw), shades[..., 0])


@pytest.mark.parametrize('encoding', ['mono8', 'bgr8', 'yuyv'])
def test_other_images_that_are_called_planar_are_refused(encoding) -> None:
    kind = ENCODINGS[encoding]
    raw = message(np.zeros((6, 8, kind.channels), np.uint8), encoding)
    raw.encoding = 'nv21'
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


@pytest.mark.parametrize('bits', [10, 12, 14, 16])
@pytest.mark.parametrize('encoding', ['mono16', '16UC1', 'bayer_rggb16'])
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
def test_a_mosaic_compressed_without_loss_is_the_raw_one(pattern, bits, suffix, target) -> None:
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
