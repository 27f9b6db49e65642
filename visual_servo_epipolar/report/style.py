"""Style of figures: one colour a phase, the shape of the robot, settings of matplotlib."""

import math
from typing import Any

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.motion import Pose

CURRENT_COLOUR = '#D55E00'
DESIRED_COLOUR = '#0072B2'
INK, GREY = '#222222', '#8C8C8C'
REACH = 0.9  # to which a field of view is drawn [m]

FIGURE_SETTINGS: dict[Any, Any] = {
    'font.family': 'sans-serif',
    'font.size': 9.0,
    'axes.labelsize': 9.0,
    'axes.titlesize': 10.0,
    'axes.edgecolor': '#666666',
    'axes.grid': True,
    'axes.axisbelow': True,
    'axes.spines.top': False,
    'axes.spines.right': False,
    'grid.color': '#DDDDDD',
    'grid.linewidth': 0.6,
    'xtick.labelsize': 8.0,
    'ytick.labelsize': 8.0,
    'legend.fontsize': 8.0,
    'legend.frameon': False,
    'lines.linewidth': 1.3,
    'lines.solid_joinstyle': 'round',
    'savefig.facecolor': 'white',
}

FIELD_OF_VIEW = 2.0 * math.atan(640.0 / 769.0)  # of the camera LU175C in the default world [rad]

# A Pioneer 3-DX seen from above, x forward and y left of the middle of its axle [m].
_BODY = (
    *((0.20, 0.10), (0.12, 0.20), (-0.17, 0.20), (-0.25, 0.12)),
    *((-0.25, -0.12), (-0.17, -0.20), (0.12, -0.20), (0.20, -0.10)),
)
_NOSE = ((0.20, 0.0), (0.05, 0.09), (0.05, -0.09))


def phase_label(phase: str) -> str:
    """Return the name of a phase as people read it."""
    return phase.replace('_', ' ')


def rgb(colour: str) -> tuple[int, int, int]:
    """Return red, green and blue, 0-255 each, of '#RRGGBB'."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def text_colour_on(colour: str) -> str:
    """Return black or white, whichever can be read on ``colour``."""
    red, green, blue = rgb(colour)
    return '#000000' if 0.299 * red + 0.587 * green + 0.114 * blue > 135.0 else '#FFFFFF'


def robot_body(pose: Pose) -> FloatArray:
    """Return the corners of the robot at ``pose`` in the plane, shape (8, 2) [m]."""
    return _moved_to(_BODY, pose)


def robot_nose(pose: Pose) -> FloatArray:
    """Return the triangle that marks the front of the robot at ``pose``, shape (3, 2) [m]."""
    return _moved_to(_NOSE, pose)


def view_wedge(pose: Pose, *, angle: float, reach: float = REACH) -> FloatArray:
    """
    Return what a camera at ``pose`` sees, cut off at ``reach`` [m]: a sector of ``angle`` [rad].

    Shape (N, 2); the first point is the camera, unless it sees all around.
    """
    bearings = pose.theta + np.linspace(-0.5 * angle, 0.5 * angle, 37)
    rim = np.stack([np.cos(bearings), np.sin(bearings)], axis=1) * reach
    corner = np.zeros((int(angle < math.tau), 2))
    return np.concatenate([corner, rim]) + (pose.x, pose.y)


def _moved_to(shape: tuple[tuple[float, float], ...], pose: Pose) -> FloatArray:
    cos, sin = math.cos(pose.theta), math.sin(pose.theta)
    turned = np.array(shape) @ np.array([[cos, sin], [-sin, cos]])
    return np.asarray(turned + (pose.x, pose.y), dtype=np.float64)
