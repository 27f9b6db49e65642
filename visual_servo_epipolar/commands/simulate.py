"""``visual_servo simulate``: one closed loop in memory, without ROS."""

import argparse
from typing import Any

from visual_servo_epipolar.commands.arguments import (
    add_run_options,
    add_start,
    scenario_of,
    write_json,
)
from visual_servo_epipolar.commands.console import Progress, summary
from visual_servo_epipolar.core.run_log import summarise
from visual_servo_epipolar.core.tracking import Tracker
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator, ImageView
from visual_servo_epipolar.simulation.closed_loop import run, View
from visual_servo_epipolar.simulation.point_world import PointWorld
from visual_servo_epipolar.simulation.scenario import Scenario


def add_to(kinds: Any) -> None:
    """Add the subcommand."""
    parser = kinds.add_parser(
        'simulate', help='one closed loop in memory, without ROS', description=__doc__
    )
    add_start(parser, None)
    parser.add_argument(
        '--source',
        choices=('features', 'images'),
        default='features',
        help='what the servo sees: noisy point features, or rendered images (default features)',
    )
    add_run_options(parser)
    parser.set_defaults(run=simulate)


def simulate(options: argparse.Namespace) -> int:
    """Run, print, write; return 0 if the robot arrived."""
    scenario, progress = scenario_of(options), Progress()
    progress.say('preparing the world ...')
    view = view_of(scenario, options.source, options.seed)
    settings = scenario.loop(tuple(options.start), options.seed)
    log = run(settings, view, scenario.camera.camera, watch=progress)
    progress.close()
    result = summarise(log)
    if options.json != '-':
        print(summary(result))
    write_json(result, options.json)
    return 0 if log.outcome == 'arrived' else 1


def view_of(scenario: Scenario, source: str, seed: int) -> View:
    """Return what stands between world and servo."""
    if source == 'features':
        return PointWorld(scenario.points, scenario.camera.camera, seed=seed)
    return ImageView(CameraSimulator(scenario.camera), Tracker(scenario.tracker))
