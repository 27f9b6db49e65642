"""
Draws docs/extensions_ways.png and docs/extensions_panorama.jpg, for docs/extensions.md.

`python docs/extensions_figure.py [FOLDER]`: ways home from starts around the goal with a pinhole
camera, a fisheye and a panorama, point features, nominal, law smooth; and a photograph of 360 deg
with the features that are tracked in it.
"""

from collections.abc import Sequence
from pathlib import Path
import sys

import cv2
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
import numpy as np

from visual_servo_epipolar.commands.arguments import rig_path
from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.laws.registry import phase_colour
from visual_servo_epipolar.core.servo.run_log import RunLog
from visual_servo_epipolar.report.style import FIGURE_SETTINGS, INK
from visual_servo_epipolar.simulation import views
from visual_servo_epipolar.simulation.regions import start_in
from visual_servo_epipolar.simulation.scenario import load

RIGS, RUNS, SEED = ('pinhole', 'fisheye', 'panorama'), 12, 5
FOLDER = Path(__file__).parent
LOOK_FROM, FEATURE = Pose.from_start(1.5, 1.0, -150.0), (40, 40, 230)


def drive(rig: str) -> list[RunLog]:
    """Return the runs of a rig from the starts of region around that it can see from."""
    runs = []
    for index in range(RUNS):
        seed = 1000 * SEED + index
        scenario = load(None, rig_path(rig)).with_servo({'law': 'smooth'}).seeded(seed)
        runs.append(views.drive(scenario, start_in('around', SEED, index, scenario), seed))
    return runs


def draw(logs: dict[str, Sequence[RunLog]]) -> Figure:
    """Draw the ways of each rig beside the others."""
    figure = Figure(figsize=(9.6, 3.6), layout='constrained')
    FigureCanvasAgg(figure)
    maps = figure.subplots(1, len(logs), sharey=True)
    for axes, (rig, runs) in zip(maps, logs.items(), strict=True):
        _map(axes, rig, runs)
    maps[0].set_ylabel('y [m]')
    return figure


def _map(axes: Axes, rig: str, runs: Sequence[RunLog]) -> None:
    for log in runs:
        for before, after in zip(log.samples, log.samples[1:], strict=False):
            x, y = (before.pose.x, after.pose.x), (before.pose.y, after.pose.y)
            axes.plot(x, y, color=phase_colour(before.phase.value))
        start = log.samples[0].pose
        axes.plot(start.x, start.y, 'o', color=INK, markersize=3.0)
    axes.plot(0.0, 0.0, '^', color=INK, markersize=6.0)
    axes.set(title=rig, aspect='equal', xlim=(-6.0, 6.0), ylim=(-7.0, 5.0), xlabel='x [m]')


def panorama() -> Image:
    """Return an image of 360 deg, beside the goal and turned away, with its features."""
    scenario = load(None, rig_path('panorama_small'))
    view = views.view_of(scenario, 'images', 0)
    pixels = view.observe(LOOK_FROM, 0).current
    image = cv2.cvtColor(view.image, cv2.COLOR_GRAY2BGR)  # type: ignore[attr-defined]
    for u, v in np.rint(pixels).astype(int).tolist():
        cv2.circle(image, (u, v), 5, FEATURE, 1, cv2.LINE_AA)
    return np.asarray(image, np.uint8)


def main(folder: Path = FOLDER) -> None:
    """Draw both into ``folder``."""
    with rc_context(FIGURE_SETTINGS):
        draw({rig: drive(rig) for rig in RIGS}).savefig(folder / 'extensions_ways.png', dpi=110)
    quality = [cv2.IMWRITE_JPEG_QUALITY, 75]
    cv2.imwrite(str(folder / 'extensions_panorama.jpg'), panorama(), quality)


if __name__ == '__main__':
    main(*map(Path, sys.argv[1:]))
