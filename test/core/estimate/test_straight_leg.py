"""Straight legs: what a memory of views tells of a camera that looks aside."""

from dataclasses import replace
import math

import numpy as np
import pytest
from servo_states import in_phase, MEMORY, reading, seeing, SETTINGS, sight, TWO_VIEWS

from visual_servo_epipolar.core.estimate.extrinsics import (
    Extrinsics,
    LEG_M,
    LEVER,
    MAX_CONTRADICTIONS,
    PLAUSIBLE,
    straight_on,
    StraightLeg,
)
from visual_servo_epipolar.core.estimate.map_state import MapState
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.rigs.fixed_mount import camera_swing
from visual_servo_epipolar.core.servo import estimator
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import classify, update
from visual_servo_epipolar.core.twoview.perceive import Perception

STEP = 0.02
ON_AXLE = np.zeros(3)
MOST_YAW = PLAUSIBLE * SETTINGS.camera_yaw_deviation


def driven(
    yaw: float,
    *,
    curvature: float = 0.0,
    travel: float = STEP,
    lever: tuple[float, float] = (0.0, 0.0),
    belief: Extrinsics = SETTINGS.extrinsics,
    way: float = 1.0,
    deviation: float = 3e-4,
) -> Extrinsics:
    """Return the belief after a way [m] of a base whose camera looks aside by ``yaw`` [rad]."""
    x, y, heading = 0.05, -1.5, 0.02
    leg: StraightLeg | None = None
    for k in range(round(way / abs(travel)) + 1):
        if k:
            middle = heading + 0.5 * curvature * travel
            x -= travel * math.sin(middle - yaw)
            y += travel * math.cos(middle - yaw)
            heading += curvature * travel
        swing = camera_swing(0.0, heading) @ np.array(lever)
        seen = reading(
            lateral=x + float(swing[0]),
            longitudinal=y + float(swing[1]),
            heading_error=heading,
            lateral_deviation=deviation,
        )
        leg, belief = straight_on(leg, seen, travel if k else 0.0, belief)
    return belief


@pytest.mark.parametrize('travel', [STEP, -STEP])
@pytest.mark.parametrize('curvature', [0.0, 0.02])
@pytest.mark.parametrize('degrees', [-3.0, -0.5, 0.5, 1.5])
def test_the_yaw_of_a_camera_that_looks_aside_is_learnt(degrees, curvature, travel) -> None:
    told = driven(math.radians(degrees), curvature=curvature, travel=travel)
    assert told.believed
    assert math.degrees(told.mount[0]) == pytest.approx(degrees, abs=0.1)


@pytest.mark.parametrize('degrees', [0.0, 0.12])
def test_what_hardly_matters_is_left_alone(degrees) -> None:
    assert driven(math.radians(degrees)) is SETTINGS.extrinsics


@pytest.mark.parametrize(
    ('yaw', 'known', 'believed'),
    [
        pytest.param(math.radians(0.5), {'deviation': 0.01}, False, id='noise may be it'),
        # Half a degree over 2 deg of turn may be a camera that sits aside of where it is told.
        pytest.param(math.radians(0.5), {'curvature': 0.15}, False, id='a turn may have swung it'),
        pytest.param(math.radians(3.0), {'way': 0.9 * LEG_M}, False, id='no leg yet'),
        pytest.param(0.9 * MOST_YAW, {}, True, id='a mount that may be'),
        pytest.param(1.1 * MOST_YAW, {}, False, id='one that cannot'),
    ],
)
def test_what_is_certain_and_may_be_is_learnt(yaw, known, believed) -> None:
    assert driven(yaw, **known).believed is believed


@pytest.mark.parametrize(
    ('end', 'deviation', 'tells'),
    [
        pytest.param(StraightLeg(0.0, -0.75, 1e-3, 0.4), 1e-3, False, id='it curves'),
        pytest.param(StraightLeg(0.0, -0.99, 1e-3, 0.0), 1e-3, False, id='on the spot'),
        # Far before one wall a memory has been 3 deg off, at four of its deviations.
        pytest.param(StraightLeg(0.01, -0.75, 0.02, 0.0), 0.02, False, id='places hardly known'),
        pytest.param(StraightLeg(0.01, -0.75, 0.002, 0.0), 0.002, True, id='places known'),
    ],
)
def test_a_leg_tells_by_two_places_that_are_known_and_apart(end, deviation, tells) -> None:
    leg = StraightLeg(0.0, -1.0, deviation, 0.0, travel=0.25)
    yaw = leg.yaw(end, ON_AXLE, LEVER)
    assert (yaw[1] < math.radians(0.5)) is tells
    assert tells or leg.followed_by(end, *yaw).measured == (0.0, math.inf)
    assert straight_on(leg, None, 0.3, SETTINGS.extrinsics) == (None, SETTINGS.extrinsics)


