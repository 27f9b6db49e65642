"""Faults of sensing: images and tracks, calibration and photograph, scenes and light."""

from collections import deque
from collections.abc import Callable
from dataclasses import replace
from itertools import count
from typing import Any

import cv2
import numpy as np
from sensor_msgs.msg import CompressedImage
from std_msgs.msg import Header

from visual_servo_epipolar.core.arrays import Image as Pixels
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.evaluation.faults.fault import (
    always,
    at_first,
    Change,
    changing,
    Fault,
    Faults,
    striking,
    StruckRun,
    world_change,
)
from visual_servo_epipolar.evaluation.live.world import Envelope, HOP_NS, WorldSettings
from visual_servo_epipolar.messages import read, write
from visual_servo_epipolar.messages.write import TRACK_LAYOUT
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings

IMAGES, TRACKS, INFO, DESIRED = '/image_raw', '/tracks', '/camera_info', '/desired/image_raw'
CAMERA = 'camera_node'
SPELL = 0.3, 10.0  # for which nearly all of these last, if not for good [s]


def delay(envelope: Envelope, seconds: float) -> Envelope:
    """Return ``envelope``, later by ``seconds``."""
    return replace(envelope, delay_ns=envelope.delay_ns + round(seconds * NANOSECONDS))


def restamp(message: Any, stamp: Callable[[int], int]) -> None:
    """Let the stamp of a message be what ``stamp`` makes of it [ns]."""
    time = message.header.stamp
    time.sec, time.nanosec = divmod(stamp(read.stamp_ns(message.header)), NANOSECONDS)


@striking
def drop_some(scene: StruckRun, topic: str) -> None:
    """Lose up to half of the messages of ``topic``."""
    share = scene.draw(0.1, 0.5)
    scene.notes.append(f'{share:.0%} of them')
    scene.filter(topic, lambda envelope: [] if scene.hits(share) else [envelope])


@striking
def lost(scene: StruckRun, topic: str, low: float, high: float) -> None:
    """Lose all messages of ``topic``, for a while or for good."""
    scene.lose(topic, scene.spell(low, high))


@striking
def late(scene: StruckRun, topic: str, low: float, high: float) -> None:
    """Delay the messages of ``topic``, each by the same time."""
    seconds = scene.draw(low, high)
    scene.notes.append(f'by {seconds:.2f} s')
    scene.filter(topic, lambda envelope: [delay(envelope, seconds)])


def _gap(scene: StruckRun) -> None:
    seconds = scene.draw(0.3, 8.0)
    scene.notes.append(f'for {seconds:.1f} s')
    scene.lose(IMAGES, seconds)


@striking
def _copies(scene: StruckRun, delays: Callable[[StruckRun], list[float]]) -> None:
    """Let each image come as often, and so much later, as ``delays`` [s]."""
    scene.filter(IMAGES, lambda envelope: [delay(envelope, each) for each in delays(scene)])


@striking
def _restamped(scene: StruckRun, stamp: Callable[[int, StruckRun], int]) -> None:
    scene.alter(IMAGES, lambda message: restamp(message, lambda it: stamp(it, scene)))


OF_1970 = _restamped(lambda now_ns, scene: now_ns % (1_000_000 * NANOSECONDS))
OF_TOMORROW = _restamped(lambda now_ns, scene: now_ns + 86_400 * NANOSECONDS)
OF_CHANCE = _restamped(lambda now_ns, scene: now_ns + round(scene.draw(-2.0, 2.0) * NANOSECONDS))
IMAGE_STREAM: Faults = {
    'images_dropped': Fault('up to half of the images are lost', drop_some(IMAGES)),
    'images_gap': always('no images for 0.3 to 8 s', _gap),
    'images_end': always('no image any more', lambda scene: scene.lose(IMAGES)),
    'images_late': Fault('images 0.1 to 0.5 s late', late(IMAGES, 0.1, 0.5)),
    'images_very_late': Fault('images 1.5 to 4 s late', late(IMAGES, 1.5, 4.0)),
    'images_uneven': Fault(
        'each image 0 to 0.5 s late', _copies(lambda scene: [scene.draw(0.0, 0.5)])
    ),
    'images_out_of_order': Fault(
        'images overtake each other', _copies(lambda scene: [0.2 if scene.hits(0.3) else 0.0])
    ),
    'images_repeated': Fault('each image comes three times', _copies(lambda _: [0.0, 0.02, 0.04])),
    'stamps_1970': Fault('stamps of 1970, in order', OF_1970),
    'stamps_zero': always('stamps of 0', _restamped(lambda stamp_ns, scene: 0)),
    'stamps_future': Fault('stamps of tomorrow', OF_TOMORROW),
    'stamps_random': Fault('stamps 2 s off, in any order', OF_CHANCE),
}


