"""Runs on a base that does not follow, or follows somebody else; and cameras the wrong way up."""

from collections.abc import Callable
from dataclasses import replace

from durations import few_of
import numpy as np
import pytest

from visual_servo_epipolar.commands.arguments import scenario_path
from visual_servo_epipolar.core.geometry.motion import Pose, STANDSTILL, Twist
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.rigs.rig import Command, HALT
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.simulation.closed_loop import Loop, View
from visual_servo_epipolar.simulation.scenario import load
from visual_servo_epipolar.simulation.sensor import CameraMotion, STILL
from visual_servo_epipolar.simulation.views import points_of

START = (0.11, -2.2, 5.4)
Interfere = Callable[[float, Command], Command]  # by the time [s] and what the servo commands


class DisturbedLoop(Loop):
    """A loop between whose servo and base somebody interferes; keeps all states and poses."""

    def __init__(
        self, interfere: Interfere, seconds: float, flip: tuple[bool, bool] = (False, False)
    ) -> None:
        scenario = load(scenario_path('nominal')).seeded(1)
        camera = scenario.camera.nominal_camera
        view: View = points_of(scenario, 1)
        if any(flip):
            view = FlippedView(view, (camera.width, camera.height), flip)
        settings = replace(scenario.loop(START, 1), max_duration=seconds)
        super().__init__(settings, view, camera)
        self._interfere, self.states, self.poses = (
            interfere,
            list[ServoState](),
            [self.driven.pose],
        )
        self.run()

    def drive(self) -> None:
        self.driven.drive(self._interfere(self.driven.now_ns / 1e9, self._run.state.command))
        self.states.append(self._run.state)
        self.poses.append(self.driven.pose)

    @property
    def held_s(self) -> float:
        """When it was held first, in seconds."""
        return next(
            sample.stamp_ns / 1e9
            for sample in self.monitor.samples
            if sample.phase is Phase.HOLDING
        )


class FlippedView:
    """What a camera sees whose images, photograph and all, are mirrored or upside down."""

    def __init__(self, view: View, size: tuple[int, int], flip: tuple[bool, bool]) -> None:
        self._view, self._size, self._flip = view, np.array(size) - 1.0, np.array(flip)

    def observe(self, pose: Pose, frame: int, motion: CameraMotion = STILL) -> Features:
        seen = self._view.observe(pose, frame, motion)
        current, desired = (
            np.where(self._flip, self._size - pixels, pixels)
            for pixels in (seen.current, seen.desired)
        )
        return replace(seen, current=current, desired=desired)


def obeyed(time_s: float, command: Command) -> Command:
    return command


def deaf_from(begin_s: float) -> Interfere:
    return lambda time_s, command: HALT if time_s >= begin_s else command


def joystick(begin_s: float, seconds: float, twist: Twist) -> Interfere:
    def interfere(time_s: float, command: Command) -> Command:
        return Command(twist) if begin_s <= time_s < begin_s + seconds else command

    return interfere


@pytest.mark.parametrize('begin_s', few_of([4.0, 0.0, 9.0]))
def test_a_base_that_does_not_follow_is_held_and_the_run_fails_soon(begin_s: float) -> None:
    loop = DisturbedLoop(deaf_from(begin_s), 40.0)
    assert loop.held_s - begin_s < 6.0
    last = loop.states[-1]
    assert last.phase is Phase.FAILED
    assert 'the base does not follow' in last.reason


def test_a_stranger_is_held_against_teaches_nothing_and_the_run_goes_on_when_he_is_gone() -> None:
    # A turn by a third of a radian, back again: the goal stays in view.
    def interfere(time_s: float, command: Command) -> Command:
        if not 6.0 <= time_s < 7.4:
            return command
        return Command(Twist(0.0, 0.5 if time_s < 6.7 else -0.5))

    loop = DisturbedLoop(interfere, 120.0)
    assert 6.0 < loop.held_s < 7.0
    held = [state for state in loop.states if state.phase is Phase.HOLDING]
    assert 'something else publishes cmd_vel' in held[0].reason
    undisturbed = [state for state in loop.states[:66] if state.phase is not Phase.HOLDING]
    for state in held:
        usual = undisturbed[30].identified.curvature.value
        assert abs(state.identified.curvature.value - usual) < 0.01
        assert state.identified.delay.value == 0.0
    assert loop.states[-1].phase is Phase.ARRIVED
    assert loop.driven.pose.distance < 0.005


def mixed(begin_s: float, seconds: float, twist: Twist) -> Interfere:
    """Return what a base does that obeys two in turns: a third of what the servo commands."""

    def interfere(time_s: float, command: Command) -> Command:
        if not begin_s <= time_s < begin_s + seconds:
            return command
        linear, angular = 0.35 * command.twist.linear, 0.35 * command.twist.angular
        return Command(Twist(linear + twist.linear, angular + twist.angular))

    return interfere


@pytest.mark.parametrize(
    'interfere',
    few_of(
        [
            joystick(4.0, 4.0, STANDSTILL),
            joystick(3.0, 4.0, Twist(0.0, 0.13)),
            mixed(2.5, 3.0, Twist(0.0, 0.3)),
            mixed(2.5, 3.0, Twist(0.0, -0.3)),
        ],
        keep=(1, 2),
    ),
    ids=['stands', 'turned', 'mixed', 'mixed right'],
)
def test_a_way_that_was_not_commanded_teaches_no_mount(interfere: Interfere) -> None:
    loop = DisturbedLoop(interfere, 60.0)
    phases = [state.phase for state in loop.states]
    assert Phase.HOLDING in phases and Phase.RETREATING not in phases
    assert phases[-1] is Phase.ARRIVED and loop.driven.pose.distance < 0.005
    yaws = [
        state.identified.extrinsics.mount[0]
        for state in loop.states
        if state.identified.extrinsics is not None
    ]
    assert np.abs(yaws).max() < np.radians(3.0)  # of a camera that looks straight ahead


def test_a_joystick_that_turns_the_robot_away_does_not_make_it_drive() -> None:
    loop = DisturbedLoop(joystick(4.0, 4.0, Twist(0.0, 0.3)), 30.0)
    assert loop.held_s - 4.0 < 1.5
    after = [state for state in loop.states if state.measurement.stamp_ns > 5.5e9]
    assert all(state.command == HALT for state in after if state.phase is Phase.HOLDING)
    assert max(pose.distance for pose in loop.poses) < 1.1 * loop.poses[0].distance


@pytest.mark.parametrize('mirrored', few_of([False, True]))
def test_a_camera_the_wrong_way_round_stops_the_robot_after_some_degrees(mirrored: bool) -> None:
    loop = DisturbedLoop(obeyed, 30.0, (True, not mirrored))
    first = next(state for state in loop.states if state.phase is Phase.HOLDING)
    assert 'the image turns against the command: upside down or mirrored' in first.reason
    assert loop.states[-1].phase is Phase.FAILED
    turned = max(abs(pose.theta - loop.poses[0].theta) for pose in loop.poses)
    assert turned < np.radians(30.0)  # half a second at 0.5 rad/s, and braking
    assert loop.driven.pose.distance == pytest.approx(loop.poses[0].distance)
