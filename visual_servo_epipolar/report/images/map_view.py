"""Live map beside the camera picture: the robot, its path, the goal."""

from dataclasses import dataclass, replace
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.core.laws.registry import phase_colour
from visual_servo_epipolar.core.servo.run_log import Sample
from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.report.images.drawing import (
    BGR,
    bgr,
    draw_label,
    draw_lines,
    draw_text,
    fill,
    text_size,
)
from visual_servo_epipolar.report.style import (
    FIELD_OF_VIEW,
    INK,
    phase_label,
    robot_body,
    robot_nose,
    view_wedge,
)

WIDTH = 560  # of the map [px]
HEADER, LEFT, BOTTOM, RIGHT = 124, 64, 58, 16  # margins around the plane [px]
CLEARANCE = 0.65  # of the robot's axle from the border of the map [m]: body and wedge fit
GREY: BGR = (175, 175, 175)
GRID: BGR = (228, 228, 228)
GRID_STEPS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)  # [m]


@dataclass(frozen=True, slots=True)
class MapBounds:
    """Bounds of the map in the plane [m]: the robot's axle is to stay inside."""

    x_min: float
    x_max: float
    y_min: float
    y_max: float

    @classmethod
    def around(cls, start: Pose) -> 'MapBounds':
        """Build bounds that hold the start and the goal."""
        return cls(min(start.x, 0.0), max(start.x, 0.0), min(start.y, 0.0), max(start.y, 0.0))

    def holds(self, pose: Pose) -> bool:
        """Whether the axle of the robot at ``pose`` is inside."""
        return self.x_min <= pose.x <= self.x_max and self.y_min <= pose.y <= self.y_max

    def grown(self, pose: Pose) -> 'MapBounds':
        """Return bounds that hold ``pose`` too, with a margin so as not to grow at each step."""
        margin = 0.1 * max(self.x_max - self.x_min, self.y_max - self.y_min, 1.0)
        return replace(
            self,
            x_min=self.x_min if pose.x >= self.x_min else pose.x - margin,
            x_max=self.x_max if pose.x <= self.x_max else pose.x + margin,
            y_min=self.y_min if pose.y >= self.y_min else pose.y - margin,
            y_max=self.y_max if pose.y <= self.y_max else pose.y + margin,
        )


