"""
Leaning head: rays of a head whose camera leans on it by an unknown angle.

A head turns rays about the vertical, which lies in axes of its camera as it is configured to. If
the camera leans otherwise, views at other pan angles look tilted and rolled against the
photograph. The lean is that of the camera's attitude, estimated while driving: rays follow
it, and as long as it is uncertain, so is by how much a view tilts.
"""

from dataclasses import replace
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.rigs.rig import HeadView, Joints, Lean
from visual_servo_epipolar.core.twoview.estimator import Attitude, COLD_DEVIATION
from visual_servo_epipolar.core.twoview.observation import Observation

STEP = 1e-3  # of a lean, by which its effect is measured [rad]


def levelled(observation: Observation, attitude: Attitude, configured: Attitude) -> Observation:
    """Return ``observation`` with its rays turned by the learnt ``attitude``."""
    head = observation.head
    if head is None:
        return observation
    lean = Lean(
        configured.tilt + _share(attitude.tilt_deviation) * (attitude.tilt - configured.tilt),
        configured.roll + _share(attitude.roll_deviation) * (attitude.roll - configured.roll),
    )
    here, photograph = (
        _change(head, joints, lean) for joints in (head.joints, head.rig.photograph)
    )
    return replace(
        observation,
        current=observation.current @ here.T,
        desired=observation.desired @ photograph.T,
    )


def with_jitter(attitude: Attitude, observation: Observation) -> Attitude:
    """Return ``attitude`` with the jitter that its own doubt adds to a view of a head."""
    head = observation.head
    if head is None:
        return attitude
    doubt = math.hypot(
        _left(attitude.tilt_deviation) * _tilting(head, Lean(STEP, 0.0)),
        _left(attitude.roll_deviation) * _tilting(head, Lean(0.0, STEP)),
    )
    return replace(attitude, jitter=math.hypot(attitude.jitter, doubt))


def _share(deviation: float) -> float:
    """Return the share of a learnt lean that is believed."""
    return COLD_DEVIATION**2 / (COLD_DEVIATION**2 + deviation**2)


def _left(deviation: float) -> float:
    """Return the deviation of a lean [rad] of which that share is believed."""
    return deviation * math.sqrt(_share(deviation))


def _change(head: HeadView, joints: Joints, lean: Lean) -> FloatArray:
    """Return the rotation of rays, (3, 3), from the configured lean to this one."""
    axes = np.eye(3)
    configured, learnt = head.rig.rays(axes, joints), head.rig.rays(axes, joints, lean)
    return np.asarray(learnt.T @ configured)


def _tilting(head: HeadView, lean: Lean) -> float:
    """Return by how much a view tilts against the photograph, per angle of a lean."""
    axes, level, rig = np.eye(3), Lean(0.0, 0.0), head.rig
    here, there = (
        rig.rays(axes, joints, lean).T @ rig.rays(axes, joints, level)
        for joints in (head.joints, rig.photograph)
    )
    return float(np.linalg.norm(here - there)) / (math.sqrt(2.0) * STEP)
