"""Phases of one motion: when it ends, is given up, and what goes on without a memory of views."""

from dataclasses import replace
from typing import Any

import pytest
from servo_states import behind, in_phase, seeing, sight

from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.laws.smooth import APPROACHING, ONE_MOTION
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.settling import is_settled
from visual_servo_epipolar.core.servo.supervisor import classify
from visual_servo_epipolar.core.twoview.measurement import Measurement

SETTINGS = ServoSettings(law='smooth')
ASIDE = {'offset': (1.5, -0.6), 'offset_deviation': 0.01, 'view_margins': (1.0, 1.0)}


def event(measurement: Measurement, settled: int = 0, **changes: Any) -> Event:
    """Return the event of a measurement on the way."""
    state = seeing(in_phase(APPROACHING.phase), measurement=measurement, settled=settled)
    return classify(state, replace(SETTINGS, **changes))


@pytest.mark.parametrize(
    ('seen', 'expected'),
    [
        # Aside of the axis D may be zero far from the goal: step 2 would drive past it.
        ({'bearings': behind(0.05, 0.05), 'difference': 0.01}, Event.ALIGNED),
        ({'bearings': behind(0.55, -0.2), 'difference': 0.01}, Event.NOTHING),
        ({'offset': (0.5, -3.0), 'offset_deviation': 0.1}, Event.NOTHING),
        ({'bearings': behind(1.2, 0.3), **ASIDE}, Event.SIDEWAYS),
        ({'offset': (0.0, 0.08), 'offset_deviation': 1e-3}, Event.MISSED),
        ({'offset': (0.08, -0.02), 'offset_deviation': 1e-3}, Event.MISSED),
        ({'bearings': None}, Event.LOST),
    ],
    ids=['on the axis', 'aside', 'on the way', 'beside', 'past', 'beside at the end', 'blind'],
)
def test_what_is_seen_on_the_way_decides_how_it_goes_on(seen: dict, expected: Event) -> None:
    assert event(sight(**seen)) is expected


def test_it_ends_where_the_way_ends_though_aside_d_is_not_zero_there() -> None:
    aside = sight(
        offset=(0.027, 0.0),
        offset_deviation=1e-3,
        heading_error=0.0,
        difference=4.6e-4,
        difference_deviation=1e-5,
        difference_slope=0.3,
    )
    state = seeing(in_phase(APPROACHING.phase), measurement=aside)
    assert is_settled(state, SETTINGS)
    assert event(aside, settled=SETTINGS.arrival_frames) is Event.MISSED


@pytest.mark.parametrize('chi, begun', [(0.62, Event.APART), (0.7, Event.SIDEWAYS)])
def test_it_begins_as_far_aside_as_the_least_way_does(chi: float, begun: Event) -> None:
    start = sight(bearings=behind(chi, -0.3), heading_error=chi + 0.3, view_margins=(0.5, 0.1))
    state = seeing(in_phase(Phase.WAITING), measurement=start)
    assert classify(state, SETTINGS) is begun


def test_without_retreat_the_robot_never_backs_off() -> None:
    aside = sight(bearings=behind(1.2, 0.3), offset=(1.5, -0.6), offset_deviation=0.01)
    passed = sight(offset=(0.0, 0.08), offset_deviation=1e-3)
    assert event(aside, retreat=False) is Event.NOTHING
    assert event(passed, retreat=False) is Event.EXHAUSTED


def test_on_the_last_way_each_settled_frame_asks_for_less() -> None:
    near = sight(
        offset=(0.0, -3.3e-4),
        offset_deviation=1e-3,
        heading_error=0.0,
        difference=-1e-4,
        difference_deviation=1e-4,
        difference_slope=0.3,
    )
    first = seeing(in_phase(APPROACHING.phase), measurement=near)
    assert is_settled(first, SETTINGS)
    assert not is_settled(first.changed(settled=SETTINGS.arrival_frames - 1), SETTINGS)


def test_it_stands_nowhere_but_where_every_law_does() -> None:
    standing = {phase for phase in ONE_MOTION.rows if not phase.drives}
    assert standing == {Phase.WAITING, Phase.HOLDING, Phase.ARRIVED, Phase.FAILED}