def _rows(change: Callable[[Any, StruckRun], Any]) -> Change:
    """Return what gives tracks the rows that ``change`` makes of theirs."""

    def alter(message: Any, scene: StruckRun) -> None:
        rows = change(np.frombuffer(message.data, TRACK_LAYOUT).copy(), scene)
        message.width, message.row_step = len(rows), len(rows) * message.point_step
        del message.data[:]
        message.data.frombytes(rows.tobytes())

    return alter


def _half_random(rows: Any, scene: StruckRun) -> Any:
    wrong = scene.rng.random(len(rows)) < 0.5
    for name, size in (('u', 320.0), ('v', 256.0)):
        rows[name][wrong] = scene.rng.uniform(0.0, size, np.count_nonzero(wrong))
    return rows


def _half_shifted(rows: Any, scene: StruckRun) -> Any:
    """Let half of the features, always the same, be elsewhere, as those of what moves."""
    rows['u'][rows['id'] % 2 == 0] += 25.0
    return rows


def _nan(rows: Any, scene: StruckRun) -> Any:
    wrong = scene.rng.random(len(rows)) < scene.draw(0.0, 1.0)
    rows['u'][wrong] = np.nan
    rows['v'][scene.rng.random(len(rows)) < 0.1] = np.inf
    return rows


def _one_point(rows: Any, scene: StruckRun) -> Any:
    rows['u'], rows['v'] = 160.0, 128.0
    return rows


def _lie(message: Any, scene: StruckRun) -> None:
    message.width = int(scene.rng.integers(0, 2**31))
    message.point_step = int(scene.rng.integers(0, 200))


def _few(rows: Any, scene: StruckRun) -> Any:
    return rows[: int(scene.rng.integers(1, 12))]


def _tracks(change: Callable[[Any, StruckRun], Any], *, true: bool = True) -> Any:
    return changing(TRACKS, _rows(change), (0.5, 10.0), true=true)


TRACK_STREAM: Faults = {
    'tracks_half_random': Fault('half of the tracks anywhere', _tracks(_half_random)),
    'tracks_half_shifted': Fault('half of the tracks 25 px aside', _tracks(_half_shifted)),
    'tracks_nan': Fault('nan and inf in tracks', _tracks(_nan)),
    'tracks_empty': always('no features', _tracks(lambda rows, _: rows[:0], true=False)),
    'tracks_few': Fault('a few features', _tracks(_few)),
    'tracks_one_point': Fault('all features at one point', _tracks(_one_point, true=False)),
    'tracks_lying': always('clouds whose size lies', changing(TRACKS, _lie, SPELL, true=False)),
    'tracks_dropped': Fault('up to half of the tracks lost', drop_some(TRACKS)),
    'tracks_late': Fault('tracks 0.1 to 0.5 s late', late(TRACKS, 0.1, 0.5)),
}


def _wrong_focal(settings: WorldSettings, rng: np.random.Generator) -> WorldSettings:
    ratio = float(rng.choice((0.8, 0.85, 1.2, 1.25)))
    return replace(settings, camera=replace(settings.camera, believed_focal_ratio=ratio))


def _lens(model: str, *coefficients: float) -> Change:
    def change(info: Any, scene: StruckRun) -> None:
        info.distortion_model, info.d = model, list(coefficients)

    return change


def _longer(info: Any, scene: StruckRun) -> None:
    info.k[0], info.k[4] = 1.3 * info.k[0], 1.3 * info.k[4]


def _transpose(info: Any, scene: StruckRun) -> None:
    info.k = np.asarray(info.k).reshape(3, 3).T.ravel()


def _scale_matrix(scene: StruckRun) -> None:
    """Let K be that of images of another size, or of another lens."""
    ratio = float(scene.rng.choice((0.25, 0.35, 0.5, 0.7, 1.4, 2.0, 2.8, 4.0)))
    whole = scene.hits(0.5)
    scene.notes.append(f'{"K" if whole else "focal length"} times {ratio:g}')

    def scale(info: Any) -> None:
        k = np.array(info.k)
        k[[0, 4, 2, 5] if whole else [0, 4]] *= ratio
        info.k = k

    scene.alter(INFO, scale)


