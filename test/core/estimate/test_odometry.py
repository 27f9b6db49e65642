"""Odometry: used once it has agreed with what is seen or told, and no more once contradicted."""

from dataclasses import replace
import math

import pytest
from servo_states import SETTINGS, sight

from visual_servo_epipolar.core.estimate.base_model import MOST_CONTRADICTIONS
from visual_servo_epipolar.core.estimate.odometry import (
    Odometry,
)
from visual_servo_epipolar.core.geometry.motion import integrate, Pose, Twist
from visual_servo_epipolar.core.odometry.increments import Motion, OdometryIncrement

DT = 0.1
BEGIN = Pose(3.0, -1.0, 2.0)  # of a frame that nobody knows
AHEAD, LEFT = Twist(0.3, 0.0), Twist(0.0, 0.3)
IMAGES = 60


class Drive:
    """A base that is driven; what its wheels say, commands and images is made of its twist."""

    def __init__(self, odometry: Odometry | None = None, *, remembers: bool = False) -> None:
        self.odometry = odometry or Odometry()
        self.wheels, self.true, self.remembers = BEGIN, Pose(0.0, -3.0, 0.5 * math.pi), remembers
        self.driven = OdometryIncrement(Motion(), Motion())
        self.step(Twist(0.0, 0.0))

    def step(
        self,
        true: Twist,
        *,
        wheels: Twist | Pose | None = None,
        told: Twist | None = None,
        **seen: object,
    ) -> 'Drive':
        """Drive by ``true``; wheels and commands say the same unless another is given."""
        said = true if wheels is None else wheels
        self.true = integrate(self.true, true, DT)
        self.wheels = said if isinstance(said, Pose) else integrate(self.wheels, said, DT)
        told = told or true
        commanded = Motion(told.linear * DT, told.angular * DT)
        self.odometry, self.driven = self.odometry.after(self.wheels, commanded, DT, SETTINGS)
        place = (self.true.x, self.true.y) if self.remembers else None
        measurement = sight(
            heading_error=self.true.heading_error,
            heading_deviation=5e-4,
            offset=place,
            offset_deviation=0.005,
        )
        self.odometry = self.odometry.judge(replace(measurement, **seen))
        return self

    def drive(self, true: Twist, images: int = IMAGES, **others: object) -> 'Drive':
        for _ in range(images):
            self.step(true, **others)
        return self

    @property
    def motion(self) -> Motion:
        return self.driven.motion

    @property
    def contradictions(self) -> int:
        return self.odometry.unseen + self.odometry.untold

    @property
    def refuted(self) -> str:
        return self.odometry.refuted


def proven(*, remembers: bool = False) -> Drive:
    """Return a drive after a turn in which odometry was right."""
    drive = Drive(remembers=remembers).drive(LEFT, 10)
    assert drive.odometry.proven
    return drive


def test_it_is_not_used_before_it_has_agreed() -> None:
    drive = Drive().step(AHEAD, told=Twist(0.2, 0.0))
    assert drive.motion == Motion(0.2 * DT, 0.0)
    assert not drive.odometry.proven


@pytest.mark.parametrize('twist', [LEFT, AHEAD, Twist(0.2, -0.2), Twist(-0.2, 0.0)])
def test_once_it_has_agreed_the_motion_is_that_of_the_wheels(twist: Twist) -> None:
    drive = Drive().drive(twist, 30).step(Twist(0.2, 0.1), told=Twist(0.25, 0.0))
    assert drive.motion.measured
    assert (drive.motion.way, drive.motion.turn) == pytest.approx((0.02, 0.01), abs=1e-9)
    assert not drive.contradictions


@pytest.mark.parametrize(
    ('true', 'wheels'),
    [
        (LEFT, Twist(0.0, 0.0)),
        (LEFT, Twist(0.0, -0.3)),
        (LEFT, Twist(0.0, 0.6)),
        (LEFT, Twist(0.0, 0.15)),
        (AHEAD, Twist(0.15, 0.3)),
    ],
    ids=['frozen', 'mirrored', 'twice', 'half', 'a wheel unplugged'],
)
def test_a_turn_that_is_not_seen_refutes_it(true: Twist, wheels: Twist) -> None:
    for drive in (Drive(), proven()):
        drive.drive(true, wheels=wheels)
        assert 'odometry says a turn of' in drive.refuted
        assert drive.refuted.endswith('which goes on by commands')
        told = Motion(true.linear * DT, true.angular * DT)
        assert drive.step(true, wheels=wheels).motion == told
        assert not drive.driven.trusted


@pytest.mark.parametrize(
    'wheels',
    [Twist(0.0, 0.0), Twist(-0.3, 0.0), Twist(0.2, 0.0), Twist(0.45, 0.0)],
    ids=['frozen', 'backwards', 'two thirds', 'half more'],
)
def test_a_way_that_a_memory_does_not_see_refutes_it(wheels: Twist) -> None:
    drive = proven(remembers=True).drive(AHEAD, wheels=wheels)
    assert drive.refuted.startswith('odometry says ')
    assert ' m are seen' in drive.refuted


