"""What a way shows to the check of the motion; and when nobody sets off by the camera."""

from dataclasses import replace

import numpy as np
import pytest
from servo_states import goal, in_phase, SETTINGS, sight
from strategies import blurred, matches, through_lens

from visual_servo_epipolar.core.estimate.base_model import Curvature
from visual_servo_epipolar.core.estimate.dead_band import DeadBand, Threshold
from visual_servo_epipolar.core.estimate.map_state import MapState
from visual_servo_epipolar.core.estimate.motion_check import MotionCheck
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.geometry.rays import normalised
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.rigs.rig import HALT
from visual_servo_epipolar.core.servo.checking import check_lens, check_motion, parallax_of_way
from visual_servo_epipolar.core.servo.state import Identification, Known, ServoState
from visual_servo_epipolar.core.servo.supervisor import step
from visual_servo_epipolar.core.twoview.observation import Observation


def seen(count: int) -> Observation:
    rays = np.tile([0.28, 0.0, 0.96], (count, 1))
    return Observation(10**8, rays, rays, 769.0, ids=np.arange(count))


def test_a_metre_shows_the_part_of_the_parallax_that_it_is_of_the_distance() -> None:
    near, far = shown(seen(20)), shown(seen(20), distance=80.0)
    assert near > 3.9 * far > 0.0  # a distance beyond initial_distance, 8 m, counts as that
    # None is expected near the goal, or by no feature.
    assert shown(seen(20), parallax=1e-4) == shown(seen(0), bearings=None) == 0.0


def shown(seen: Observation, distance: float = 2.0, **changes: object) -> float:
    """Return what a metre shows of parallax while the robot backs off [rad/m]."""
    state = in_phase(Phase.RETREATING, distance=distance)
    return parallax_of_way(
        state, goal(sight(**{'parallax': 0.08, **changes}), state), seen, SETTINGS
    )


def test_from_afar_where_the_scene_looks_small_a_way_shows_less() -> None:
    across = np.linspace(-0.4, 0.4, 20)
    desired = normalised(np.column_stack([across, 0.1 * across, np.ones(20)]))
    current = normalised(np.column_stack([0.25 * across, 0.025 * across, np.ones(20)]))
    near, far = (
        shown(Observation(10**8, rays, desired, 769.0, ids=np.arange(20)))
        for rays in (desired, current)
    )
    assert far < 0.3 * near


def test_what_was_learnt_of_the_base_as_it_stood_survives_a_hold() -> None:
    before, learnt = Identification(), DeadBand(angular=Threshold(0.085))
    standing = Known(MapState(), before)
    state = in_phase(
        Phase.ORIENTING,
        measurement=sight(),
        identified=replace(before, dead_band=learnt, curvature=Curvature(0.1)),
        check=MotionCheck(trouble='the base does not follow', troubled_ns=sight().stamp_ns),
        known=(standing, standing),
    )
    held = check_motion(state, replace(seen(20), stamp_ns=sight().stamp_ns), 0.1, SETTINGS)
    assert held.identified.curvature == before.curvature
    assert held.identified.dead_band == learnt


def told_as(scale: float) -> Observation:
    """Return views of a camera whose focal length is told ``scale`` times as long."""
    rng = np.random.default_rng(0)
    views = matches(Pose.from_start(1.0, -3.5, 8.0), count=120)
    seen = [through_lens(blurred(rays, 0.2 / 769.0, rng), 1.0 / scale) for rays in views]
    return Observation(10**8, *seen, scale * 769.0)


@pytest.mark.parametrize('scale', [1.0, 2.0])
def test_no_robot_sets_off_by_a_focal_length_that_the_matches_contradict(scale: float) -> None:
    state = step(ServoState(), told_as(scale), SETTINGS)
    if scale == 1.0:
        assert state.phase is Phase.DISPLACING
        return
    assert (state.phase, state.command) == (Phase.HOLDING, HALT)
    assert state.reason.startswith('the matches contradict the camera: a focal length of')


def test_a_retreat_is_not_begun_by_such_a_focal_length_either() -> None:
    wrong, driving = told_as(0.5), in_phase(Phase.ZEROING_EPIPOLES, measurement=sight())
    state, event = check_lens(driving, wrong, Event.SIDEWAYS, SETTINGS)
    assert event is Event.LOST
    assert state.measurement.reason.startswith('the matches contradict the camera')
    assert check_lens(driving, wrong, Event.ALIGNED, SETTINGS) == (driving, Event.ALIGNED)
