"""Interruptions leave a robot that stands, in the right phase; how it resumes after them."""

from dataclasses import replace
import math

import numpy as np
import pytest
from servo_states import BEARINGS, in_phase, PHASES, seeing, SETTINGS, sight, then

from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.estimate.map_state import MapState
from visual_servo_epipolar.core.geometry.motion import Pose, STANDSTILL, Twist
from visual_servo_epipolar.core.goal import Goal, NO_GOAL
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.laws.standing import RESUMING_FRAMES
from visual_servo_epipolar.core.odometry.legs import Leg
from visual_servo_epipolar.core.rigs.rig import AT_REST, Command
from visual_servo_epipolar.core.servo.run import change_goal, interrupted, Interruption, Run
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import classify, update
from visual_servo_epipolar.core.twoview.estimator import UNKNOWN_COVARIANCE
from visual_servo_epipolar.core.twoview.memory import fresh_memory
from visual_servo_epipolar.core.twoview.observation import observe
from visual_servo_epipolar.core.twoview.perceive import Perception
from visual_servo_epipolar.simulation.cameras import CameraSettings
from visual_servo_epipolar.simulation.point_world import PointSettings, PointWorld
from visual_servo_epipolar.simulation.rigs import SimulatedRig

MOVE = Command(Twist(0.2, 0.1))


@pytest.mark.parametrize('kind', Interruption)
@pytest.mark.parametrize('phase', PHASES)
def test_after_any_interruption_the_robot_stands(phase: Phase, kind: Interruption) -> None:
    state = in_phase(phase, measurement=sight(30), command=MOVE)
    assert interrupted(state, kind, 'a reason').twist == STANDSTILL


@pytest.mark.parametrize('phase', PHASES)
def test_tracks_that_stay_away_make_a_robot_hold_that_drives(phase: Phase) -> None:
    state = interrupted(in_phase(phase, measurement=sight(30)), Interruption.LOST, 'no new tracks')
    if phase.drives:
        assert (state.phase, state.reason) == (Phase.HOLDING, 'no new tracks')
        assert state.run.phase_start_ns == sight(30).stamp_ns
    elif phase is not Phase.WAITING:
        assert state.phase is phase


@pytest.mark.parametrize(
    ('phase', 'kind', 'after', 'newest'),
    [
        (Phase.HOLDING, Interruption.TIMED_OUT, Phase.FAILED, True),
        (Phase.WAITING, Interruption.TIMED_OUT, Phase.WAITING, False),
        (Phase.ARRIVED, Interruption.TIMED_OUT, Phase.ARRIVED, False),
        (Phase.FAILED, Interruption.TIMED_OUT, Phase.FAILED, False),
        (Phase.HOLDING, Interruption.LOST, Phase.HOLDING, True),
        (Phase.FAILED, Interruption.LOST, Phase.FAILED, False),
    ],
)
def test_no_run_holds_for_ever_and_one_that_has_ended_keeps_its_reason(
    phase, kind, after, newest
) -> None:
    state = interrupted(in_phase(phase, reason='its own'), kind, 'a new one')
    assert (state.phase, state.reason) == (after, 'a new one' if newest else 'its own')


@pytest.mark.parametrize('phase', PHASES)
def test_a_run_keeps_to_the_goal_that_it_began_with(phase: Phase) -> None:
    begun = change_goal(in_phase(phase, measurement=sight(30)), 7)
    assert begun.goal.id == 7
    assert begun.view.measurement is not None  # the first to be told is no change
    assert change_goal(begun, NO_GOAL) is begun
    assert not Run(begun).other_goal(None)
    after = change_goal(begun, 8)
    assert bool(Run(begun).other_goal(8)) == phase.runs
    assert after.goal.id == (7 if phase.runs else 8)
    assert (after is begun) == phase.runs


def test_another_goal_has_no_map_yet() -> None:
    learnt = in_phase(Phase.WAITING, goal=Goal(7, map=MapState(few_s=3.0)), measurement=sight(30))
    after = change_goal(learnt, 8)
    assert (after.goal, after.measurement) == (Goal(8), None)
    assert change_goal(learnt, 7).map.few_s == 3.0


@pytest.mark.parametrize('phase', PHASES)
def test_a_run_keeps_to_the_camera_that_it_began_with(phase: Phase) -> None:
    first, second = (
        Camera(640, 480, 500.0, 500.0, 320.0, 240.0),
        Camera(64, 48, 50.0, 50.0, 32, 24),
    )
    after = Run(in_phase(phase), camera=first).with_camera(second)
    assert after.camera == (first if phase.runs else second)
    assert ('camera_info has changed' in after.other_camera(second)) == phase.runs
    assert Run(in_phase(phase)).with_camera(second).camera == second


