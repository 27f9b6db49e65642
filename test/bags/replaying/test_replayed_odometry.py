"""A run by odometry is replayed with the very poses that were used; bags without any as before."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from bagmaker import drive, small_scenario, write_bag
import pytest

from visual_servo_epipolar.bags.reading.bag import Bag
from visual_servo_epipolar.bags.reading.run import read_run, Recording
from visual_servo_epipolar.bags.reading.topics import assign_roles
from visual_servo_epipolar.bags.replaying.comparison import compare
from visual_servo_epipolar.bags.replaying.plan import plan, ReplayOverrides
from visual_servo_epipolar.bags.replaying.replay import replay, ReplayedStep
from visual_servo_epipolar.core.servo.telemetry import ODOMETRY, odometry_of

CLOSE = (0.3, -2.2, 0.0)


def replayed(
    path: Path,
    overrides: ReplayOverrides,
    known: Callable[[Recording], Recording] = lambda run: run,
) -> tuple[Recording, list[ReplayedStep]]:
    """Replay a bag of which so much is ``known``."""
    with Bag(path) as bag:
        run = known(read_run(bag, assign_roles(bag, {})))
        return run, replay(bag, run, plan(bag, run, overrides)[0])


def without_odometry(run: Recording) -> Recording:
    """Return the recording of somebody who knew of no odometry."""
    known = {
        key: {name: value for name, value in values.items() if name not in ODOMETRY}
        for key, values in run.telemetry.items()
    }
    return replace(run, telemetry=known)


@pytest.fixture(scope='module')
def reckoned(tmp_path_factory) -> Path:
    scenario = small_scenario(4.0, odometry=True)
    said = drive(scenario, scenario.loop(CLOSE, 0))
    return write_bag(tmp_path_factory.mktemp('bags') / 'reckoned', said)


@pytest.mark.parametrize('from_tracks', [False, True])
def test_a_run_by_odometry_is_replayed_to_the_last_bit(reckoned, from_tracks) -> None:
    run, steps = replayed(reckoned, ReplayOverrides(from_tracks=from_tracks))
    comparison = compare(run, steps, 0.0)
    assert comparison.equal
    assert comparison.differences[ODOMETRY[0]].compared == len(steps)
    poses = [odometry_of(step.telemetry) for step in steps]
    assert None not in poses
    assert poses[-1] != poses[0]


def test_it_goes_by_the_poses_that_were_used(reckoned) -> None:
    _, steps = replayed(reckoned, ReplayOverrides(from_tracks=True), without_odometry)
    assert {odometry_of(step.telemetry) for step in steps} == {None}


def test_who_wants_none_of_it_hears_none(reckoned) -> None:
    changes = {'servo': {'odometry': False}}
    _, steps = replayed(reckoned, ReplayOverrides(from_tracks=True, changes=changes))
    assert {odometry_of(step.telemetry) for step in steps} == {None}


def test_a_bag_of_before_is_replayed_as_it_was(small_run, tmp_path) -> None:
    path = write_bag(tmp_path / 'small', small_run)
    run, steps = replayed(path, ReplayOverrides(from_tracks=True), without_odometry)
    assert compare(run, steps, 0.0).equal
