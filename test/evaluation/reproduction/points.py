"""
The experiment with point features: arithmetic alone, which any machine repeats.

Run as a script it stores the data behind figures 17 to 20 anew. Those of the whole reproduction,
figures.json, are what ``visual_servo reproduce all --out DIR`` writes into DIR.
"""

from pathlib import Path

from matplotlib.figure import Figure
import numpy as np

from visual_servo_epipolar.evaluation.reproduction import experiment
from visual_servo_epipolar.evaluation.reproduction.chapters import one_line_each, POINTS
from visual_servo_epipolar.evaluation.reproduction.experiment import (
    drive,
    Experiment,
    experiment_scenario,
)
from visual_servo_epipolar.evaluation.reproduction.paper import figure_data, thin
from visual_servo_epipolar.simulation.views import points_of

STORED = Path(__file__).with_name('figures_points.json')


def experiment_with_points() -> Experiment:
    """Drive as in the experiment, with points instead of images."""
    world = experiment_scenario(0)
    camera = world.camera
    view = points_of(world, 0)
    blank = np.full((camera.height, camera.width), 200, np.uint8)
    return drive(world, view, blank, lambda _: None)


def drawn(run: Experiment) -> dict[str, Figure]:
    """Return figures 17 to 20."""
    return {
        'figure_17': experiment.epipoles(run),
        'figure_18': experiment.difference(run),
        'figure_19': experiment.snapshots(run, 19),
        'figure_20': experiment.snapshots(run, 20),
    }


if __name__ == '__main__':
    shown = drawn(experiment_with_points())
    data = {name: thin(figure_data(figure), POINTS) for name, figure in shown.items()}
    STORED.write_text(one_line_each(data), encoding='utf-8')
