"""Laws go by where the robot will be when it obeys, where it obeys late."""

from dataclasses import replace
import math

import pytest
from servo_states import in_phase, MEMORY, seeing, sight

from visual_servo_epipolar.core.estimate.goal_estimate import GoalEstimate
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import integrate, Pose, STANDSTILL, Twist
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.laws.prediction import BORNE, predicted
from visual_servo_epipolar.core.odometry.commands_sent import CommandsSent
from visual_servo_epipolar.core.servo.dead_reckoning import actuation
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import advance
from visual_servo_epipolar.core.twoview.perceive import Perception

LATE = ServoSettings(latency=0.5)
HERE = Pose.from_start(0.3, -2.0, 8.0)
TWIST = Twist(0.4, -0.3)
LATE_NS = 500_000_000


def seen_from_here(**changes: object) -> ServoState:
    """Return the state of a robot that has been told TWIST for half a second, and more before."""
    bearings = Bearings.from_pose(HERE)
    heading = math.remainder(HERE.theta - 0.5 * math.pi, math.tau)
    measurement = sight(
        20, bearings=bearings, heading_error=heading, rotation_heading=heading,
        offset=(HERE.x, HERE.y), difference=-0.1, difference_slope=0.05, view_margins=(0.4, 0.3),
    )  # fmt: skip
    sent = CommandsSent().after(0, Twist(0.1, 0.1))
    for stamp in range(measurement.stamp_ns - 500_000_000, measurement.stamp_ns, 100_000_000):
        sent = sent.after(stamp, TWIST)
    state = in_phase(Phase.MATCHING_FEATURES, sent=sent)
    return seeing(state, measurement=replace(measurement, **changes))


def ahead(state: ServoState, settings: ServoSettings) -> GoalEstimate:
    return predicted(state.measurement, state.phase, settings)


def test_what_was_told_and_not_done_is_driven_ahead() -> None:
    after, then = ahead(seen_from_here(), LATE), integrate(HERE, TWIST, 0.5)
    assert after.offset == pytest.approx((then.x, then.y), abs=2e-4)
    assert after.heading_error == pytest.approx(then.theta - 0.5 * math.pi, abs=1e-9)
    expected, found = Bearings.from_pose(then), after.bearings
    assert (found.psi, found.phi) == pytest.approx((expected.psi, expected.phi), abs=2e-4)
    assert after.difference == pytest.approx(-0.1 + 0.05 * (then.y - HERE.y), abs=1e-4)
    turned = TWIST.angular * 0.5
    assert after.view_margins == pytest.approx((0.4 - turned, 0.3 + turned))
    assert after.rotation_heading == pytest.approx(after.heading_error)


def test_without_an_offset_bearings_turn_all_the_same() -> None:
    after = ahead(seen_from_here(offset=None), LATE)
    assert after.offset is None
    assert after.bearings.heading_error == pytest.approx(after.heading_error)
    nothing = ahead(seen_from_here(bearings=None), LATE)
    assert nothing.bearings is None


@pytest.mark.parametrize(
    'settings', [ServoSettings(latency=BORNE), replace(LATE, anticipation=False)]
)
def test_who_obeys_soon_or_has_another_law_looks_not_ahead(settings) -> None:
    state = seen_from_here()
    assert ahead(state, settings) is state.measurement
    assert ahead(state.changed(phase=Phase.HOLDING), LATE) is state.measurement  # it stands
    acted = actuation(state, state.measurement.stamp_ns + 10**8, 0.1, settings)
    assert (acted.twist, acted.longest) == (state.twist, state.twist)


def test_what_acted_since_the_last_image_is_what_was_told_before() -> None:
    state = seen_from_here()
    now_ns = state.measurement.stamp_ns + 100_000_000
    acted = actuation(state, now_ns, 0.1, LATE)
    assert (acted.twist.linear, acted.twist.angular) == pytest.approx((0.4, -0.3))
    assert acted.before == acted.twist.linear
    earlier = actuation(state, now_ns, 0.1, replace(LATE, latency=0.9)).twist
    assert (earlier.linear, earlier.angular) == pytest.approx((0.1, 0.1))


def test_a_dead_band_sees_pulses_as_they_were_told() -> None:
    """Not their mean with the pause beside them: half a pulse would be below any dead band."""
    state = seen_from_here()
    sent = CommandsSent().after(0, TWIST).after(60_000_000, STANDSTILL)
    measurement = replace(state.measurement, stamp_ns=LATE_NS)
    state = seeing(state, sent=sent, measurement=measurement)
    assert actuation(state, LATE_NS + 100_000_000, 0.1, LATE).longest == TWIST
    assert actuation(state, LATE_NS + 100_000_000, 0.1, LATE).twist.linear == pytest.approx(0.24)
    assert actuation(state, LATE_NS, 0.1, ServoSettings()).longest is state.twist
    nothing = state.changed(sent=CommandsSent())
    assert actuation(nothing, LATE_NS + 100_000_000, 0.1, LATE).longest == STANDSTILL


@pytest.mark.parametrize(('queued', 'settled'), [(0.0, 1), (0.05, 0)])
def test_who_has_settled_must_be_there_when_all_has_acted(queued, settled) -> None:
    there = sight(
        20, bearings=None, parallax=0.0, heading_error=0.0, rotation_heading=0.0,
        difference=0.0, offset=(0.0, 0.0), offset_deviation=1e-4, heading_deviation=1e-5,
        difference_deviation=1e-5, difference_slope=0.05,
    )  # fmt: skip
    sent = CommandsSent().after(there.stamp_ns - 300_000_000, Twist(0.0, queued))
    state = in_phase(Phase.ORIENTING, sent=sent)
    state = seeing(state, measurement=replace(there, stamp_ns=there.stamp_ns - 100_000_000))
    assert advance(state, Perception(there, MEMORY), LATE).settling.settled == settled
