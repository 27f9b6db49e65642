"""The memory of views in the servo: of what two views and all of them say, the surer is taken."""

from dataclasses import replace
import math

from map_study import map_after_drive, StudySettings, trial
import numpy as np
import pytest
from servo_states import asked, goal, in_phase, reading

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.estimate.map_state import (
    filter_pose,
    first_pose,
    localize,
    MapState,
    sharpened,
    SLIP,
    with_heading_noise,
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


OWN = np.diag([0.8e-3, 0.5e-3, 1.5e-4, 1e-3, 1e-3]) ** 2
COMMON = np.diag([0.4e-3, 0.3e-3, 0.5e-4, 1e-3, 1e-3]) ** 2
STILL = Motion()


def said(pose: FloatArray) -> MapLocalization:
    return MapLocalization(
        np.array([*pose, 0.0, 0.0]), OWN + COMMON, OWN, None, np.ones(0, bool), np.zeros(5)
    )


def noisy(place: FloatArray, rng: np.random.Generator) -> MapLocalization:
    return said(place + rng.normal(size=3) * np.sqrt(np.diag(OWN)[:3]))


@pytest.mark.parametrize('noise', [0.0, 3e-3])  # of a head's encoder [rad]
def test_views_of_a_robot_that_stands_average_out(noise: float) -> None:
    rng, true, count = np.random.default_rng(1), np.array([0.001, -0.002, 0.0005]), 16
    errors, now, encoder = [], said(true), np.random.default_rng(3)
    for _ in range(200):
        place = None
        for _ in range(count):
            view = noisy(true + [0.0, 0.0, noise * encoder.normal()], rng)
            now, place = filter_pose(with_heading_noise(view, noise), place, STILL)
        errors.append(now.pose[:3] - true)
    expected = np.sqrt((np.diag(OWN)[:3] + [0.0, 0.0, noise**2]) / count)
    assert np.std(errors, axis=0) == pytest.approx(expected, rel=0.25)
    assert np.sqrt(np.diag(now.own)[:3]) == pytest.approx(expected, rel=0.05)
    # What all views have in common stays.
    assert now.covariance - now.own == pytest.approx(COMMON, abs=1e-12)


@pytest.mark.parametrize(
    ('motion', 'heading', 'step'),
    [
        (Motion(way=0.01), 0.0, (0.0, 0.01, 0.0)),
        (Motion(way=0.01), 0.5 * math.pi, (-0.01, 0.0, 0.0)),
        (Motion(turn=0.02), 0.0, (0.0, 0.0, 0.02)),
    ],
)
def test_a_place_moves_as_the_robot(motion, heading, step) -> None:
    before = first_pose(np.array([0.1, 0.2, heading]), OWN[:3, :3], STILL)
    after = before.after(motion)
    assert (after.mean - before.mean)[:3] == pytest.approx(step, abs=1e-12)
    assert (np.diag(after.covariance) >= np.diag(before.covariance)).all()
    assert after.covariance.trace() > before.covariance.trace()


def test_what_the_shrinkage_shifts_shifts_the_views_before_as_well() -> None:
    place, shift = None, np.array([0.002, -0.001, 0.0003, 0.0, 0.0])
    for _ in range(20):
        now, place = filter_pose(said(np.zeros(3)), place, STILL)
    assert now.pose[:3] == pytest.approx(np.zeros(3))
    moved = said(shift[:3])
    now, place = filter_pose(replace(moved, shift=shift), place, STILL)
    assert now.pose[:3] == pytest.approx(shift[:3])


def test_a_robot_that_drives_fast_is_where_it_is_seen() -> None:
    first = np.array([0.0, -0.5, 0.0])
    _, place = filter_pose(said(first), None, STILL)
    seen = first + [0.0003, 0.019, 0.0001]
    now, _ = filter_pose(said(seen), place, Motion(way=0.02, turn=0.01))
    assert now.pose[:3] == pytest.approx(seen, abs=1.5e-4)


@pytest.mark.parametrize('slip', [0.0, 0.04, -0.04])
def test_a_way_to_the_side_that_lasts_is_learnt_and_views_average_on_the_way(slip: float) -> None:
    """As a camera looks elsewhere than where the base drives: the line to the goal is no saw."""
    rng, step, errors, slips = np.random.default_rng(2), 0.03, [], []
    for _ in range(40):
        true, place, motion = np.array([0.0, -1.2, 0.0]), None, STILL
        for _ in range(30):
            now, place = filter_pose(noisy(true, rng), place, motion)
            motion, last = Motion(way=step), true
            true = true + [slip * step, step, 0.0]
        assert place is not None
        errors.append(now.pose[0] - last[0])
        slips.append(place.mean[SLIP])
    assert np.std(errors) < 0.45e-3  # 0.8 mm by one view
    assert abs(np.mean(errors)) < 0.3e-3
    assert np.mean(slips) == pytest.approx(slip, abs=0.005)


@pytest.mark.parametrize(
    ('begin', 'told', 'rolls'),
    [
        # Commands count as they were sent; where they act at once, it drives less far by each.
        (0.0, [0.02 * 0.7**k for k in range(15)], [0.02 * 0.7**k for k in range(15)]),
        (0.01, [0.0] * 6, [0.006, 0.004, 0.002, 0.001, 0.0, 0.0]),  # it rolls on, late
    ],
    ids=['it slows down', 'it obeys late'],
)
def test_a_base_that_slows_down_or_obeys_late_leaves_no_error(begin, told, rolls) -> None:
    true = np.array([0.0, -0.05, 0.0])
    now, place = filter_pose(said(true), None, Motion(way=begin))
    for way, roll in zip(told, rolls, strict=True):
        true = true + [0.0, roll, 0.0]
        now, place = filter_pose(said(true), place, Motion(way=way))
    assert abs(now.pose[1] - true[1]) < 0.3e-3


def test_who_is_pushed_begins_anew() -> None:
    _, place = filter_pose(said(np.zeros(3)), None, STILL)
    away = np.array([0.05, -0.1, 0.02])
    now, place = filter_pose(said(away), place, STILL)
    assert now.pose[:3] == pytest.approx(away)
    assert now.own == pytest.approx(OWN)
    assert place is not None and place.mean[:3] == pytest.approx(away)


def test_wheels_are_a_random_walk_and_do_not_come_late() -> None:
    step, before = (
        Motion(0.01, 0.0, measured=True),
        first_pose(np.zeros(3), np.zeros((3, 3)), STILL),
    )
    after = before.after(step)
    ahead = 0.0075**2 * 0.01 + (0.05 * 0.01) ** 2
    assert after.covariance[1, 1] == pytest.approx(ahead)
    stands = Motion(measured=True)
    assert after.after(stands).covariance == pytest.approx(after.covariance)
