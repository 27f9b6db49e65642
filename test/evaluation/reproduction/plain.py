"""
Simulation 1 a second time, from the paper's equations alone: nothing of the package is used.

Epipoles come from (5) and (6) and not from images, the integrator is SciPy's.
"""

import numpy as np
from scipy.integrate import solve_ivp

F, K1, K2, B, KT, TOLERANCE = 0.03, 0.5, 0.5, 5 / 9, 100.0, 1e-9


def epipoles(x, y, th):
    return F * (x * np.sin(th) - y * np.cos(th)) / (x * np.cos(th) + y * np.sin(th)), F * x / y


def first_step(_, q, moving):
    x, y, th, dh = q
    ea, ed = epipoles(x, y, th)
    p = K2 * np.sign(ed) * abs(ed) ** B * moving
    u1 = np.sign(ea * ed) * dh * F * np.sqrt(ea**2 + F**2) / (ea * (ed**2 + F**2)) * p
    u2 = -F / (ea**2 + F**2) * K1 * ea + F / (ed**2 + F**2) * p
    return [u1 * np.cos(th), u1 * np.sin(th), u2, F**2 * dh * p / (ea * (ed**2 + F**2))]


def second_step(_, q, radius, z):  # points at (radius, z) from the axis, robot on the axis
    d = np.mean((F * radius / (z - q[0])) ** 2 - (F * radius / z) ** 2)
    return [-KT * d]


def drive(right_hand_side, span, q, args, value=None):
    def event(t, q, *args):
        return value(q) - TOLERANCE

    event.terminal = True
    events = None if value is None else event
    exact = {'rtol': 1e-12, 'atol': 1e-14, 'method': 'DOP853', 'dense_output': True}
    return solve_ivp(right_hand_side, span, q, args=args, events=events, **exact)


def simulation_1(duration, points):
    """Return the three stages as SciPy's solutions, and the time at which e_du is zero."""
    one = drive(first_step, (0, 5), [1, 1, np.pi / 2, 2], (1,), lambda q: epipoles(*q[:3])[1])
    ratio = one.y[3, -1] / np.hypot(*one.y[:2, -1])
    zeroed = one.t[-1] + TOLERANCE ** (1 - B) / (K2 * (1 - B) * ratio)  # the rest of (15)
    two = drive(first_step, (one.t[-1], 60), one.y[:, -1], (0,), lambda q: epipoles(*q[:3])[0])
    radius, z = np.hypot(*points[:, :2].T), points[:, 2]
    three = drive(second_step, (0, duration), two.y[1:2, -1], (radius, z))
    return one, two, three, zeroed
