"""A goal: its first photograph defines it, and its features know it."""

import numpy as np

from visual_servo_epipolar.core.goal import Goal, GoalView, NO_GOAL

NOON, DUSK = np.full((4, 6), 200, np.uint8), np.full((4, 6), 20, np.uint8)


def test_more_photographs_are_of_the_same_goal() -> None:
    goal: Goal[None] = Goal.of(NOON)
    both = goal.with_view(GoalView(DUSK, (0.001, 0.0, 0.0)))
    assert both.id == goal.id != NO_GOAL
    assert [view.offset[0] for view in both.views] == [0.0, 0.001]
    assert goal.differs(Goal.of(DUSK).id)
    assert not goal.differs(NO_GOAL)
