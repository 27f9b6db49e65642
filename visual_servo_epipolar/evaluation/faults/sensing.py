"""
Faults of sensing: images and tracks, calibration and photograph, scenes and light.

A fault is one row, under the invariant that it tries most; the judge tries each run by all.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import count
import math
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
    driving,
    Strike,
    striking,
    StruckRun,
    Table,
    world_change,
)
from visual_servo_epipolar.evaluation.faults.judge import RunVerdict
from visual_servo_epipolar.evaluation.faults.world import Envelope, HOP_NS, WorldSettings
from visual_servo_epipolar.messages import read, write
from visual_servo_epipolar.messages.write import TRACK_LAYOUT
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings

IMAGES, TRACKS, INFO, DESIRED = '/image_raw', '/tracks', '/camera_info', '/desired/image_raw'
CAMERA, TRACKER = 'camera_node', 'tracker_node'
SPELL = 0.3, 10.0  # for which nearly all of these last, if not for good [s]


@striking
def dropped(scene: StruckRun, topic: str) -> None:
    """Lose up to half of the messages of ``topic``."""
    share = scene.draw(0.1, 0.5)
    scene.notes.append(f'{share:.0%} of them')
    scene.filter(topic, lambda envelope: [] if scene.hits(share) else [envelope])


@striking
def lost(scene: StruckRun, topic: str, low: float = SPELL[0], high: float = SPELL[1]) -> None:
    """Lose all messages of ``topic``, for a while or for good."""
    scene.lose(topic, scene.spell(low, high))


@striking
def late(scene: StruckRun, topic: str, low: float, high: float) -> None:
    """Delay the messages of ``topic``, each by the same time."""
    seconds = scene.draw(low, high)
    scene.notes.append(f'by {seconds:.2f} s')
    scene.filter(topic, lambda envelope: [delayed(envelope, seconds)])


@striking
def copied(scene: StruckRun, topic: str, delays: Callable[[StruckRun], list[float]]) -> None:
    """Let each message come as often, and so much later, as ``delays`` [s]."""
    scene.filter(topic, lambda envelope: [delayed(envelope, each) for each in delays(scene)])


def delayed(envelope: Envelope, seconds: float) -> Envelope:
    """Return ``envelope``, later by ``seconds``."""
    return replace(envelope, delay_ns=envelope.delay_ns + round(seconds * NANOSECONDS))


@striking
def altered(
    scene: StruckRun,
    topic: str,
    change: Change,
    spell: tuple[float, float] | None = SPELL,
    *,
    true: bool = True,
) -> None:
    """Let ``change`` alter each message of ``topic``, for a drawn ``spell`` [s] or for good."""
    seconds = np.inf if spell is None else scene.spell(*spell)
    scene.alter(topic, lambda message: change(message, scene), seconds, true=true)


@striking
def restamped(scene: StruckRun, topic: str, stamp: Callable[[int, StruckRun], int]) -> None:
    """Let the stamp of each message of ``topic`` be what ``stamp`` makes of it [ns]."""

    def change(message: Any) -> None:
        stamp_ns = stamp(read.stamp_ns(message.header), scene)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, NANOSECONDS)

    scene.alter(topic, change)


@striking
def replayed(scene: StruckRun, length: int, *, stamps: bool) -> None:
    """
    Show the next images, up to ``length`` of them, again and again, as a bag in a loop does.

    A single one is of a camera that hangs. They have ``stamps`` of now, or their own.
    """
    kept: list[Envelope] = []
    number, numbers = int(scene.rng.integers(1, length + 1)), count()
    scene.notes.append(f'{number} images, stamps of {"now" if stamps else "then"}')

    def play(envelope: Envelope) -> list[Envelope]:
        if len(kept) < number:
            kept.append(envelope)
            return [envelope]
        old = kept[next(numbers) % number]
        message = type(old.message)(header=old.message.header, encoding=old.message.encoding)
        message.height, message.width = old.message.height, old.message.width
        message.step = old.message.step
        _show(message, old.message.data.tobytes())
        if stamps:
            message.header = envelope.message.header
        return [replace(envelope, message=message, sight=old.sight)]

    scene.filter(IMAGES, play, scene.spell(*SPELL))


PixelChange = Callable[[Pixels, StruckRun], Any]


def shown(change: PixelChange, *, true: bool = False) -> Strike:
    """Return the strike that lets other pixels stand for those that were taken."""
    return altered(IMAGES, _painted(change), true=true)


def _painted(change: PixelChange) -> Change:
    """Return what gives images the pixels that ``change`` makes of theirs."""

    def alter(message: Any, scene: StruckRun) -> None:
        pixels = np.ascontiguousarray(change(_pixels(message).copy(), scene), np.uint8)
        _show(message, pixels.tobytes())

    return alter


def _pixels(message: Any) -> Pixels:
    return np.frombuffer(message.data, np.uint8).reshape(message.height, message.width)


def _show(message: Any, data: bytes) -> None:
    del message.data[:]
    message.data.frombytes(data)


@striking
def remounted(scene: StruckRun, change: PixelChange) -> None:
    """Change all images of a camera, the photograph as well."""
    altered(IMAGES, _painted(change), None)(scene)
    photographed(lambda camera, scene: change(taken(camera), scene))(scene)


def covered(scene: StruckRun) -> None:
    """Cover 0.45 of each side of the images with what moves along: what is left is true."""
    place, shade = scene.rng.random(2), scene.rng.integers(0, 256)

    def cover(image: Pixels, scene: StruckRun) -> Pixels:
        size = (0.45 * np.array(image.shape)).astype(int)
        top, left = (place * (np.array(image.shape) - size)).astype(int)
        image[top : top + size[0], left : left + size[1]] = shade
        return image

    shown(cover, true=True)(scene)


@striking
def photographed(scene: StruckRun, pixels: Callable[[CameraSettings, StruckRun], Any]) -> None:
    """Let another publisher send the photograph that ``pixels`` makes with the camera."""
    image = np.ascontiguousarray(pixels(scene.world.settings.camera, scene), np.uint8)
    message: Any = write.image(image, 'mono8', 0, 'camera_optical_frame')
    scene.filter(DESIRED, lambda envelope: [replace(envelope, message=message)])
    scene.world.wire.send(Envelope(DESIRED, message, 2 * HOP_NS))


def taken(camera: CameraSettings, pose: Pose = DESIRED_POSE) -> Pixels:
    """Return an image as the camera takes it."""
    return CameraSimulator(camera).capture(pose, 0)


def taken_elsewhere(camera: CameraSettings, scene: StruckRun) -> Pixels:
    """Return an image from a drawn pose behind the goal."""
    x, y, turn = scene.draw(-0.2, 0.2), -scene.draw(0.1, 0.3), scene.draw(-0.05, 0.05)
    goal = DESIRED_POSE
    return taken(camera, Pose(goal.x + x, goal.y + y, goal.theta + turn))


def damaged(scene: StruckRun) -> None:
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
        message = _compressed(envelope.message.header, jpeg)
        return [replace(envelope, topic=f'{IMAGES}/compressed', message=message)]

    message = _compressed(Header(), _jpeg(taken(scene.world.settings.camera)))
    scene.world.wire.send(Envelope(f'{DESIRED}/compressed', message, HOP_NS))
    scene.filter(IMAGES, compress)


def _jpeg(pixels: Pixels) -> Pixels:
    jpeg = cv2.imencode('.jpg', pixels, [cv2.IMWRITE_JPEG_QUALITY, 80])[1]
    return np.array(jpeg, np.uint8).ravel()


def _compressed(header: Header, jpeg: Pixels) -> CompressedImage:
    message = CompressedImage(header=header, format='mono8; jpeg compressed mono8')
    message.data.frombytes(jpeg.tobytes())
    return message


def retracked(change: Callable[[Any, StruckRun], Any], *, true: bool = True) -> Strike:
    """Return the strike that gives tracks the rows that ``change`` makes of theirs."""

    def alter(message: Any, scene: StruckRun) -> None:
        rows = change(np.frombuffer(message.data, TRACK_LAYOUT).copy(), scene)
        message.width, message.row_step = len(rows), len(rows) * message.point_step
        _show(message, rows.tobytes())

    return altered(TRACKS, alter, true=true)


def anywhere(rows: Any, scene: StruckRun) -> Any:
    """Return tracks of which half, others each time, are anywhere."""
    wrong = scene.rng.random(len(rows)) < 0.5
    for name, size in (('u', 320.0), ('v', 256.0)):
        rows[name][wrong] = scene.rng.uniform(0.0, size, np.count_nonzero(wrong))
    return rows


def shifted(rows: Any, scene: StruckRun) -> Any:
    """Return tracks of which half, always the same, are elsewhere, as those of what moves."""
    rows['u'][rows['id'] % 2 == 0] += 25.0
    return rows


def not_finite(rows: Any, scene: StruckRun) -> Any:
    """Return tracks that are nan and inf in part."""
    rows['u'][scene.rng.random(len(rows)) < scene.draw(0.0, 1.0)] = np.nan
    rows['v'][scene.rng.random(len(rows)) < 0.1] = np.inf
    return rows


def at_one_point(rows: Any, scene: StruckRun) -> Any:
    """Return tracks that are all at one point."""
    rows['u'], rows['v'] = 160.0, 128.0
    return rows


def _lie(message: Any, scene: StruckRun) -> None:
    """Let the size of a message be another one than that of its data."""
    message.height = int(scene.rng.integers(0, 4096))
    if hasattr(message, 'point_step'):
        message.width = int(scene.rng.integers(0, 2**31))
        message.point_step = int(scene.rng.integers(0, 200))


def _truncated(message: Any, scene: StruckRun) -> None:
    del message.data[int(scene.rng.integers(0, len(message.data))) :]


def _encoding(message: Any, scene: StruckRun) -> None:
    message.encoding = 'mono7'


def _lens(model: str, *coefficients: float) -> Change:
    def change(info: Any, scene: StruckRun) -> None:
        info.distortion_model, info.d = model, list(coefficients)

    return change


def _transposed(info: Any, scene: StruckRun) -> None:
    info.k = np.asarray(info.k).reshape(3, 3).T.ravel()


def _focal(value: float) -> Change:
    def change(info: Any, scene: StruckRun) -> None:
        info.k[0] = value

    return change


def _longer(info: Any, scene: StruckRun) -> None:
    info.k[0], info.k[4] = 1.3 * info.k[0], 1.3 * info.k[4]


def _flickering(info: Any, scene: StruckRun) -> None:
    if scene.hits(0.5):
        _longer(info, scene)


def _larger(info: Any, scene: StruckRun) -> None:
    info.width, info.height = 2 * info.width, 2 * info.height


def _scaled(scene: StruckRun) -> None:
    """Let K be that of images of another size, or of another lens."""
    ratio = float(scene.rng.choice((0.25, 0.35, 0.5, 0.7, 1.4, 2.0, 2.8, 4.0)))
    whole = scene.hits(0.5)
    scene.notes.append(f'{"K" if whole else "focal length"} times {ratio:g}')

    def scale(info: Any) -> None:
        k = np.array(info.k)
        k[[0, 4, 2, 5] if whole else [0, 4]] *= ratio
        info.k = k

    scene.alter(INFO, scale)


def _wrong_focal(settings: WorldSettings, rng: np.random.Generator) -> WorldSettings:
    ratio = float(rng.choice((0.8, 0.85, 1.2, 1.25)))
    return replace(settings, camera=replace(settings.camera, believed_focal_ratio=ratio))


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


def _exposure_leaps(scene: StruckRun) -> None:
    """Let the exposure leap by a factor of two, again and again, up and down."""
    after_s, passing = 0.0, {'disturbed_from': 0, 'disturbed_for': 10**6}  # always
    for factor in [*scene.rng.choice([0.5, 1.0, 2.0], 8), 1.0]:
        values = {'passing_exposure': float(factor), **passing}
        scene.later(after_s, partial(scene.world.set, CAMERA, values))
        after_s += scene.draw(0.3, 2.0)


def _exposure(settings: WorldSettings, rng: np.random.Generator) -> WorldSettings:
    exposure = 'auto' if rng.random() < 0.5 else 'fixed'
    return replace(settings, more={CAMERA: {'exposure': exposure}})


def _light_changes(scene: StruckRun) -> None:
    """Let all lamps but one go off, or a window open, for a while or for good."""
    light = ('dark', 'window')[int(scene.rng.integers(2))]
    seconds = scene.spell(0.5, 10.0)
    scene.notes.append(light)
    scene.world.set(CAMERA, {'light': light})
    if seconds < math.inf:
        scene.later(seconds, lambda: scene.world.set(CAMERA, {'light': 'ceiling'}))


FLIPS: tuple[PixelChange, ...] = (
    lambda image, _: image[:, ::-1],
    lambda image, _: image[::-1, ::-1],
)
BARREL = _lens('plumb_bob', -0.35, 0.12, 0.0, 0.0, 0.0)
FISHEYE = _lens('equidistant', 0.0, 0.0, 0.0, 0.0)
JPEG = world_change(more={TRACKER: {'transport': 'compressed'}})
SENSING: Table = {
    RunVerdict.BLIND: {
        'images_dropped': driving('up to half of the images lost', dropped(IMAGES)),
        'images_end': always('no images, for a while or for good', lost(IMAGES)),
        'images_late': driving('images late', late(IMAGES, 0.1, 0.5), late(IMAGES, 1.5, 4.0)),
        'images_uneven': driving(
            'images 0 to 0.5 s late each, out of order, or three times',
            copied(IMAGES, lambda scene: [scene.draw(0.0, 0.5)]),
            copied(IMAGES, lambda scene: [0.2 if scene.hits(0.3) else 0.0]),
            copied(IMAGES, lambda _: [0.0, 0.02, 0.04]),
        ),
        'images_stamps': driving(
            'stamps of 1970, of 0, of tomorrow, or up to 2 s off',
            restamped(IMAGES, lambda stamp_ns, _: stamp_ns % (1_000_000 * NANOSECONDS)),
            restamped(IMAGES, lambda *_: 0),
            restamped(IMAGES, lambda stamp_ns, _: stamp_ns + 86_400 * NANOSECONDS),
            restamped(IMAGES, lambda it, scene: it + round(scene.draw(-2.0, 2.0) * NANOSECONDS)),
        ),
        'camera_hangs': driving(
            'one image again and again', replayed(1, stamps=False), replayed(1, stamps=True)
        ),
        'bag_loop': driving(
            'a bag in a loop', replayed(60, stamps=False), replayed(60, stamps=True)
        ),
        'images_blank': always(
            'black images, or white ones, or noise',
            shown(lambda image, _: np.zeros_like(image)),
            shown(lambda image, _: np.full_like(image, 255)),
            shown(lambda image, scene: scene.rng.integers(0, 256, image.shape)),
        ),
        'images_mirrored': driving('mirrored images, or upside down', *map(shown, FLIPS)),
        'images_covered': driving('a fifth of the image is covered', covered),
        'images_malformed': driving(
            'images of a wrong size, without their end, or in an unknown encoding',
            *(altered(IMAGES, change, true=False) for change in (_lie, _truncated, _encoding)),
        ),
        'jpeg_damaged': at_first('JPEGs damaged in the middle', damaged, prepare=JPEG),
        'light_changes': driving(
            'lamps go off, or a window opens', _light_changes, prepare=_exposure
        ),
        'exposure_leaps': driving('the exposure leaps by a factor of two', _exposure_leaps),
        'tracks_few': always(
            'no features, a few, or all at one point',
            retracked(lambda rows, _: rows[:0], true=False),
            retracked(lambda rows, scene: rows[: int(scene.rng.integers(1, 12))]),
            retracked(at_one_point, true=False),
        ),
        'tracks_late': driving('tracks lost, or late', dropped(TRACKS), late(TRACKS, 0.1, 0.5)),
        'tracks_malformed': always('tracks of a wrong size', altered(TRACKS, _lie, true=False)),
        'info_missing': always('no camera_info', lambda scene: scene.lose(INFO)),
    },
    RunVerdict.WRONG_ARRIVAL: {
        'tracks_wrong': driving(
            'half of the tracks anywhere, or 25 px aside', retracked(anywhere), retracked(shifted)
        ),
        'tracks_nan': driving('nan and inf in tracks', retracked(not_finite)),
        'focal_wrong': at_first('focal length configured 15 to 25 % wrong', prepare=_wrong_focal),
        'matrix_scaled': at_first('K, or its focal length, of 1/4 to 4 times the size', _scaled),
        'info_wrong': at_first(
            'a distortion that is not there, a fisheye that is none, or K column by column',
            *(altered(INFO, change, None) for change in (BARREL, FISHEYE, _transposed)),
        ),
        'info_senseless': always(
            'K[0] of camera_info is 0 or nan, or it is of larger images',
            *(altered(INFO, change, None) for change in (_focal(0.0), _focal(math.nan), _larger)),
        ),
        'info_changes': driving(
            'another focal length in mid-run, or from image to image',
            *(altered(INFO, change, None) for change in (_longer, _flickering)),
        ),
        'photograph_other_room': always(
            'a photograph of another room, or a black one',
            photographed(lambda camera, _: taken(replace(camera, scene_seed=77))),
            photographed(lambda camera, _: np.zeros_like(taken(camera))),
        ),
        'photograph_other_pose': driving('another goal in mid-run', photographed(taken_elsewhere)),
        'camera_mirrored': at_first(
            'a driver that mirrors all images, or a camera upside down', *map(remounted, FLIPS)
        ),
        'scene_deep': at_first('a scene 60 to 200 m deep', _look_far, prepare=_deep),
    },
}
