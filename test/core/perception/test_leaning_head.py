"""Leaning head: rays follow the lean that is learnt, and its doubt widens the jitter."""

from dataclasses import replace
import math

import numpy as np
import pytest

from visual_servo_epipolar.core.estimators.base import Attitude
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.perception.leaning_head import levelled, UNTOLD, with_jitter
from visual_servo_epipolar.core.perception.observation import Observation
from visual_servo_epipolar.core.rigs.pan_tilt import PanTiltHead
from visual_servo_epipolar.core.rigs.rig import AT_REST, HeadLimits, Joints
from visual_servo_epipolar.simulation.mounts.mounting import CameraMount

LEAN = CameraMount(tilt=0.04, roll=-0.02)
HEAD = PanTiltHead(HeadLimits())  # told nothing of it
COLD, JITTER = Attitude(), Attitude().jitter
KNOWN = Attitude(LEAN.tilt, LEAN.roll, 1e-4, 1e-4)
PANS = [-1.5, -0.4, 0.9]
WORLD = np.random.default_rng(3).standard_normal((20, 3))


def through(pan: float) -> np.ndarray:
    """Return the scene as the camera sees it with its joint at ``pan``."""
    return WORLD @ LEAN.R_world_camera(Pose(0.0, 0.0, pan))


def seen(pan: float, photograph: float = 0.0) -> Observation:
    head = PanTiltHead(HeadLimits(photograph=Joints(photograph)))
    view = Observation(0, through(pan), through(photograph), 769.0)
    return view.on_rig(head, Joints(pan))


@pytest.mark.parametrize('pan', PANS)
def test_rays_of_a_known_lean_are_those_of_the_virtual_camera(pan: float) -> None:
    view = levelled(seen(pan, photograph=0.3), KNOWN, COLD)
    virtual = through(0.0)
    for rays in (view.current, view.desired):
        np.testing.assert_allclose(rays, virtual, atol=2e-5)
    assert np.abs(seen(pan).current - virtual).max() > 0.01


def test_a_lean_that_nobody_knows_changes_no_ray() -> None:
    view = seen(0.9)
    np.testing.assert_allclose(levelled(view, COLD, COLD).current, view.current, atol=1e-12)


@pytest.mark.parametrize('pan', PANS)
def test_jitter_grows_with_the_doubt_and_the_turn_of_the_head(pan: float) -> None:
    known = with_jitter(KNOWN, seen(pan)).jitter
    assert known == pytest.approx(JITTER, rel=0.02)
    doubtful = with_jitter(replace(KNOWN, tilt_deviation=0.5), seen(pan)).jitter
    turned = 2.0 * abs(math.sin(0.5 * pan)) * UNTOLD
    assert doubtful == pytest.approx(math.hypot(JITTER, turned), rel=0.02)


def test_where_the_photograph_was_taken_and_without_a_head_the_floor_alone_counts() -> None:
    assert with_jitter(COLD, seen(0.3, photograph=0.3)).jitter == pytest.approx(JITTER)
    fixed = Observation(0, WORLD, WORLD, 769.0)
    assert with_jitter(COLD, fixed) is COLD
    assert levelled(fixed, KNOWN, COLD) is fixed


def test_at_rest_all_axes_are_those_of_the_camera() -> None:
    np.testing.assert_array_equal(HEAD.rays(WORLD, AT_REST), WORLD)