def _focal(value: float) -> Change:
    def change(info: Any, scene: StruckRun) -> None:
        info.k[0] = value

    return change


def _larger(info: Any, scene: StruckRun) -> None:
    info.width, info.height = 2 * info.width, 2 * info.height


def _flicker(info: Any, scene: StruckRun) -> None:
    """Let two cameras speak in turns."""
    if scene.hits(0.5):
        _longer(info, scene)


@striking
def photograph(scene: StruckRun, pixels: Callable[[StruckRun], Pixels]) -> None:
    """Let somebody publish another photograph."""
    message: Any = write.image(pixels(scene), 'mono8', 0, 'camera_optical_frame')
    scene.filter(DESIRED, lambda envelope: [replace(envelope, message=message)])
    scene.world.wire.send(Envelope(DESIRED, message, 2 * HOP_NS))


def _other_room(scene: StruckRun) -> Pixels:
    return taken(replace(scene.world.settings.camera, scene_seed=77), DESIRED_POSE)


def _other_pose(scene: StruckRun) -> Pixels:
    goal, turn = DESIRED_POSE, scene.draw(-0.05, 0.05)
    pose = Pose(goal.x + scene.draw(-0.2, 0.2), goal.y - scene.draw(0.1, 0.3), goal.theta + turn)
    return taken(scene.world.settings.camera, pose)


def _black(scene: StruckRun) -> Pixels:
    camera = scene.world.settings.camera
    return np.zeros((camera.height, camera.width), np.uint8)


def taken(camera: CameraSettings, pose: Pose = DESIRED_POSE) -> Pixels:
    """Return an image as the camera takes it."""
    return CameraSimulator(camera).capture(pose, 0)


BARREL = _lens('plumb_bob', -0.35, 0.12, 0.0, 0.0, 0.0)
FISHEYE = _lens('equidistant', 0.0, 0.0, 0.0, 0.0)
CALIBRATION: Faults = {
    'focal_wrong': at_first('focal length configured 15 to 25 % wrong', prepare=_wrong_focal),
    'lens_wrong': at_first(
        'configured with a distortion that is not there', changing(INFO, BARREL)
    ),
    'lens_fisheye': at_first('configured as a fisheye', changing(INFO, FISHEYE)),
    'matrix_transposed': at_first('K column by column', changing(INFO, _transpose)),
    'matrix_scaled': at_first(
        'K, or its focal length alone, of 1/4 to 4 times the size', _scale_matrix
    ),
    'info_missing': always('no camera_info', lambda scene: scene.lose(INFO)),
    'info_uncalibrated': always('K[0] of camera_info is 0', changing(INFO, _focal(0.0))),
    'info_nan': always('K[0] is nan', changing(INFO, _focal(np.nan))),
    'info_changes': Fault('another focal length in mid-run', changing(INFO, _longer)),
    'info_flickers': always('two cameras in turns', changing(INFO, _flicker)),
    'info_larger': always('camera_info of larger images', changing(INFO, _larger)),
    'photograph_other_room': always('a photograph of another room', photograph(_other_room)),
    'photograph_other_pose': Fault('another photograph in mid-run', photograph(_other_pose)),
    'photograph_black': always('a black photograph', photograph(_black)),
}


PixelChange = Callable[[Pixels, StruckRun], Any]


def _pixels(message: Any) -> Pixels:
    return np.frombuffer(message.data, np.uint8).reshape(message.height, message.width)


def _show(message: Any, data: bytes) -> None:
    del message.data[:]
    message.data.frombytes(data)


def _shown(change: PixelChange) -> Change:
    """Return what gives images the pixels that ``change`` makes of theirs."""

    def alter(message: Any, scene: StruckRun) -> None:
        pixels = np.ascontiguousarray(change(_pixels(message).copy(), scene), np.uint8)
        _show(message, pixels.tobytes())

    return alter


def _seen(change: PixelChange) -> Any:
    """Return the strike that lets other pixels stand for those that were taken."""
    return changing(IMAGES, _shown(change), SPELL, true=False)


def _again(envelope: Envelope, old: Envelope, *, stamps: bool = False) -> list[Envelope]:
    """Return an ``old`` image in place of this one, with a stamp of its own or of this one."""
    message = type(old.message)(header=old.message.header, encoding=old.message.encoding)
    message.height, message.width = old.message.height, old.message.width
    message.step = old.message.step
    _show(message, old.message.data.tobytes())
    if stamps:
        message.header = envelope.message.header
    return [replace(envelope, message=message, sight=old.sight)]


