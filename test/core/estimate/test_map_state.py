"""The memory of views in the servo: of what two views and all of them say, the surer is taken."""

from dataclasses import replace
import math

from map_study import map_after_drive, StudySettings, trial
import numpy as np
import pytest
from servo_states import asked, goal, in_phase, reading

from visual_servo_epipolar.core.estimate.map_state import (
    localize,
    MapState,
    sharpened,
    with_slope,
)
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.laws.arrival import ARRIVAL_OFFSET, has_parallax
from visual_servo_epipolar.core.laws.conditions import lateral_offset
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.mapping.keyframe_map import KeyframeMap
from visual_servo_epipolar.core.mapping.localization import MapLocalization
from visual_servo_epipolar.core.mapping.refinement import Geometry
from visual_servo_epipolar.core.mapping.window import FeatureObservations
from visual_servo_epipolar.core.odometry.increments import Motion, OdometryIncrement
from visual_servo_epipolar.core.rigs.fixed_mount import at_axle, offset_at_axle
from visual_servo_epipolar.core.rigs.rig import Command
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import update
from visual_servo_epipolar.core.twoview.measurement import Measurement
from visual_servo_epipolar.core.twoview.memory import fresh_memory, PerceptionMemory
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.core.twoview.perceive import Perception

SETTINGS = ServoSettings()
TWO_VIEWS, MEMORY = Bearings(-1.5, 0.1), reading().bearings


def measurement(deviation: float = 0.01) -> Measurement:
    return Measurement(0, 60, 769.0, 0.2, bearings=TWO_VIEWS, deviation=deviation, parallax=0.0)


@pytest.mark.parametrize(
    ('two_views', 'memory', 'expected'),
    [(0.01, 0.001, MEMORY), (0.004, 0.011, MEMORY), (0.001, 0.01, TWO_VIEWS)],
)
def test_the_surer_bearings_are_taken(two_views: float, memory: float, expected: Bearings) -> None:
    better = sharpened(measurement(two_views), reading(memory), SETTINGS)
    assert better.bearings == expected
    assert better.deviation == pytest.approx(memory if expected is MEMORY else two_views)
    assert (better.offset, better.heading_error, better.difference) == ((0.004, -0.5), 0.01, -0.02)
    assert lateral_offset(goal(better, ServoState())) == 0.004


def test_uncertain_bearings_of_the_memory_are_none() -> None:
    blind = replace(measurement(), bearings=None, deviation=math.nan)
    assert sharpened(blind, reading(2.0 * SETTINGS.max_deviation), SETTINGS).bearings is None
    assert sharpened(blind, reading(), SETTINGS).bearings == MEMORY


@pytest.mark.parametrize(('pixels', 'seen'), [(1.0, False), (3.0, True), (math.nan, True)])
def test_no_memory_overrules_an_image_that_looks_another(pixels: float, seen: bool) -> None:
    """Through a lens that is told wrong it may have a geometry that is not there."""
    there = replace(measurement(), offset=(0.0, 0.0), offset_deviation=1e-3)
    assert (
        asked(has_parallax, ServoState(), replace(there, parallax=pixels / 769.0), SETTINGS)
        is seen
    )


@pytest.mark.parametrize(
    ('away', 'deviation', 'parallax', 'expected'),
    [
        *((away, known, 1e-3, False) for away, known in [(0.0, 1e-4), (0.01, 0.01)]),
        (ARRIVAL_OFFSET, 0.0, 1e-3, False),
        *((away, 1e-3, 0.0, True) for away in (0.003, -0.01, math.nan)),
    ],
)
def test_who_is_at_the_goal_by_the_memory_has_no_parallax_and_who_is_not_has(
    away, deviation, parallax, expected
) -> None:
    there = replace(
        measurement(), offset=(away, 0.0), offset_deviation=deviation, parallax=parallax
    )
    assert asked(has_parallax, ServoState(), there, SETTINGS) is expected


def test_what_is_left_along_the_axis_is_no_reason_for_an_attempt_that_ends_as_the_last() -> None:
    short = replace(measurement(), offset=(0.0, -0.003), offset_deviation=1e-4)
    short = replace(short, difference_slope=0.1, difference_deviation=1e-6, difference=-3e-4)
    assert asked(has_parallax, ServoState(), short, SETTINGS)
    banded = replace(SETTINGS, dead_band_linear=0.07)  # half a hop of 7 mm
    assert not asked(has_parallax, ServoState(), short, banded)


