"""Live map beside the camera picture: the robot, its path, the goal, on a grid of metres."""

import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.core.laws.registry import phase_colour
from visual_servo_epipolar.core.servo.run_log import Sample
from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.report.images.drawing import BGR, bgr, draw_lines, draw_text, fill
from visual_servo_epipolar.report.style import (
    FIELD_OF_VIEW,
    FIGURE_SETTINGS,
    GREY,
    INK,
    robot_body,
    robot_nose,
    view_wedge,
)

WIDTH = 560  # of the map [px]


class MapView:
    """
    Map of a run from ``start``; each step draws one piece of path onto a kept canvas.

    ``height`` is that of the picture [px]; its width is ``WIDTH``; the robot sees
    ``field_of_view`` [rad].
    """

    def __init__(self, start: Pose, height: int, field_of_view: float = FIELD_OF_VIEW) -> None:
        # A metre around start and goal: a robot that backs off farther leaves the map.
        low = np.minimum(0.0, (start.x, start.y)) - 1.0
        high = np.maximum(0.0, (start.x, start.y)) + 1.0
        size = np.array([WIDTH, height])
        self._scale = float((size / (high - low)).min())
        self._origin = 0.5 * (size - self._scale * (low + high) * (1.0, -1.0))
        self._angle = field_of_view
        self._first: Sample | None = None
        self._last: Sample | None = None
        self._canvas: Image = np.full((height, WIDTH, 3), 255, dtype=np.uint8)
        reach = math.ceil(max(WIDTH, height) / self._scale + np.abs((low, high)).max())
        grid, grey = bgr(FIGURE_SETTINGS['grid.color']), bgr(GREY)
        for k in range(-reach, reach + 1):
            lines = np.array([[(k, -reach), (k, reach)], [(-reach, k), (reach, k)]])
            draw_lines(self._canvas, self.pixels(lines), grid)
        self._draw_outline(self._canvas, DESIRED_POSE, grey, 2)
        self._draw_outline(self._canvas, start, grey, 1)

    def add(self, sample: Sample) -> None:
        """Take one control step into the path."""
        before = self._last or sample
        self._first, self._last = self._first or sample, sample
        ends = np.array([(it.pose.x, it.pose.y) for it in (before, sample)])
        colour = bgr(phase_colour(before.phase.value))
        draw_lines(self._canvas, self.pixels(ends)[None], colour, 3)

    def picture(self) -> Image:
        """Return the map as of now, shape (height, WIDTH, 3), BGR."""
        picture = self._canvas.copy()
        first, last = self._first, self._last
        if first and last:
            colour = bgr(phase_colour(last.phase.value))
            wedge = view_wedge(last.pose, angle=self._angle, reach=0.6)
            draw_lines(picture, self.pixels(wedge)[None], colour, 1, closed=True)
            self._draw_outline(picture, last.pose, colour, 2)
            fill(picture, self.pixels(robot_nose(last.pose)), colour)
            time = (last.stamp_ns - first.stamp_ns) / NANOSECONDS
            text = f'{time:.1f} s    {last.pose.distance:.3f} m from the goal    grid 1 m'
            draw_text(picture, text, (16.0, 24.0), 12.0, bgr(INK))
        return picture

    def pixels(self, points: FloatArray) -> FloatArray:
        """Return where ``points`` of the plane, shape (..., 2) [m], are in the picture [px]."""
        return self._origin + self._scale * np.asarray(points) * (1.0, -1.0)

    def _draw_outline(self, picture: Image, pose: Pose, colour: BGR, thickness: int) -> None:
        for shape in (robot_body(pose), robot_nose(pose)):
            draw_lines(picture, self.pixels(shape)[None], colour, thickness, closed=True)
