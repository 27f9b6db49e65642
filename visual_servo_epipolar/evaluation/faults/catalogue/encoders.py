"""
Faults of what encoders say: of wheels, to a servo that hears odometry, and of a head.

They lie, begin anew, or fall silent; a head is misnamed, stuck, at its limit, apart in time.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from functools import partial
from typing import Any

import numpy as np

from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.evaluation.faults.catalogue.fault import (
    always,
    at_first,
    Fault,
    Faults,
    Strike,
    StruckRun,
)
from visual_servo_epipolar.evaluation.faults.catalogue.streams import drop_some, late
from visual_servo_epipolar.evaluation.live.world import WorldSettings
from visual_servo_epipolar.simulation.mounts.pan_tilt import PanTiltSettings

ODOMETRY = '/odom'
ANGLES, COMMAND = '/joint_states', '/head/command'
RIG = 'pan_tilt'


def _heard(settings: WorldSettings, rng: np.random.Generator) -> WorldSettings:
    return replace(settings, servo=replace(settings.servo, odometry=True))


def _told(change: Callable[[Any, list[Any]], object]) -> Strike:
    """Change each pose from now on; ``change`` gets it, and the first one that was changed."""

    def strike(scene: StruckRun) -> None:
        first: list[Any] = []

        def alter(message: Any) -> None:
            pose = message.pose.pose
            if not first:
                place, turn = pose.position, pose.orientation
                first.extend((place.x, place.y, turn.z, turn.w))
            change(pose, first)

        scene.alter(ODOMETRY, alter)

    return strike


def _frozen(pose: Any, first: list[Any]) -> None:
    pose.position.x, pose.position.y, pose.orientation.z, pose.orientation.w = first


def _mirror(pose: Any, first: list[Any]) -> None:
    pose.position.y, pose.orientation.z = -pose.position.y, -pose.orientation.z


def _begun_anew(pose: Any, first: list[Any]) -> None:
    pose.position.x, pose.position.y = pose.position.x - first[0], pose.position.y - first[1]


WORDS = 'odometry, which is heard,'


def on_a_head(
    settings: WorldSettings,
    rng: np.random.Generator,
    *,
    names: Mapping[str, str] | None = None,
    limits: tuple[float, float] | None = None,
) -> WorldSettings:
    """Return a world whose camera is on a head: of other ``names``, or pan ``limits`` drawn."""
    camera = PanTiltSettings(**asdict(settings.camera))
    if limits is not None:
        camera = replace(camera, head_pan_limit=float(rng.uniform(*limits)))
    return replace(
        settings,
        camera=camera,
        servo=replace(settings.servo, rig=RIG, law='smooth'),
        more={**settings.more, 'camera_node': {'rig': RIG, **(names or {})}},
    )


def _silent(scene: StruckRun) -> None:
    scene.lose(ANGLES, scene.spell(0.3, 8.0))


def _stuck(scene: StruckRun) -> None:
    scene.lose(COMMAND, scene.spell(0.3, 8.0))


def _apart(scene: StruckRun) -> None:
    seconds = scene.draw(0.2, 3.0) * (1.0 if scene.hits(0.5) else -1.0)
    scene.notes.append(f'by {seconds:+.2f} s')

    def change(message: Any) -> None:
        time = message.header.stamp
        stamp_ns = int(time.sec) * NANOSECONDS + int(time.nanosec) + round(seconds * NANOSECONDS)
        time.sec, time.nanosec = divmod(max(stamp_ns, 0), NANOSECONDS)

    scene.alter(ANGLES, change)


def _turned(low: float, high: float) -> Strike:
    """Let the encoder of the pan joint be off by an angle from now on."""

    def strike(scene: StruckRun) -> None:
        angle = scene.draw(low, high) * (1.0 if scene.hits(0.5) else -1.0)
        scene.notes.append(f'by {angle:+.2f} rad')

        def change(message: Any) -> None:
            message.position = [message.position[0] + angle, *list(message.position)[1:]]

        scene.alter(ANGLES, change)

    return strike


OTHER = {'pan_joint': 'head_pan_joint', 'tilt_joint': 'head_tilt_joint'}
FAULTS: Faults = {
    'odometry_frozen': Fault(f'{WORDS} says the same pose for ever', _told(_frozen), _heard),
    'odometry_mirrored': Fault(f'{WORDS} has left for right', _told(_mirror), _heard),
    'odometry_reset': Fault(f'{WORDS} begins anew', _told(_begun_anew), _heard),
    'head_none': Fault('nothing is wrong with a head', prepare=on_a_head),
    'head_silent': always('no angles of the head, a while or for good', _silent, on_a_head),
    'head_names': at_first('joints have other names', prepare=partial(on_a_head, names=OTHER)),
    'head_stamps': always('angles and images 0.2 to 3 s apart', _apart, on_a_head),
    'head_dropped': Fault('up to half of the angles are lost', drop_some(ANGLES), on_a_head),
    'head_late': Fault('angles 0.1 to 1 s late', late(ANGLES, 0.1, 1.0), on_a_head),
    'head_stuck': Fault('the head does not hear its command', _stuck, on_a_head),
    'head_limit': at_first(
        'the head turns 3 to 17 deg to either side',
        prepare=partial(on_a_head, limits=(0.05, 0.3)),
    ),
    'head_leaps': Fault('the encoder leaps by 0.3 to 1 rad', _turned(0.3, 1.0), on_a_head),
    'head_slips': Fault('the encoder slips by 0.07 to 0.3 rad', _turned(0.07, 0.3), on_a_head),
}
