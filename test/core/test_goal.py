"""A goal: its photograph defines it, and its features know it."""

import numpy as np

from visual_servo_epipolar.core.goal import Goal, goal_id, NO_GOAL

NOON, DUSK = np.full((4, 6), 200, np.uint8), np.full((4, 6), 20, np.uint8)


def test_a_photograph_defines_a_goal() -> None:
    goal: Goal[None] = Goal(goal_id(NOON))
    assert goal.id != NO_GOAL
    assert goal.differs(goal_id(DUSK))
    assert not goal.differs(NO_GOAL)
