"""One motion with a camera that sees all around: home from every pose, without backing off."""

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
from servo_states import asked, behind, in_phase, seeing, sight
from strategies import floats

from visual_servo_epipolar.core.geometry.motion import wrap_angle
from visual_servo_epipolar.core.laws.phase import Event
from visual_servo_epipolar.core.laws.smooth import approach, APPROACHING
from visual_servo_epipolar.core.laws.steering import goes_around
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import classify
from visual_servo_epipolar.core.twoview.measurement import Measurement

SETTINGS = ServoSettings(law='smooth')
ENDLESS = (math.inf, math.inf)
PERIOD_S = 0.1
angles = floats(-math.pi, math.pi)


def seen(x: float, y: float, heading: float) -> Measurement:
    """Return what a memory of views knows at x, y [m] and a heading error, all around in view."""
    return sight(offset=(x, y), offset_deviation=1e-3, heading_error=heading, view_margins=ENDLESS)


@given(floats(0.6, 4.0), angles, angles)
def test_from_every_pose_it_comes_near_the_goal(distance, direction, heading) -> None:
    x, y = distance * math.cos(direction), distance * math.sin(direction)
    way = 0.0
    for _ in range(1000):
        if not goes_around(x, y, heading, seen(x, y, heading)):
            break
        twist = asked(approach, ServoState(), seen(x, y, heading), SETTINGS)
        turn = float(np.clip(twist.angular, -SETTINGS.max_angular, SETTINGS.max_angular))
        heading = wrap_angle(heading + PERIOD_S * turn)
        x -= PERIOD_S * twist.linear * math.sin(heading)
        y += PERIOD_S * twist.linear * math.cos(heading)
        way += PERIOD_S * abs(twist.linear)
        assert math.hypot(x, y) <= 1.01 * distance
    assert y < 0.0 and abs(heading) < 0.8
    assert way < 3.0 * distance


@given(st.sampled_from([-1.0, 1.0]), floats(0.5, 4.0))
def test_beside_and_ahead_of_the_goal_nobody_backs_off_who_sees_all_around(side, distance) -> None:
    beside = behind(side * 1.4, side * 0.3)
    state = in_phase(APPROACHING.phase)
    for x, y in ((side * distance, 0.0), (0.1, distance)):
        known = {'bearings': beside, 'offset': (x, y), 'offset_deviation': 0.01}
        events = [
            classify(seeing(state, measurement=sight(view_margins=margins, **known)), SETTINGS)
            for margins in (ENDLESS, (1.0, 1.0))
        ]
        assert events[0] is Event.NOTHING
        assert events[1] in (Event.SIDEWAYS, Event.MISSED)


def test_near_the_goal_and_facing_it_the_line_is_followed() -> None:
    assert not goes_around(0.1, -0.3, 0.2, seen(0.1, -0.3, 0.2))
    assert goes_around(0.1, -0.3, 2.0, seen(0.1, -0.3, 2.0))
    assert not goes_around(1.0, 1.0, 0.0, sight(view_margins=(1.0, 1.0)))
