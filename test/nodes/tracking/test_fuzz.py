"""Whatever comes on a subscription of the tracker: it lives, says one line, and stays small."""

from array import array

import cv2
import fuzzing
import numpy as np
import pytest
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from visual_servo_epipolar.messages import read, write
from visual_servo_epipolar.messages.encodings import ENCODINGS
from visual_servo_epipolar.nodes.startup import complaints
from visual_servo_epipolar.nodes.tracker_node import TrackerNode

LONGEST = 500  # letters of a line
SIZES = (0, 1, 2, 3, 16, 240, 320, 65_536, 2**31, 2**32 - 1)
NUMBERS = (0.0, 1.0, -1.0, 192.0, 1e-300, 1e300, np.inf, -np.inf, np.nan, 160.0)
LENSES = ('', 'plumb_bob', 'rational_polynomial', 'equidistant', 'fisheye', 'thin_prism', 'ä' * 99)


def stamped(message, rng):
    message.header.stamp.sec = int(rng.choice([-(2**31), -1, 0, 5, 2**31 - 1]))
    message.header.stamp.nanosec = int(rng.choice([0, 7, 10**9 - 1, 2**32 - 1]))
    message.header.frame_id = str(rng.choice(['', 'camera', 'x' * 999]))
    return message


def data(rng, length) -> array:
    made = array('B')
    made.frombytes(rng.integers(0, 256, int(length), dtype=np.uint8).tobytes())
    return made


def image(rng, view):
    if rng.random() < 0.05:
        return stamped(write.image(view, 'mono8', 0, ''), rng)
    message = stamped(Image(), rng)
    message.encoding = str(rng.choice([*ENCODINGS, '', 'nv21', '32FC1', 'x' * 999, 'MONO8']))
    message.height, message.width, message.step = (int(rng.choice(SIZES)) for _ in range(3))
    message.is_bigendian = int(rng.integers(0, 256))
    honest = message.height * message.step
    length = honest if honest < 100_000 and rng.random() < 0.7 else rng.integers(0, 500)
    message.data = data(rng, length)
    return message


def compressed(rng, view):
    message = stamped(CompressedImage(), rng)
    words = ['jpeg', '', 'mono8; jpeg compressed ', 'bayer_rggb8; jpeg compressed ', 'ä' * 99]
    message.format = str(rng.choice(words))
    suffix = '.png' if rng.random() < 0.3 else '.jpg'
    shape = (240, 320) if rng.random() < 0.03 else tuple(rng.integers(1, 18, 2))
    pixels = view if shape == (240, 320) else rng.integers(0, 256, shape).astype(np.uint8)
    message.data.frombytes(cv2.imencode(suffix, pixels)[1].tobytes())
    for _ in range(rng.integers(0, 4)):
        message.data[int(rng.integers(0, len(message.data)))] = int(rng.integers(0, 256))
    if rng.random() < 0.3:
        del message.data[int(rng.integers(0, len(message.data))) :]
    return message


def camera_info(rng, view):
    message = stamped(CameraInfo(), rng)
    message.width, message.height = (int(rng.choice(SIZES)) for _ in range(2))
    message.distortion_model = str(rng.choice(LENSES))
    message.d = rng.choice(NUMBERS, int(rng.choice([0, 4, 5, 8, 12, 14, 3, 99]))).tolist()
    message.k, message.p = rng.choice(NUMBERS, 9), rng.choice(NUMBERS, 12)
    message.binning_x, message.binning_y = (int(rng.choice(SIZES)) for _ in range(2))
    roi = message.roi
    roi.x_offset, roi.y_offset, roi.width, roi.height = (int(rng.choice(SIZES)) for _ in range(4))
    if rng.random() < 0.5:  # nearly right
        message.width, message.height, message.k = (
            320,
            240,
            np.array([192.0, 0, 160, 0, 192, 120, 0, 0, 1]),
        )
    return message


@pytest.mark.parametrize(
    ('topic', 'made', 'transport'),
    [
        ('/image_raw', image, 'raw'),
        ('/image_raw/compressed', compressed, 'compressed'),
        ('/desired/image_raw', image, 'raw'),
        ('/desired/image_raw/compressed', compressed, 'compressed'),
        ('/camera_info', camera_info, 'raw'),
    ],
)
def test_random_messages_are_survived(
    bench, simulator, photograph, view, monkeypatch, topic, made, transport
) -> None:
    said, clouds = [], []
    monkeypatch.setattr(complaints.Complaints, '__call__', lambda self, text: said.append(text))
    node = bench.start(TrackerNode, transport=transport, camera_reliability='best_effort')
    (publisher,) = (it for it in node.publishers if it.topic_name == '/tracks')
    monkeypatch.setattr(publisher, 'publish', clouds.append)
    callbacks = {item.topic_name: item.callback for item in node.subscriptions}
    suffix = '' if transport == 'raw' else '/compressed'
    kind = png if suffix else mono8

    def run(number: int) -> float:
        """Send messages between good ones, and return how much memory is in use then."""
        rng = np.random.default_rng(0)
        callbacks['/camera_info'](write.camera_info(simulator.camera, 0, 'camera'))
        callbacks[f'/desired/image_raw{suffix}'](kind(photograph))
        for _ in range(number):
            callbacks[topic](made(rng, view))
        callbacks['/camera_info'](write.camera_info(simulator.camera, 0, 'camera'))
        callbacks[f'/desired/image_raw{suffix}'](kind(photograph))
        for _ in range(12):
            callbacks[f'/image_raw{suffix}'](kind(view))
        assert len(read.features(clouds[-1])) >= 40  # nothing is lost
        clouds.clear()
        return fuzzing.resident_mb()

    first = run(fuzzing.COUNT // 2)
    assert (
        run(fuzzing.COUNT // 2) - first < fuzzing.GROWTH_MB
    )  # the same ones: what is kept is a leak
    assert not [text for text in said if '\n' in text or len(text) > LONGEST]


def mono8(pixels) -> Image:
    return write.image(pixels, 'mono8', 0, '')


def png(pixels) -> CompressedImage:
    message = CompressedImage(format='mono8; png compressed ')
    message.data.frombytes(cv2.imencode('.png', pixels)[1].tobytes())
    return message
