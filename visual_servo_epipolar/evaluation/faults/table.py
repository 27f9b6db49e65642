"""
The table of faults: one row each, under the invariant that it tries most.

The judge tries every run by every invariant.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from itertools import count
import math
from typing import Any

from geometry_msgs.msg import Twist as TwistMessage
import numpy as np
from std_msgs.msg import Bool

from visual_servo_epipolar.core.arrays import Image as Pixels
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE
from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.evaluation.faults.fault import (
    BASE,
    Change,
    driving,
    Fault,
    RunStage,
    SERVO,
    Strike,
    striking,
    StruckRun,
)
from visual_servo_epipolar.evaluation.faults.judge import RunVerdict
from visual_servo_epipolar.evaluation.faults.world import Envelope, HOP_NS, NODES
from visual_servo_epipolar.messages import read, write
from visual_servo_epipolar.messages.write import TRACK_LAYOUT
from visual_servo_epipolar.nodes.startup.settings import CameraRig
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.cameras import CameraSettings

IMAGES, TRACKS, INFO, DESIRED = '/image_raw', '/tracks', '/camera_info', '/desired/image_raw'
COMMANDS, BUTTON = '/cmd_vel', '/stop_button'
CAMERA = 'camera_node'
SPELL = 0.3, 10.0  # for which nearly all of these last, if not for good [s]
SERVICES: Mapping[str, str] = {
    'start': '/servo_node/start',
    'stop': '/servo_node/stop',
    'reset': '/servo_node/reset',
    'capture': '/tracker_node/capture_desired',
    'redetect': '/tracker_node/redetect',
}


@striking
def delayed(
    scene: StruckRun,
    topic: str,
    delays: Callable[[StruckRun], list[float]],
    spell: tuple[float, float] | None = None,
) -> None:
    """Let each message come as often, and so much later, as ``delays`` [s]: none is lost."""

    def delay(envelope: Envelope) -> list[Envelope]:
        return [
            replace(envelope, delay_ns=envelope.delay_ns + round(seconds * NANOSECONDS))
            for seconds in delays(scene)
        ]

    scene.filter(topic, delay, spell)


@striking
def altered(
    scene: StruckRun,
    topic: str,
    change: Change,
    spell: tuple[float, float] | None = None,
    *,
    true: bool = True,
) -> None:
    """Let ``change`` alter each message of ``topic`` in place; ``true``: it is of the scene."""

    def alter(envelope: Envelope) -> list[Envelope]:
        change(envelope.message, scene)
        if envelope.sight is not None and not true:
            envelope.sight = replace(envelope.sight, true=False)
        return [envelope]

    scene.filter(topic, alter, spell)


def in_part(scene: StruckRun) -> list[float]:
    """Return the delays [s] of a message of which four of ten are lost."""
    return [] if scene.hits(0.4) else [0.0]


def restamped(stamp: Callable[[int, StruckRun], int]) -> Strike:
    """Return the strike that lets the stamp of an image be what ``stamp`` makes of it [ns]."""

    def change(message: Any, scene: StruckRun) -> None:
        stamp_ns = stamp(read.stamp_ns(message.header), scene)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, NANOSECONDS)

    return altered(IMAGES, change)


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
        stamp_ns = read.stamp_ns((envelope if stamps else old).message.header)
        header = old.message.header
        message = write.image(_pixels(old.message), 'mono8', stamp_ns, header.frame_id)
        return [replace(envelope, message=message, sight=old.sight)]

    scene.filter(IMAGES, play, SPELL)


PixelChange = Callable[[Pixels, StruckRun], Any]


def shown(change: PixelChange, spell: tuple[float, float] | None = SPELL) -> Strike:
    """Return the strike that lets the pixels that ``change`` makes of an image stand for it."""

    def alter(message: Any, scene: StruckRun) -> None:
        pixels = np.ascontiguousarray(change(_pixels(message).copy(), scene), np.uint8)
        _show(message, pixels.tobytes())

    return altered(IMAGES, alter, spell, true=spell is None)


def _pixels(message: Any) -> Pixels:
    return np.frombuffer(message.data, np.uint8).reshape(message.height, message.width)


def _show(message: Any, data: bytes) -> None:
    del message.data[:]
    message.data.frombytes(data)


@striking
def remounted(scene: StruckRun, change: PixelChange) -> None:
    """Change all images of a camera, the photograph as well."""
    shown(change, None)(scene)
    photographed(lambda camera, scene: change(taken(camera), scene))(scene)


@striking
def photographed(scene: StruckRun, pixels: Callable[[CameraSettings, StruckRun], Any]) -> None:
    """Let another publisher send the photograph that ``pixels`` makes with the camera."""
    image = np.ascontiguousarray(pixels(scene.world.settings.camera, scene), np.uint8)
    message: Any = write.image(image, 'mono8', 0, CameraRig.camera_frame)
    scene.filter(DESIRED, lambda envelope: [replace(envelope, message=message)], None)
    scene.world.wire.send(Envelope(DESIRED, message, 2 * HOP_NS))


def taken(camera: CameraSettings) -> Pixels:
    """Return an image as the camera takes it."""
    return CameraSimulator(camera).capture(DESIRED_POSE, 0)


def retracked(change: Callable[[Any, StruckRun], Any], *, true: bool = True) -> Strike:
    """Return the strike that gives tracks the rows that ``change`` makes of theirs."""

    def alter(message: Any, scene: StruckRun) -> None:
        rows = change(np.frombuffer(message.data, TRACK_LAYOUT).copy(), scene)
        message.width, message.row_step = len(rows), len(rows) * message.point_step
        _show(message, rows.tobytes())

    return altered(TRACKS, alter, SPELL, true=true)


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


def lens(model: str, *coefficients: float) -> Change:
    """Return what gives camera_info another distortion."""

    def change(info: Any, scene: StruckRun) -> None:
        info.distortion_model, info.d = model, list(coefficients)

    return change


def transposed(info: Any, scene: StruckRun) -> None:
    """Give camera_info its matrix column by column."""
    info.k = np.asarray(info.k).reshape(3, 3).T.ravel()


@striking
def scaled(scene: StruckRun, *indices: int) -> None:
    """Let elements of K be those of images of another size, or of another lens."""
    ratio = float(scene.rng.choice((0.25, 0.35, 0.5, 0.7, 0.8, 1.2, 1.4, 2.0, 2.8, 4.0)))
    scene.notes.append(f'times {ratio:g}')

    def scale(info: Any, scene: StruckRun) -> None:
        k = np.array(info.k)
        k[list(indices)] *= ratio
        info.k = k

    altered(INFO, scale)(scene)


@striking
def becomes(scene: StruckRun, /, node: str, **ranges: tuple[float, float]) -> None:
    """Draw values of parameters of a node that hold from now on."""
    values = {name: round(scene.draw(*bounds), 4) for name, bounds in ranges.items()}
    scene.notes.append(f'{values}{scene.world.set(node, values)}')


@striking
def lit(scene: StruckRun, light: str) -> None:
    """Let the light become another, for a while or for good."""
    seconds = scene.spell(0.5, 10.0)
    scene.world.set(CAMERA, {'light': light})
    if seconds < math.inf:
        scene.later(seconds, lambda: scene.world.set(CAMERA, {'light': 'ceiling'}))


def _clock_leaps(scene: StruckRun) -> None:
    """Set the wall clock, as NTP does."""
    seconds = scene.draw(1.0, 300.0) if scene.hits(0.5) else scene.draw(-900.0, -0.1)
    scene.notes.append(f'by {seconds:+.1f} s')
    scene.world.wire.offset_ns += round(seconds * NANOSECONDS)


@striking
def restarted(scene: StruckRun, name: str) -> None:
    """Let a node be gone for a while; the base begins at the start again."""
    seconds = scene.draw(0.05, 4.0)
    scene.notes.append(f'after {seconds:.1f} s')
    scene.world.kill(name)

    def again() -> None:
        if name == BASE:
            scene.witness.record.moved_s.append(scene.witness.now_s)
        scene.world.start(name)

    scene.later(seconds, again)


NODE_KINDS: Mapping[str, tuple[str, Callable[[str], Strike]]] = {
    'killed': ('is gone without a word', lambda name: lambda scene: scene.world.kill(name)),
    'ended': ('ends as by SIGINT', lambda name: lambda scene: scene.world.end(name)),
    'restarted': ('is gone, and comes back', restarted),
}


def node_faults() -> dict[str, Fault]:
    """Return what may happen to each node."""
    return {
        f'{name.removesuffix("_node")}_{kind}': always(
            f'{name} {words}', strike(name), base_alone=name == SERVO and kind != 'ended'
        )
        for name in NODES
        for kind, (words, strike) in NODE_KINDS.items()
    }


def command(scene: StruckRun, linear: float, angular: float) -> None:
    """Let another publisher send a command."""
    twist = TwistMessage()
    twist.linear.x, twist.angular.z = linear, angular
    scene.world.wire.send(Envelope(COMMANDS, twist, 0))


def _garbage(scene: StruckRun) -> None:
    """Send twists that are no numbers, at 20 Hz for 3 s."""
    twists = ((math.nan, 0.0), (math.inf, 0.0), (0.0, -math.inf), (math.nan, math.nan))
    for number in range(60):
        scene.later(number / 20, lambda: command(scene, *twists[int(scene.rng.integers(4))]))


@striking
def called(scene: StruckRun, service: str) -> None:
    """Call one of SERVICES, and note what that means for the goal, or for a robot that moves."""
    record = scene.witness.record
    if service == 'capture':
        record.goals.append(scene.witness.seen_pose)
    if service == 'stop':
        scene.note_stop()
    answer = scene.world.call(SERVICES[service])
    if service == 'start' and answer.startswith(('started', 'armed')):
        record.stopped_s = math.inf
    scene.notes.append(f'{service}: {answer}')


def _press(scene: StruckRun) -> None:
    """Press the stop button for a while; released, it leaves the robot standing."""
    wire = scene.world.wire
    wire.send(Envelope(BUTTON, Bool(data=True), HOP_NS))
    scene.note_stop()
    release = Envelope(BUTTON, Bool(data=False), HOP_NS)
    scene.later(scene.draw(0.05, 5.0), lambda: wire.send(release))


def _carry(scene: StruckRun) -> None:
    """Carry the robot back to the start, as ``~/reset`` of the base does."""
    scene.witness.record.moved_s.append(scene.witness.now_s)
    scene.notes.append(scene.world.call('/unicycle_node/reset'))


at_first = partial(driving, stages=(RunStage.BEGIN,))
always = partial(driving, stages=(RunStage.BEGIN, *[RunStage.DRIVING] * 3, RunStage.END))
BARREL = lens('plumb_bob', -0.35, 0.12, 0.0, 0.0, 0.0)
FISHEYE = lens('equidistant', 0.0, 0.0, 0.0, 0.0)
TABLE: Mapping[RunVerdict, Mapping[str, Fault]] = {
    RunVerdict.BLIND: {
        'images_dropped': driving('four of ten images lost', delayed(IMAGES, in_part)),
        'images_end': always(
            'no images, for a while or for good', delayed(IMAGES, lambda _: [], SPELL)
        ),
        'images_late': driving(
            'images 0.3 or 2.5 s late',
            delayed(IMAGES, lambda _: [0.3]),
            delayed(IMAGES, lambda _: [2.5]),
        ),
        'images_uneven': driving(
            'images 0 to 0.5 s late each, out of order, or three times',
            delayed(IMAGES, lambda scene: [scene.draw(0.0, 0.5)]),
            delayed(IMAGES, lambda scene: [0.2 if scene.hits(0.3) else 0.0]),
            delayed(IMAGES, lambda _: [0.0, 0.02, 0.04]),
        ),
        'images_stamps': driving(
            'stamps of 1970, of 0, of tomorrow, or up to 2 s off',
            restamped(lambda stamp_ns, _: stamp_ns % (1_000_000 * NANOSECONDS)),
            restamped(lambda *_: 0),
            restamped(lambda stamp_ns, _: stamp_ns + 86_400 * NANOSECONDS),
            restamped(lambda it, scene: it + round(scene.draw(-2.0, 2.0) * NANOSECONDS)),
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
        'light_changes': driving('lamps go off, or a window opens', lit('dark'), lit('window')),
        'tracks_few': always(
            'no features, a few, or all at one point',
            retracked(lambda rows, _: rows[:0], true=False),
            retracked(lambda rows, scene: rows[: int(scene.rng.integers(1, 12))]),
            retracked(at_one_point, true=False),
        ),
        'tracks_late': driving(
            'four of ten tracks lost, or all late',
            delayed(TRACKS, in_part),
            delayed(TRACKS, lambda _: [0.3]),
        ),
        'info_missing': always('no camera_info', delayed(INFO, lambda _: [])),
        'clock_leaps': always('the wall clock leaps, ahead or back', _clock_leaps),
        'commands_lost': driving(
            'four of ten commands lost, or all',
            delayed(COMMANDS, in_part),
            delayed(COMMANDS, lambda _: [], (3.0, 10.0)),
            base_alone=True,
        ),
        **node_faults(),
    },
    RunVerdict.WRONG_ARRIVAL: {
        'none': driving('nothing is wrong'),
        'shutter_rolls': driving(
            'rows are read out within 10 to 33 ms', becomes(CAMERA, readout=(0.01, 0.033))
        ),
        'base_nods': driving(
            'the body nods', becomes(BASE, nod=(0.009, 0.035), acceleration=(0.5, 1.0))
        ),
        'dead_band_grows': driving(
            'motors stand below 0.01 to 0.05 m/s and 0.02 to 0.08 rad/s',
            becomes(BASE, dead_zone_linear=(0.01, 0.05), dead_zone_angular=(0.02, 0.08)),
        ),
        'command_delay': driving('commands take 0.3 s', becomes(BASE, command_delay=(0.3, 0.3))),
        'motors_stand': driving(
            'the motors do not drive, or turn, or neither',
            becomes(BASE, dead_zone_linear=(1.0, 1.0)),
            becomes(BASE, dead_zone_angular=(2.0, 2.0)),
            becomes(BASE, dead_zone_linear=(1.0, 1.0), dead_zone_angular=(2.0, 2.0)),
        ),
        'wheels_slip': driving(
            'wheels slip by 10 to 40 %, unevenly',
            becomes(BASE, slip=(0.1, 0.4), wheel_ratio=(0.8, 1.25)),
        ),
        'carried': always('the robot is carried to the start', _carry),
        'tracks_wrong': driving(
            'half of the tracks anywhere, or 25 px aside', retracked(anywhere), retracked(shifted)
        ),
        'tracks_nan': driving('nan and inf in tracks', retracked(not_finite)),
        'matrix_scaled': at_first(
            'K, or its focal length, of 1/4 to 4 times the size', scaled(0, 4, 2, 5), scaled(0, 4)
        ),
        'info_wrong': at_first(
            'a distortion that is not there, a fisheye that is none, or K column by column',
            *(altered(INFO, change) for change in (BARREL, FISHEYE, transposed)),
        ),
        'photograph_other_room': always(
            'a photograph of another room, or a black one',
            photographed(lambda camera, _: taken(replace(camera, scene_seed=77))),
            photographed(lambda camera, _: np.zeros_like(taken(camera))),
        ),
        'camera_mirrored': at_first(
            'a driver that mirrors all images, or a camera upside down',
            remounted(lambda image, _: image[:, ::-1]),
            remounted(lambda image, _: image[::-1, ::-1]),
        ),
    },
    RunVerdict.DISOBEYED: {
        **{f'order_{name}': always(service, called(name)) for name, service in SERVICES.items()},
        'order_button': always('the stop button is pressed, and released', _press),
    },
    RunVerdict.LIMITS: {
        'commands_garbage': always('nan and inf on cmd_vel from another publisher', _garbage),
        'limits_lowered': driving(
            'limits of speed lowered',
            becomes(SERVO, max_linear=(0.02, 0.1), max_angular=(0.02, 0.1)),
        ),
    },
}
FAULTS = {name: fault for rows in TABLE.values() for name, fault in rows.items()}
