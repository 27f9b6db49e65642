"""Faults of wheel odometry, of a servo that hears it: it lies, or begins anew."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from visual_servo_epipolar.evaluation.faults.catalogue.fault import (
    Fault,
    Faults,
    Strike,
    StruckRun,
)
from visual_servo_epipolar.evaluation.live.world import WorldSettings

ODOMETRY = '/odom'


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
FAULTS: Faults = {
    'odometry_frozen': Fault(f'{WORDS} says the same pose for ever', _told(_frozen), _heard),
    'odometry_mirrored': Fault(f'{WORDS} has left for right', _told(_mirror), _heard),
    'odometry_reset': Fault(f'{WORDS} begins anew', _told(_begun_anew), _heard),
}
