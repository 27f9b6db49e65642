"""What a way shows, to the check of the motion."""

import numpy as np
from servo_states import in_phase, SETTINGS, sight

from visual_servo_epipolar.core.perception.observation import Observation
from visual_servo_epipolar.core.servo.checking import parallax_of_way
from visual_servo_epipolar.core.servo.phases.table import Phase


def seen(count: int) -> Observation:
    rays = np.tile([0.28, 0.0, 0.96], (count, 1))
    return Observation(10**8, rays, rays, 769.0, ids=np.arange(count))


def test_a_metre_shows_the_part_of_the_parallax_that_it_is_of_the_distance() -> None:
    measurement = sight(parallax=0.08)
    near = parallax_of_way(
        in_phase(Phase.RETREATING, distance=2.0), measurement, seen(20), SETTINGS
    )
    far = parallax_of_way(
        in_phase(Phase.RETREATING, distance=80.0), measurement, seen(20), SETTINGS
    )
    assert near > 3.9 * far > 0.0  # a distance beyond initial_distance, 8 m, counts as that


def test_no_way_is_expected_to_be_seen_near_the_goal_or_by_no_feature() -> None:
    state = in_phase(Phase.MATCHING_FEATURES, distance=2.0)
    assert parallax_of_way(state, sight(parallax=1e-4), seen(20), SETTINGS) == 0.0
    carried = sight(parallax=0.08, bearings=None)
    assert parallax_of_way(state, carried, seen(0), SETTINGS) == 0.0
