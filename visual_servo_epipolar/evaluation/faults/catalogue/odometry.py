"""Faults of wheel odometry, of a servo that hears it: it lies, or begins anew."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from visual_servo_epipolar.evaluation.faults.catalogue.fault import EVERYWHERE, Fault, Scene
from visual_servo_epipolar.evaluation.live.wire import Envelope
from visual_servo_epipolar.evaluation.live.world import WorldSettings

ODOMETRY = '/odom'


def _heard(settings: WorldSettings, rng: np.random.Generator) -> WorldSettings:
    return replace(settings, servo=replace(settings.servo, odometry=True))


def _told(change: Callable[[Any, list[Any]], object]) -> Callable[[Scene], None]:
    """Change each pose from now on; ``change`` gets it, and the first one that was changed."""

    def strike(scene: Scene) -> None:
        first: list[Any] = []

        def alter(envelope: Envelope) -> list[Envelope]:
            pose = envelope.message.pose.pose
            if not first:
                place, turn = pose.position, pose.orientation
                first.extend((place.x, place.y, turn.z, turn.w))
            change(pose, first)
            return [envelope]

        scene.filter(ODOMETRY, alter)

    return strike


def _frozen(pose: Any, first: list[Any]) -> None:
    pose.position.x, pose.position.y, pose.orientation.z, pose.orientation.w = first


def _mirrored(pose: Any, first: list[Any]) -> None:
    pose.position.y, pose.orientation.z = -pose.position.y, -pose.orientation.z


def _begun_anew(pose: Any, first: list[Any]) -> None:
    pose.position.x, pose.position.y = pose.position.x - first[0], pose.position.y - first[1]


FAULTS: Mapping[str, Fault] = MappingProxyType(
    {
        'odometry_frozen': Fault(
            what='odometry, which is heard, says the same pose for ever',
            strike=_told(_frozen),
            prepare=_heard,
            phases=EVERYWHERE,
        ),
        'odometry_mirrored': Fault(
            what='odometry, which is heard, has left for right',
            strike=_told(_mirrored),
            prepare=_heard,
            phases=EVERYWHERE,
        ),
        'odometry_reset': Fault(
            what='odometry, which is heard, begins anew',
            strike=_told(_begun_anew),
            prepare=_heard,
            phases=EVERYWHERE,
        ),
    }
)
