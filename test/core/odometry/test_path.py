"""The driven path: where the base was at an image, how far off that is, when it begins anew."""

from dataclasses import replace
import math

import numpy as np
import pytest
from servo_states import in_phase

from visual_servo_epipolar.core.estimate.base_model import Delay
from visual_servo_epipolar.core.geometry.motion import (
    compose,
    integrate,
    inverse_pose,
    Pose,
    relative_pose,
    STANDSTILL,
    Twist,
)
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.odometry.commands_sent import CommandsSent, WITHDRAWN_S
from visual_servo_epipolar.core.odometry.path import Path
from visual_servo_epipolar.core.rigs.rig import Command
from visual_servo_epipolar.core.servo.run import interrupted, Interruption
from visual_servo_epipolar.core.stamps import KEPT_S

S = 1_000_000_000


def test_motions_and_their_inverses_cancel() -> None:
    one, other = np.array([1.0, -2.0, 0.7]), np.array([-0.3, 0.4, 2.8])
    assert compose(one, inverse_pose(one)) == pytest.approx(np.zeros(3), abs=1e-12)
    assert compose(one, relative_pose(one, other)) == pytest.approx(other)


def test_between_two_messages_it_lies_between() -> None:
    path = Path()
    path.add_pose(0, Pose(0.0, 0.0, math.pi - 0.1))
    path.add_pose(S // 10, Pose(0.1, 0.0, -math.pi + 0.1))
    place = path.at(S // 20)
    assert place.pose[:2] == pytest.approx([0.05, 0.0])
    assert math.cos(place.pose[2]) == pytest.approx(-1.0)


def test_beyond_its_ends_it_does_not_guess() -> None:
    path = Path()
    assert path.at(0) is None
    path.add_pose(S, Pose(0.0, 0.0, 0.0))
    assert path.at(S - 1) is None
    assert path.at(S + 1) is None
    assert path.at(S).stamp_ns == S


@pytest.mark.parametrize(
    ('stamp_ns', 'pose'),
    [
        (S, Pose(1e-3, 0.0, 0.0)),
        (S // 2, Pose(0.0, 0.0, 0.0)),
        (3 * S, Pose(0.0, 0.0, 0.0)),
        (S + S // 10, Pose(2.0, 0.0, 0.0)),
        (S + S // 10, Pose(0.0, 0.0, 2.0)),
    ],
    ids=['repeated', 'back', 'gap', 'leap', 'spin'],
)
def test_odometry_that_cannot_be_begins_anew(stamp_ns, pose) -> None:
    path = Path()
    path.add_pose(S, Pose(0.0, 0.0, 0.0))
    path.add_pose(stamp_ns, pose)
    assert path.at(stamp_ns).epoch == 1


@pytest.mark.parametrize(
    ('apart', 'hertz', 'two'),
    [
        (0.04, 100, True),
        (0.04, 10, True),
        (0.012, 100, True),
        (0.008, 100, False),
        (0.04, 5, False),
    ],
)
def test_a_base_does_not_swing_as_two_sources_do(apart: float, hertz: int, two: bool) -> None:
    """To and fro by 4 cm in 0.4 s takes 2 m/s^2, in 0.2 s 8; what is below 1 cm is noise."""
    path = Path('/odom')
    ruptures = [path.add_pose(k * S // hertz, Pose(apart * (k % 2), 0.0, 0.0)) for k in range(10)]
    assert (
        any(text.startswith(f'/odom goes to and fro by {apart:.2f} m') for text in ruptures) is two
    )
    assert (path.epoch > 0) is two


@pytest.mark.parametrize(
    'stamps',
    [[k * S // 50 + k % 2 * S // 80 for k in range(100)], [k // 2 * S // 10 for k in range(6)]],
    ids=['uneven', 'each twice'],
)
def test_stamps_that_come_unevenly_or_twice_are_of_one_source(stamps) -> None:
    path = Path()
    for stamp_ns in stamps:
        assert path.add_pose(stamp_ns, Pose(1e-9 * stamp_ns, 0.0, 0.0)) == ''
    assert path.at(S // 5).pose[0] == pytest.approx(0.2)


def test_another_frame_is_of_another_source() -> None:
    path = Path('/odom')
    path.add_pose(S, Pose(0.0, 0.0, 0.0), 'odom')
    words = '/odom is in the frame map, was in odom before'
    assert path.add_pose(S + S // 10, Pose(0.0, 0.0, 0.0), 'map') == path.rupture == words
    assert path.frame == 'map'


def test_commands_are_obeyed_until_the_next_one_or_the_timeout() -> None:
    path = Path(ahead=math.inf, command_timeout=0.5)
    path.add_twist(0, Twist(1.0, 0.0))
    path.add_twist(S // 4, Twist(0.0, 1.0))
    assert path.at(S // 8).pose == pytest.approx([0.125, 0.0, 0.0])
    assert path.at(S // 2).pose == pytest.approx([0.25, 0.0, 0.25])
    assert path.at(5 * S).pose == pytest.approx([0.25, 0.0, 0.5])
    path.add_twist(6 * S, STANDSTILL)
    assert path.at(7 * S).pose == pytest.approx([0.25, 0.0, 0.5])


def test_odometry_goes_on_as_it_did_for_a_while() -> None:
    path, twist = Path(ahead=0.1), Twist(0.4, 0.5)
    for k in range(3):
        path.add_pose(k * S // 20, integrate(Pose(1.0, 2.0, 3.0), twist, k / 20))
    after = integrate(Pose(1.0, 2.0, 3.0), twist, 0.15)
    predicted = path.at(3 * S // 20).pose
    assert predicted[:2] == pytest.approx([after.x, after.y])
    assert math.cos(predicted[2] - after.theta) == pytest.approx(1.0)
    assert path.at(S // 4) is None
    path.add_pose(S // 5, Pose(50.0, 0.0, 0.0))  # before a leap it did something else
    assert path.at(S // 4).pose == pytest.approx([50.0, 0.0, 0.0])


def test_old_places_are_forgotten() -> None:
    path = Path()
    for k in range(1000):
        path.add_pose(k * S // 20, Pose(0.0, 0.0, 0.0))
    assert path.at(0) is None


LEFT, RIGHT = Twist(0.2, 1.0), Twist(0.0, -0.5)


def sent() -> CommandsSent:
    """Left for a second from 10 s, then right."""
    return CommandsSent().after(10 * S, LEFT).after(11 * S, RIGHT)


@pytest.mark.parametrize(
    ('begin', 'end', 'delay', 'turned'),
    [
        (10.0, 11.0, 0.0, 1.0),
        (10.5, 11.5, 0.0, 0.25),
        (10.5, 11.5, 0.5, 1.0),
        (11.0, 12.0, 0.25, 0.25 - 0.375),
        (9.0, 10.5, 0.25, 0.25),  # nothing was commanded before
        (9.0, 10.0, 0.0, 0.0),
    ],
)
def test_turns_and_spans_agree(begin, end, delay, turned) -> None:
    between = int(begin * S), int(end * S)
    turns = sent().turns(*between, np.array([delay]))
    assert turns[0] == pytest.approx(turned)
    spans = sent().acting(*between, delay)
    assert sum(span for span, _ in spans) == pytest.approx(end - begin)
    assert sum(span * twist.angular for span, twist in spans) == pytest.approx(turned)
    mean = sent().mean(*between, delay)
    assert mean.angular * (end - begin) == pytest.approx(turned)


def test_spans_come_in_their_order_and_nothing_sent_is_standstill() -> None:
    nothing = CommandsSent()
    assert nothing.mean(0, S, 0.3) == nothing.mean(S, S, 0.3) == STANDSTILL
    assert nothing.turns(0, S, np.zeros(3)).tolist() == [0.0] * 3
    spans = sent().acting(int(9.5 * S), int(11.5 * S), 0.0)
    assert [twist for _, twist in spans] == [STANDSTILL, LEFT, RIGHT]
    assert [span for span, _ in spans] == pytest.approx([0.5, 1.0, 0.5])


def test_only_the_last_seconds_are_kept() -> None:
    commands = CommandsSent()
    for k in range(200):
        commands = commands.after(k * S // 10, LEFT)
    assert len(commands.stamps) == len(commands.twists) == 10 * KEPT_S + 1
    assert commands.after(5 * S, LEFT).stamps == (5 * S,)  # the clock leaps back


def withdrawn() -> CommandsSent:
    return replace(sent(), withdrawn=True)


@pytest.mark.parametrize(('images_again', 'acted'), [(0.2, 0.2), (0.4, 0.4), (2.0, WITHDRAWN_S)])
def test_a_command_that_is_withdrawn_acts_until_then(images_again, acted) -> None:
    """Tracks stop coming, and the robot is told to stand: no more of it is to be driven ahead."""
    stopped = withdrawn().resumed(round((11 + images_again) * S))
    turns = stopped.turns(11 * S, 15 * S, np.zeros(1))
    assert turns[0] == pytest.approx(acted * RIGHT.angular)
    assert not stopped.withdrawn
    then = stopped.after(round((11 + images_again) * S), LEFT)
    assert then.twists == (LEFT, RIGHT, STANDSTILL, LEFT)


def test_what_was_not_withdrawn_goes_on() -> None:
    assert sent().resumed(12 * S) == sent()
    assert CommandsSent(withdrawn=True).resumed(S) == CommandsSent()
    assert withdrawn().resumed(11 * S) == CommandsSent()


@pytest.mark.parametrize('kind', [Interruption.HALTED, Interruption.LOST, Interruption.STOPPED])
def test_a_halted_servo_knows_that_its_command_is_withdrawn(kind) -> None:
    state = in_phase(Phase.ZEROING_EPIPOLES, sent=sent(), command=Command(RIGHT))
    assert interrupted(state, kind, 'why').motion.sent == withdrawn()


def test_the_next_run_is_of_the_same_base() -> None:
    state = in_phase(Phase.ZEROING_EPIPOLES, delay=Delay(0.5))
    assert interrupted(state, Interruption.STOPPED).identified.delay is state.identified.delay
    assert interrupted(state, Interruption.RESET).identified.delay.value == 0.0


def test_a_robot_rests_from_the_first_command_to_stand() -> None:
    still = sent().after(12 * S, STANDSTILL).after(13 * S, STANDSTILL)
    assert still.rest_s(14 * S) == 2.0
    creeping = still.after(14 * S, Twist(0.01, -0.02))
    assert creeping.rest_s(15 * S) == 0.0
    assert creeping.rest_s(15 * S, Twist(0.02, 0.03)) == 3.0
    assert creeping.rest_s(15 * S, Twist(0.02, 0.01)) == 0.0
    assert sent().rest_s(14 * S) == 0.0


@pytest.mark.parametrize(
    ('speeds', 'begin_s', 'pause', 'reversals', 'swing_s'),
    [
        pytest.param([0.1, -0.1, -0.1, 0.1], 0.0, math.inf, 2, 1.0, id='two reversals'),
        pytest.param([0.1, -0.1, -0.1, 0.1], 0.0, math.inf, 3, 0.0, id='fewer than asked for'),
        pytest.param([0.1, -0.1, -0.1, 0.1], 0.5, math.inf, 2, 0.0, id='one before the begin'),
        pytest.param([0.1, -0.1, 0.0, 0.0, 0.1], 0.0, math.inf, 2, 1.5, id='a stand between'),
        pytest.param([0.1, -0.1, 0.0, 0.0, 0.1], 0.0, 1.0, 2, 0.0, id='a pause between'),
        pytest.param([0.1, -0.01, 0.1, 0.1], 0.0, math.inf, 2, 0.0, id='too slow to count'),
    ],
)
def test_a_swing_is_the_time_between_its_reversals(
    speeds, begin_s, pause, reversals, swing_s
) -> None:
    sent, begin_ns = CommandsSent(), round(begin_s * S)
    for half, speed in enumerate(speeds):
        sent = sent.after(half * S // 2, Twist(speed, 0.0))
    seen = sent.swing_s(0.02, begin_ns=begin_ns, pause=pause, reversals=reversals)
    assert seen == pytest.approx(swing_s)