class MapView:
    """
    Map that grows with the run; each step draws one piece of path onto a kept canvas.

    ``height`` is that of the picture [px]; its width is ``WIDTH``; the robot sees
    ``field_of_view`` [rad].
    """

    def __init__(
        self, bounds: MapBounds, height: int, field_of_view: float = FIELD_OF_VIEW
    ) -> None:
        self._bounds, self._height, self._angle = bounds, height, field_of_view
        self._samples: list[Sample] = []
        self._fit()

    def add(self, sample: Sample) -> None:
        """Take one control step into the path."""
        self._samples.append(sample)
        if not self._bounds.holds(sample.pose):
            self._bounds = self._bounds.grown(sample.pose)
            self._fit()
        elif len(self._samples) == 1:
            self._draw_start()
        else:
            self._draw_step(self._samples[-2], sample)

    def picture(self) -> Image:
        """Return the map as of now, shape (height, WIDTH, 3); black on white if nothing came."""
        picture = self._canvas.copy()
        if self._samples:
            self._draw_robot(picture, self._samples[-1])
            self._draw_header(picture, self._samples[-1])
        return picture

    def pixels(self, points: FloatArray) -> FloatArray:
        """Return where ``points`` of the plane, shape (N, 2) [m], are in the picture [px]."""
        return self._origin + self._scale * np.asarray(points) * (1.0, -1.0)

    def _fit(self) -> None:
        """Choose the scale that shows the bounds, then draw all samples anew."""
        b = self._bounds
        area = np.array([WIDTH - LEFT - RIGHT, self._height - HEADER - BOTTOM], dtype=np.float64)
        extent = np.array([b.x_max - b.x_min, b.y_max - b.y_min]) + 2.0 * CLEARANCE
        self._scale = float((area / extent).min())
        middle = np.array([LEFT, HEADER]) + 0.5 * area
        centre = np.array([0.5 * (b.x_min + b.x_max), 0.5 * (b.y_min + b.y_max)])
        self._origin = middle - self._scale * centre * (1.0, -1.0)
        self._canvas: Image = np.full((self._height, WIDTH, 3), 255, dtype=np.uint8)
        self._draw_grid()
        self._draw_outline(self._canvas, DESIRED_POSE, GREY, 2)
        self._write_under(DESIRED_POSE, 'goal')
        if self._samples:
            self._draw_start()
        for before, after in zip(self._samples, self._samples[1:], strict=False):
            self._draw_step(before, after)

    def _draw_grid(self) -> None:
        right, bottom = WIDTH - RIGHT, self._height - BOTTOM
        low, high = self._plane((LEFT, bottom)), self._plane((right, HEADER))
        step = next((s for s in GRID_STEPS if s * self._scale >= 60.0), GRID_STEPS[-1])
        for x in _multiples(step, low[0], high[0]):
            u = self._origin[0] + self._scale * x
            draw_lines(self._canvas, np.array([[(u, HEADER), (u, bottom)]]), GRID)
            text = f'{x:g}'
            at = u - 0.5 * text_size(text, 10.0)[0], bottom + 16.0
            draw_text(self._canvas, text, at, 10.0, bgr(INK))
        for y in _multiples(step, low[1], high[1]):
            v = self._origin[1] - self._scale * y
            draw_lines(self._canvas, np.array([[(LEFT, v), (right, v)]]), GRID)
            text = f'{y:g}'
            at = LEFT - 8.0 - text_size(text, 10.0)[0], v
            draw_text(self._canvas, text, at, 10.0, bgr(INK))
        at = 0.5 * (LEFT + right) - 20.0, bottom + 40.0
        draw_text(self._canvas, 'x [m]', at, 10.0, bgr(INK))
        draw_text(self._canvas, 'y [m]', (10.0, HEADER - 12.0), 10.0, bgr(INK))

    def _plane(self, pixel: tuple[float, float]) -> FloatArray:
        return np.asarray((np.array(pixel) - self._origin) / self._scale * (1.0, -1.0))

    def _draw_start(self) -> None:
        self._draw_outline(self._canvas, self._samples[0].pose, GREY, 1)
        self._write_under(self._samples[0].pose, 'start')

    def _draw_step(self, before: Sample, after: Sample) -> None:
        ends = np.array([(s.pose.x, s.pose.y) for s in (before, after)])
        colour = bgr(phase_colour(before.phase.value))
        draw_lines(self._canvas, self.pixels(ends)[None], colour, 3)

    def _draw_outline(self, picture: Image, pose: Pose, colour: BGR, thickness: int) -> None:
        draw_lines(picture, self.pixels(robot_body(pose))[None], colour, thickness, closed=True)
        draw_lines(picture, self.pixels(robot_nose(pose))[None], colour, thickness, closed=True)

    def _write_under(self, pose: Pose, text: str) -> None:
        """Write beside the robot, to the left where the text would leave the map."""
        (u, v), reach = self.pixels(np.array([(pose.x, pose.y)]))[0], 0.3 * self._scale
        left = u + reach + 8.0
        if left + text_size(text, 11.0)[0] > WIDTH - RIGHT:
            left = u - reach - 8.0 - text_size(text, 11.0)[0]
        draw_text(self._canvas, text, (left, v), 11.0, bgr(INK))

    def _draw_robot(self, picture: Image, sample: Sample) -> None:
        colour = bgr(phase_colour(sample.phase.value))
        wedge = view_wedge(sample.pose, angle=self._angle, reach=0.6)
        draw_lines(picture, self.pixels(wedge)[None], colour, 1, closed=True)
        self._draw_outline(picture, sample.pose, colour, 2)
        fill(picture, self.pixels(robot_nose(sample.pose)), colour)

    def _draw_header(self, picture: Image, sample: Sample) -> None:
        picture[: HEADER - 24] = 245
        phase = sample.phase.value
        draw_label(picture, phase_label(phase), (16.0, 28.0), 14.0, phase_colour(phase))
        time = (sample.stamp_ns - self._samples[0].stamp_ns) / NANOSECONDS
        text = f'{time:.1f} s'
        at = WIDTH - 16.0 - text_size(text, 15.0)[0], 28.0
        draw_text(picture, text, at, 15.0, bgr(INK))
        values = (
            f'v {sample.twist.linear:+.2f} m/s',
            f'w {math.degrees(sample.twist.angular):+.1f} deg/s',
            _distance(sample.pose.distance),
        )
        for column, value in enumerate(values):
            draw_text(picture, value, (16.0 + 184.0 * column, 72.0), 12.0, bgr(INK))


def _distance(distance: float) -> str:
    """Return the distance as text, in the unit that leaves three digits."""
    return f'd {distance:.2f} m' if distance >= 0.1 else f'd {1000.0 * distance:.1f} mm'


def _multiples(step: float, low: float, high: float) -> list[float]:
    return [step * k for k in range(math.ceil(low / step), math.floor(high / step) + 1)]
