"""Commands of the last seconds, and what a base does that obeys them late."""

from dataclasses import replace

import numpy as np
import pytest
from servo_states import in_phase

from visual_servo_epipolar.core.estimate.base_model import Delay
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.laws.command import Command
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.odometry.commands_sent import CommandsSent, KEPT_S, WITHDRAWN_S
from visual_servo_epipolar.core.servo.session import interrupted, Interruption

SECOND = 1_000_000_000
LEFT, RIGHT = Twist(0.2, 1.0), Twist(0.0, -0.5)


def sent() -> CommandsSent:
    """Left for a second from 10 s, then right."""
    return CommandsSent().after(10 * SECOND, LEFT).after(11 * SECOND, RIGHT)


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
    between = int(begin * SECOND), int(end * SECOND)
    turns = sent().turns(*between, np.array([delay]))
    assert turns[0] == pytest.approx(turned)
    spans = sent().acting(*between, delay)
    assert sum(span for span, _ in spans) == pytest.approx(end - begin)
    assert sum(span * twist.angular for span, twist in spans) == pytest.approx(turned)
    mean = sent().mean(*between, delay)
    assert mean.angular * (end - begin) == pytest.approx(turned)


def test_spans_come_in_their_order() -> None:
    spans = sent().acting(int(9.5 * SECOND), int(11.5 * SECOND), 0.0)
    assert [twist for _, twist in spans] == [STANDSTILL, LEFT, RIGHT]
    assert [span for span, _ in spans] == pytest.approx([0.5, 1.0, 0.5])


def test_nothing_sent_is_standstill() -> None:
    nothing = CommandsSent()
    assert nothing.mean(0, SECOND, 0.3) == STANDSTILL
    assert nothing.mean(SECOND, SECOND, 0.3) == STANDSTILL
    assert nothing.turns(0, SECOND, np.zeros(3)).tolist() == [0.0] * 3


def test_only_the_last_seconds_are_kept() -> None:
    commands = CommandsSent()
    for k in range(200):
        commands = commands.after(k * SECOND // 10, LEFT)
    assert len(commands.stamps) == len(commands.twists) == 10 * KEPT_S + 1


def test_a_clock_that_leaps_back_begins_anew() -> None:
    leapt = sent().after(5 * SECOND, LEFT)
    assert leapt.stamps == (5 * SECOND,)


def withdrawn() -> CommandsSent:
    return replace(sent(), withdrawn=True)


@pytest.mark.parametrize(('images_again', 'acted'), [(0.2, 0.2), (0.4, 0.4), (2.0, WITHDRAWN_S)])
def test_a_command_that_is_withdrawn_acts_until_then(images_again, acted) -> None:
    """Tracks stop coming, and the robot is told to stand: no more of it is to be driven ahead."""
    stopped = withdrawn().resumed(round((11 + images_again) * SECOND))
    turns = stopped.turns(11 * SECOND, 15 * SECOND, np.zeros(1))
    assert turns[0] == pytest.approx(acted * RIGHT.angular)
    assert not stopped.withdrawn
    then = stopped.after(round((11 + images_again) * SECOND), LEFT)
    assert then.twists == (LEFT, RIGHT, STANDSTILL, LEFT)


def test_what_was_not_withdrawn_goes_on() -> None:
    assert sent().resumed(12 * SECOND) == sent()
    assert CommandsSent(withdrawn=True).resumed(SECOND) == CommandsSent()
    assert withdrawn().resumed(11 * SECOND) == CommandsSent()


@pytest.mark.parametrize('kind', [Interruption.HALTED, Interruption.LOST, Interruption.STOPPED])
def test_a_halted_servo_knows_that_its_command_is_withdrawn(kind) -> None:
    state = in_phase(Phase.ZEROING_EPIPOLES, sent=sent(), command=Command(RIGHT))
    assert interrupted(state, kind, 'why').motion.sent == withdrawn()


def test_the_next_run_is_of_the_same_base() -> None:
    state = in_phase(Phase.ZEROING_EPIPOLES, delay=Delay(0.5))
    assert interrupted(state, Interruption.STOPPED).identified.delay is state.identified.delay
    assert interrupted(state, Interruption.RESET).identified.delay.value == 0.0


def test_a_robot_rests_from_the_first_command_to_stand() -> None:
    still = sent().after(12 * SECOND, STANDSTILL).after(13 * SECOND, STANDSTILL)
    assert still.rest_s(14 * SECOND) == 2.0
    assert sent().rest_s(14 * SECOND) == 0.0