@striking
def _frozen(scene: StruckRun, *, stamps: bool) -> None:
    """Let a camera hang: it repeats an image, with stamps that go on or not."""
    kept: list[Envelope] = []

    def freeze(envelope: Envelope) -> list[Envelope]:
        if not kept:
            kept.append(envelope)
        return _again(envelope, kept[0], stamps=stamps)

    scene.filter(IMAGES, freeze, scene.spell(0.5, 10.0))


def _swap(scene: StruckRun) -> None:
    kept: deque[Envelope] = deque(maxlen=40)

    def swap(envelope: Envelope) -> list[Envelope]:
        kept.append(envelope)
        return _again(envelope, kept[int(scene.rng.integers(len(kept)))], stamps=True)

    scene.filter(IMAGES, swap, scene.spell(0.5, 10.0))


def _loop(scene: StruckRun) -> None:
    """Play the images of the next seconds again and again, as a bag in a loop: old stamps, too."""
    length = int(scene.rng.integers(10, 60))
    bag: list[Envelope] = []
    numbers = count()
    scene.notes.append(f'{length} images long')

    def play(envelope: Envelope) -> list[Envelope]:
        number = next(numbers)
        if number < length:
            bag.append(envelope)
            return [envelope]
        return _again(envelope, bag[number % length])

    scene.filter(IMAGES, play)


@striking
def _remount(scene: StruckRun, change: PixelChange) -> None:
    """Change all images of a camera, the photograph as well."""

    def taken_so(scene: StruckRun) -> Pixels:
        image = taken(scene.world.settings.camera)
        return np.ascontiguousarray(change(image, scene), np.uint8)

    changing(IMAGES, _shown(change))(scene)
    photograph(taken_so)(scene)


def _mirror(image: Pixels, scene: StruckRun) -> Any:
    return image[:, ::-1]


def _upside_down(image: Pixels, scene: StruckRun) -> Any:
    return image[::-1, ::-1]


def _cover(scene: StruckRun) -> None:
    """Cover 0.45 of each side of the images with what moves along: what is left is true."""
    place, shade = scene.rng.random(2), scene.rng.integers(0, 256)

    def cover(image: Pixels, scene: StruckRun) -> Pixels:
        size = (0.45 * np.array(image.shape)).astype(int)
        top, left = (place * (np.array(image.shape) - size)).astype(int)
        image[top : top + size[0], left : left + size[1]] = shade
        return image

    changing(IMAGES, _shown(cover), SPELL)(scene)


def _lie_of_size(message: Any, scene: StruckRun) -> None:
    message.height = int(scene.rng.integers(0, 4096))


def _truncate(message: Any, scene: StruckRun) -> None:
    del message.data[int(scene.rng.integers(0, len(message.data))) :]


def _unknown_encoding(message: Any, scene: StruckRun) -> None:
    message.encoding = 'mono7'


SHOWN: Faults = {
    'images_frozen': Fault('the same image again and again, stamps go on', _frozen(stamps=True)),
    'camera_hangs': Fault('the same image again and again, stamp and all', _frozen(stamps=False)),
    'images_swapped': Fault('images of other times of the run', _swap),
    'bag_loop': Fault('images of a bag in a loop, with its stamps', _loop),
    'images_black': always('black images', _seen(lambda image, _: np.zeros_like(image))),
    'images_saturated': Fault('white images', _seen(lambda image, _: np.full_like(image, 255))),
    'images_garbage': always(
        'noise for images', _seen(lambda image, scene: scene.rng.integers(0, 256, image.shape))
    ),
    'images_mirrored': Fault('mirrored images', _seen(_mirror)),
    'images_upside_down': Fault('images upside down', _seen(_upside_down)),
    'camera_mirrored': at_first('a driver that mirrors all images', _remount(_mirror)),
    'camera_upside_down': at_first('a camera mounted upside down', _remount(_upside_down)),
    'images_covered': Fault('a fifth of the image is covered', _cover),
    'images_lying_size': Fault(
        'images of a height that lies', changing(IMAGES, _lie_of_size, SPELL, true=False)
    ),
    'images_truncated': Fault(
        'images without their end', changing(IMAGES, _truncate, SPELL, true=False)
    ),
    'images_unknown_encoding': Fault(
        'images in an unknown encoding', changing(IMAGES, _unknown_encoding, SPELL, true=False)
    ),
}