@pytest.mark.parametrize('told', [True, False])
def test_without_the_angles_of_its_head_a_robot_stands(told: bool) -> None:
    settings = ServoSettings(law='smooth', rig='pan_tilt')
    camera = CameraSettings().camera
    world = PointWorld(PointSettings(), SimulatedRig(camera), seed=0)
    session = Run(camera=camera, started=True)
    for number in range(4):
        features = world.observe(Pose.from_start(1.0, -3.5, 8.0), number)
        seen = observe(features, camera, (number + 1) * 90_909_091)
        if told:
            seen = seen.on_rig(settings.carrier, AT_REST)
        session = session.decide(seen, settings).update_map()
    assert (session.state.twist != STANDSTILL) is told
    assert told or session.state.phase is Phase.WAITING


THERE = sight()
LONG = RESUMING_FRAMES * SETTINGS.arrival_frames


def held(turned: float, frames: int, before: float | None = None) -> Event:
    heading = THERE.heading_error - turned if before is None else before
    state = in_phase(Phase.HOLDING, measurement=THERE, settled=frames, trusted_heading=heading)
    return classify(state, SETTINGS)


@pytest.mark.parametrize('turned', [0.0, 0.9, -0.9, 2.0 * math.pi])
def test_a_robot_that_stands_as_it_stood_goes_on_soon(turned: float) -> None:
    assert held(turned, RESUMING_FRAMES - 1) is Event.NOTHING
    assert held(turned, RESUMING_FRAMES) is not Event.NOTHING
    assert held(turned, RESUMING_FRAMES, before=math.nan) is not Event.NOTHING  # it never drove


@pytest.mark.parametrize('turned', [1.1, -2.4, math.pi])
def test_one_that_was_turned_has_to_show_it_for_longer(turned: float) -> None:
    """In mirrored images three in a row may agree on a geometry; somebody may turn the robot."""
    assert held(turned, LONG - 1) is Event.NOTHING
    assert held(turned, LONG) is not Event.NOTHING


def seen(state: ServoState, **changes: object) -> float:
    measurement = sight(2, **changes)
    perception = Perception(measurement, fresh_memory(SETTINGS))
    return update(state, perception, 0.1, SETTINGS).measurement.trusted_heading


def test_the_heading_is_that_of_trusted_sights_of_who_drives() -> None:
    driving = in_phase(Phase.MATCHING_FEATURES)
    assert seen(driving) == THERE.heading_error
    known, before = seeing(driving, trusted_heading=THERE.heading_error), THERE.heading_error
    assert seen(known, heading_error=before + 0.5) != before
    assert seen(known, heading_error=before + 1.5) == before
    assert seen(known, bearings=None, parallax=1.0) == before
    held = in_phase(Phase.HOLDING, trusted_heading=0.7)
    assert seen(held) == 0.7


ASIDE = replace(BEARINGS, psi=-0.1, phi=-0.1 - math.pi / 2.0)
NO_ESTIMATE = sight(bearings=None, difference=math.nan, reason='two geometries fit')


def test_backing_off_goes_on_counting_after_tracks_were_lost() -> None:
    state = then(in_phase(Phase.RETREATING, travel=-9.5, reversed=9.5), NO_ESTIMATE)
    assert state.phase is Phase.HOLDING
    aside = sight(2, bearings=ASIDE)
    for number in range(RESUMING_FRAMES):
        assert state.phase is Phase.HOLDING
        state = then(state, replace(aside, stamp_ns=sight(2 + number).stamp_ns))
    assert state.phase is Phase.RETREATING
    assert (state.run.travel, state.motion.reversed) == (pytest.approx(-9.5), 9.5)


def test_who_backs_off_begins_a_way_of_his_own() -> None:
    aside = sight(bearings=ASIDE)
    leg = Leg(0.3, 1.0)
    state = then(in_phase(Phase.ZEROING_EPIPOLES, leg=leg), aside)
    assert state.phase is Phase.RETREATING
    assert state.law.leg is None


def test_an_estimator_without_covariance_tells_nothing_of_the_mount() -> None:
    settings = replace(SETTINGS, camera_forward=0.2, camera_yaw=0.1)
    blind = {'deviation': math.nan, 'covariance': UNKNOWN_COVARIANCE}
    state = ServoState()
    for frame in range(1, 30):
        state = then(state, sight(frame, **blind), settings)
        assert np.isfinite(state.identified.extrinsics.mean).all()
    assert state.phase is not Phase.HOLDING