@pytest.mark.parametrize('mount', [(0.0, 0.3, 0.0), (0.1, 0.2, -0.1), (-0.4, 0.0, 0.05)])
def test_the_offset_of_the_axle_lies_where_its_bearing_points(mount) -> None:
    bearings, distance = Bearings(-1.3, 0.5), 1.7
    seen = distance * math.cos(bearings.psi), distance * math.sin(bearings.psi)
    x, y = offset_at_axle(seen, bearings.heading_error, np.array(mount))
    assert math.atan2(y, x) == pytest.approx(at_axle(bearings, np.array(mount), distance).psi)


def test_the_slope_of_d_is_what_the_memory_says_though_other_features_are_in_view() -> None:
    """D leaps where features come and go; who is driven by its slope is as fast as before."""
    before = sharpened(measurement(), reading(), SETTINGS)
    moving = in_phase(
        Phase.MATCHING_FEATURES, measurement=before, command=Command(Twist(0.2, 0.0))
    )
    few = reading(difference_slope=0.008)
    now = sharpened(measurement(), few, SETTINGS)
    # Without ``memory`` nothing is remembered here, and the measurement is what it is.
    alone = ServoSettings(memory=False)
    after = update(moving, Perception(now, fresh_memory(SETTINGS)), 0.1, alone)
    assert after.motion.slope.value == 0.008


def test_a_wrong_match_has_no_part_in_d() -> None:
    drive = trial(StudySettings(), 3)
    memory, seen = map_after_drive(drive), drive.observations(len(drive.views) - 1)
    observation = Observation(0, seen.current, seen.desired, 769.0, ids=seen.ids)
    _, said = memory.after(seen, learns=False)
    at = said.geometry.evaluation
    near = at.unknowns.inverse_depth.copy()
    near[:3] = 500.0
    nearer = replace(at, unknowns=replace(at.unknowns, inverse_depth=near))
    slopes = [
        with_slope(replace(said, geometry=Geometry(each)), observation).difference_slope
        for trusted in (np.arange(len(near)) >= 3, np.ones(len(near), bool))
        for each in (replace(at, trusted=trusted), replace(nearer, trusted=trusted))
    ]
    assert slopes[0] == slopes[1] < 0.1 * slopes[3]


def localized(
    views: KeyframeMap, seen: FeatureObservations, memory: PerceptionMemory
) -> tuple[MapState, MapLocalization | None]:
    """Return the state of the map after a robot that stands has ``seen`` features."""
    observation = Observation(0, seen.current, seen.desired, 769.0, ids=seen.ids)
    perception = Perception(Measurement(0, len(seen), 769.0, 0.2), memory, observation=observation)
    nowhere = OdometryIncrement(Motion(), Motion())
    return localize(MapState(views), perception, nowhere, SETTINGS)


def test_a_view_of_few_features_that_does_not_count_teaches_nothing() -> None:
    drive = trial(StudySettings(), 3)  # ends near the goal
    memory = map_after_drive(drive)
    seen = drive.observations(len(drive.views) - 1)
    few = seen.take(np.arange(len(seen)) % 7 == 0)
    assert memory.after(few, learns=False)[0].shrinkage != memory.shrinkage
    after, said = localized(memory, few, fresh_memory(SETTINGS))
    assert said is None
    assert after.views.shrinkage == memory.shrinkage
    assert after.views.pose is memory.pose


def test_a_floor_that_becomes_rough_keeps_the_map() -> None:
    drive = trial(StudySettings(), 3)
    memory, last = map_after_drive(drive), len(drive.views) - 1
    seen = drive.observations(last)
    known = fresh_memory(SETTINGS)
    bumpy = replace(known, attitude=replace(known.attitude, jitter=2.0 * memory.mount.jitter))
    after, said = localized(memory, seen, bumpy)
    assert after.views.mount.jitter == 2.0 * memory.mount.jitter
    assert said is not None
    off = math.hypot(said.lateral - drive.views[last, 0], said.longitudinal - drive.views[last, 1])
    assert off < 4.0 * math.hypot(said.lateral_deviation, said.longitudinal_deviation)