def _deep(settings: WorldSettings, rng: np.random.Generator) -> WorldSettings:
    x, y, heading = settings.start  # four times as far as else
    return replace(settings, start=(4.0 * x, 4.0 * y, heading), depth=float(rng.uniform(15, 25)))


def _look_far(scene: StruckRun) -> None:
    """Let the scene be deeper, 60 to 200 m: the camera is moved by so much less."""
    depth = scene.world.settings.depth
    scene.notes.append(f'{depth:.0f} times as deep')

    def look(message: Any) -> None:
        position = message.pose.pose.position
        position.x, position.y = position.x / depth, position.y / depth

    scene.alter('/ground_truth', look)


def _jpeg_damaged(scene: StruckRun) -> None:
    """Send JPEGs, some damaged in the middle for a while: they decode all the same."""
    begin_s, share = scene.witness.now_s + scene.draw(1.0, 6.0), scene.draw(0.3, 1.0)
    end_s = begin_s + scene.draw(0.5, 8.0)
    scene.notes.append(f'{share:.0%} of them, for {end_s - begin_s:.1f} s')
    scene.later(end_s - scene.witness.now_s, lambda: None)

    def compress(envelope: Envelope) -> list[Envelope]:
        jpeg = _jpeg(_pixels(envelope.message))
        if begin_s <= scene.witness.now_s < end_s and scene.hits(share):
            first = int(len(jpeg) * scene.draw(0.3, 0.7))
            jpeg[first : first + len(jpeg) // 10] = scene.rng.integers(0, 255)
        message = _compressed_image(envelope.message.header, jpeg)
        return [replace(envelope, topic=f'{IMAGES}/compressed', message=message)]

    message = _compressed_image(Header(), _jpeg(taken(scene.world.settings.camera)))
    scene.world.wire.send(Envelope(f'{DESIRED}/compressed', message, HOP_NS))
    scene.filter(IMAGES, compress)


def _jpeg(pixels: Pixels) -> Pixels:
    jpeg = cv2.imencode('.jpg', pixels, [cv2.IMWRITE_JPEG_QUALITY, 80])[1]
    return np.array(jpeg, np.uint8).ravel()


def _compressed_image(header: Header, jpeg: Pixels) -> CompressedImage:
    message = CompressedImage(header=header, format='mono8; jpeg compressed mono8')
    message.data.frombytes(jpeg.tobytes())
    return message


def _set(scene: StruckRun, after_s: float = 0.0, **values: Any) -> None:
    """Set parameters of the camera in ``after_s`` from now."""
    scene.later(after_s, lambda: scene.world.set(CAMERA, values))


def _off_and_on(scene: StruckRun) -> None:
    """Switch the light off, and on again after 2 s: one lamp far behind is left."""
    _set(scene, light='dark')
    _set(scene, 2.0, light='ceiling')


def _open_window(scene: StruckRun) -> None:
    seconds = scene.spell(0.5, 10.0)
    _set(scene, light='window')
    if np.isfinite(seconds):
        _set(scene, seconds, light='ceiling')


def _exposure_leaps(scene: StruckRun) -> None:
    """Let the exposure leap by a factor of two, again and again, up and down."""
    after_s, passing = 0.0, {'disturbed_from': 0, 'disturbed_for': 10**6}  # always
    for factor in [*scene.rng.choice([0.5, 1.0, 2.0], 8), 1.0]:
        _set(scene, after_s, passing_exposure=float(factor), **passing)
        after_s += scene.draw(0.3, 2.0)


FOLLOWING = world_change(more={CAMERA: {'exposure': 'auto'}})
COMPRESSING = world_change(more={'tracker_node': {'transport': 'compressed'}})
SCENES: Faults = {
    'scene_deep': at_first('a scene 60 to 200 m deep', _look_far, _deep),
    'jpeg_damaged': at_first('JPEGs damaged in the middle', _jpeg_damaged, COMPRESSING),
    'light_off': Fault('light off for 2 s', _off_and_on),
    'light_off_auto': Fault(
        'the light goes off, and on after 2 s; the exposure follows', _off_and_on, FOLLOWING
    ),
    'window_opened': Fault(
        'a window opens in view, and the exposure follows', _open_window, FOLLOWING
    ),
    'exposure_leaps': Fault('the exposure leaps by a factor of two', _exposure_leaps),
}