def test_a_lever_arm_that_is_told_does_not_turn_the_leg() -> None:
    told = replace(SETTINGS.extrinsics, configured=np.array([0.0, 0.3, 0.1]))
    told = replace(told, mean=np.concatenate([told.mean[:2], told.configured]))
    assert driven(0.0, curvature=0.5, lever=(0.3, 0.1), belief=told) is told
    learnt = driven(math.radians(1.0), curvature=0.02, lever=(0.3, 0.1), belief=told)
    assert math.degrees(learnt.mount[0]) == pytest.approx(1.0, abs=0.1)


def test_a_lever_arm_that_is_learnt_on_the_way_is_that_of_both_ends() -> None:
    """An end with the arm of then, and one with that of now, were a turn of 3 deg."""
    begin = reading(lateral=0.0, longitudinal=-1.0, heading_error=0.1, lateral_deviation=3e-4)
    leg, belief = straight_on(None, begin, 0.0, SETTINGS.extrinsics)
    later = replace(belief, mean=np.array([0.0, 0.0, 0.0, 0.15, 0.0]))
    x, y = -0.3 * math.sin(0.1), -1.0 + 0.3 * math.cos(0.1)
    end = reading(lateral=x, longitudinal=y, heading_error=0.1, lateral_deviation=3e-4)
    following, _ = straight_on(leg, end, 0.3, later)
    assert following is not None
    assert abs(math.degrees(following.measured[0])) < 0.05


def seen_next(state: ServoState) -> StraightLeg | None:
    """Return the leg after one more view."""
    return update(state, Perception(sight(), MEMORY), 0.1, SETTINGS).identified.straight


def test_legs_are_those_of_step_2_alone() -> None:
    """A turn in place, or a spiral, is none; a new phase begins anew."""
    leg = StraightLeg(0.0, -1.0, 1e-3, 0.0)
    for phase in (Phase.ZEROING_EPIPOLES, Phase.RETREATING, Phase.ORIENTING):
        assert seen_next(in_phase(phase, straight=leg)) is None


def test_what_driving_disproves_is_part_of_no_leg(monkeypatch) -> None:
    """The memory begins anew, at another place and scale: no leg leads from one to the other."""
    monkeypatch.setattr(estimator, 'localize', lambda *_, **__: (MapState(), reading()))
    leg = StraightLeg(0.0, -1.0, 1e-3, 0.0)
    state = in_phase(Phase.MATCHING_FEATURES, straight=leg, extrinsics=SETTINGS.extrinsics)
    assert seen_next(state) is not None
    disproved = replace(SETTINGS.extrinsics, contradictions=MAX_CONTRADICTIONS + 1)
    monkeypatch.setattr(estimator, 'update_extrinsics', lambda *_, **__: disproved)
    assert seen_next(state) is None


def test_who_knows_the_offset_needs_no_new_attempt_for_a_yaw() -> None:
    """Two views cannot tell that they are aside: what they drove by was wrong, and they repeat."""
    turned = replace(SETTINGS.extrinsics, mean=np.array([0.0, 1.0, 0.05, 0.0, 0.0]), believed=True)
    near = sight(parallax=0.0, difference=0.0, heading_error=0.0)
    state = in_phase(
        Phase.MATCHING_FEATURES,
        extrinsics=turned,
        settled=SETTINGS.arrival_frames,
        settled_parallax=0.0,
    )
    assert classify(seeing(state, measurement=near), TWO_VIEWS) is Event.MISSED
    known = replace(
        near, offset=(0.0, 0.0), offset_deviation=1e-3, heading_deviation=1e-3,
        difference_slope=0.05, difference_deviation=0.0,
    )  # fmt: skip
    assert classify(seeing(state, measurement=known), SETTINGS) is Event.MATCHED


def test_what_is_believed_learns_from_each_leg() -> None:
    """A wrong yaw that bearings led to is corrected, by legs that would not have begun it."""
    wrong = replace(
        SETTINGS.extrinsics,
        mean=np.array([0.0, 0.0, math.radians(4.0), 0.0, 0.0]),
        covariance=np.diag([1e-4, 1e-2, math.radians(1.0) ** 2, 1e-2, 1e-2]),
        believed=True,
    )
    after = driven(0.0, belief=wrong, deviation=5e-3, way=1.5)
    assert abs(math.degrees(after.mount[0])) < 1.0
