"""Interruptions: whatever comes from outside leaves a robot that stands, in the right phase."""

import pytest
from servo_states import in_phase, PHASES, sight

from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.estimate.map_state import MapState
from visual_servo_epipolar.core.geometry.motion import Pose, STANDSTILL, Twist
from visual_servo_epipolar.core.goal import Goal, NO_GOAL
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.rigs.rig import AT_REST, Command
from visual_servo_epipolar.core.servo.run import change_goal, interrupted, Interruption, Run
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.twoview.observation import observe
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
