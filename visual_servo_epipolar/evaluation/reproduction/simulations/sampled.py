"""The first step with velocities held between images, as any robot has it, and nothing else."""

import numpy as np

from visual_servo_epipolar.core.geometry.motion import integrate
from visual_servo_epipolar.evaluation.reproduction.simulations.continuous import (
    Case,
    Instant,
    Simulation,
)


def sampled(case: Case, period: float, duration: float) -> tuple[Instant, ...]:
    """
    Return the first step of ``case`` with a new command every ``period`` for ``duration`` [s].

    The law is the bare one: no latch, no saturation. It ends early when a point is out of view.
    """
    simulation = Simulation(case)
    pose, distance = case.start, case.initial_distance
    instants: list[Instant] = []
    while not instants or instants[-1].time < duration:
        state = np.array([pose.x, pose.y, pose.theta, distance])
        try:
            now = simulation.first(period * len(instants), state)
        except ValueError:
            break
        instants.append(now)
        pose = integrate(pose, now.twist, period)
        distance += period * float(simulation.rate(now)[3])
    return tuple(instants)