@pytest.mark.parametrize(
    ('true', 'wheels', 'wrong'),
    [
        (AHEAD, 0.0, True),
        (AHEAD, -0.3, True),
        (AHEAD, 0.6, True),
        (AHEAD, 0.15, False),
        (AHEAD, 0.33, False),
        (Twist(-0.3, 0.0), -0.6, True),
        (Twist(-0.3, 0.0), -0.3, False),
    ],
    ids=['frozen', 'backwards', 'twice', 'a slow base', 'nearly', 'twice as far back', 'back'],
)
def test_without_a_memory_commands_say_what_a_base_does_at_most(true, wheels, wrong) -> None:
    for drive in (Drive(), proven()):
        drive.drive(true, wheels=Twist(wheels, 0.0))
        assert ('were commanded' in drive.refuted) == wrong


@pytest.mark.parametrize('remembers', [False, True])
def test_who_stands_whatever_is_commanded_is_seen_to_stand_by_a_memory(remembers: bool) -> None:
    stands = Twist(0.0, 0.0)
    assert bool(proven(remembers=remembers).drive(stands, told=AHEAD).refuted) is not remembers
    # One that cannot tell how far it is sees nobody stand: what is commanded fits as well.
    unsure = proven(remembers=remembers).drive(AHEAD, wheels=stands, offset_deviation=0.9)
    assert 'were commanded' in unsure.refuted


@pytest.mark.parametrize('remembers', [False, True])
def test_pushes_worn_wheels_and_slip_are_no_lie(remembers: bool) -> None:
    drive, still = proven(remembers=remembers), Twist(0.0, 0.0)
    for true in (Twist(0.4, 0.4), Twist(-0.4, -0.4)):
        drive.drive(true, wheels=still, told=still)
    worn = proven(remembers=True)
    for angular in (0.0, 0.3, -0.3):
        wheels = Twist(0.3, angular)
        worn.drive(Twist(0.95 * 0.3, 0.95 * angular + 0.08 * 0.3), wheels=wheels, told=wheels)
    assert (drive.contradictions, worn.contradictions) == (0, 0)


def test_a_leap_is_no_motion_and_refutes_it_unless_it_agrees_in_between() -> None:
    drive = proven().step(AHEAD, wheels=BEGIN)
    assert (drive.motion, drive.contradictions) == (Motion(AHEAD.linear * DT, 0.0), 1)
    assert drive.step(AHEAD).motion.measured  # a reset, once: it goes on from there
    assert drive.drive(AHEAD, 30).odometry.unseen == 1  # two views of a straight way forgive none
    for number in range(1, MOST_CONTRADICTIONS):
        assert not drive.refuted
        drive.step(AHEAD, wheels=Pose(float(number), 0.0, 0.0))
    assert 'odometry leaps by' in drive.refuted
    forgiven = proven(remembers=True)
    for _ in range(2 * MOST_CONTRADICTIONS):
        forgiven.step(AHEAD, wheels=BEGIN).drive(AHEAD, 20)
    assert not forgiven.refuted


def test_an_image_without_a_pose_is_driven_by_commands_and_so_is_the_next() -> None:
    drive, told = proven(), Motion(0.1, 0.2)
    without, driven = drive.odometry.after(None, told, DT, SETTINGS)
    assert (driven.motion, driven.trusted) == (told, True)
    assert (without.pose, without.check) == (None, None)
    again, driven = without.judge(sight()).after(drive.wheels, told, DT, SETTINGS)
    assert driven.motion == told
    driven = again.after(drive.wheels, told, DT, SETTINGS)[1]
    assert (driven.motion, driven.other) == (Motion(measured=True), told)


def test_who_was_carried_while_no_images_came_or_stamps_leapt_is_commanded_no_lie() -> None:
    drive, told = proven(), Motion()
    assert drive.odometry.after(drive.wheels, told, 0.0, SETTINGS)[1].motion is told
    far = replace(drive.wheels, x=drive.wheels.x + 4.0)
    after, driven = drive.odometry.after(far, told, 1.0, SETTINGS)
    assert (driven.motion, after.pose) == (told, far)
    assert after.unseen == drive.odometry.unseen
    assert drive.odometry.after(far, told, 0.5, SETTINGS)[0].unseen == 1


def test_what_was_seen_by_another_scale_is_held_against_nothing() -> None:
    drive, before = Drive(remembers=True), None
    for _ in range(IMAGES):
        if drive.odometry.proven:
            break
        before = drive.step(LEFT).odometry.check
    assert drive.odometry.proven
    assert before is None


def test_a_memory_of_the_same_scale_forgives_no_way_that_was_not_commanded() -> None:
    drive = proven()
    drive.remembers = True  # what is remembered is as large as the way by the wheels
    assert 'were commanded' in drive.drive(Twist(0.6, 0.0), told=AHEAD).refuted


def test_a_heading_that_nobody_is_sure_of_says_nothing() -> None:
    unsure = {'wheels': Twist(0.0, 0.0), 'heading_deviation': 0.03}
    assert not proven().drive(LEFT, **unsure).contradictions
    assert not Drive().drive(LEFT, heading_deviation=0.03).odometry.proven


def test_two_views_and_a_memory_may_differ_in_their_headings() -> None:
    drive = proven()
    drive.true = replace(drive.true, theta=drive.true.theta + 0.1)  # the memory takes over
    drive.remembers = True
    assert not drive.step(LEFT).contradictions
    assert drive.odometry.check.seen.offset  # from here on ways are seen as well
