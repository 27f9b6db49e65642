"""``visual_servo simulate``: one closed loop in memory, without ROS."""

import argparse
from contextlib import closing
from pathlib import Path

from visual_servo_epipolar.commands.arguments import scenario_of
from visual_servo_epipolar.commands.console import Progress, summary, written_to
from visual_servo_epipolar.commands.files.output import publish
from visual_servo_epipolar.commands.files.run_folder import write_run
from visual_servo_epipolar.nodes.startup.missing import require
from visual_servo_epipolar.simulation import closed_loop
from visual_servo_epipolar.simulation.mounts.registry import new_rig
from visual_servo_epipolar.simulation.run_monitor import verdict
from visual_servo_epipolar.simulation.views import view_of


def simulate(options: argparse.Namespace) -> int:
    """Run, write, print; return 0 if the robot arrived."""
    if options.out is not None:
        require('matplotlib', otherwise='leave out --out')
    scenario = scenario_of(options)
    settings = scenario.loop(tuple(options.start), options.seed)
    with closing(Progress()) as progress:
        progress.say('preparing the world ...')
        view = view_of(scenario, options.source, options.seed)
        log = closed_loop.run(settings, view, scenario.camera.nominal_camera, watch=progress)
    result = verdict(log, new_rig(scenario.camera))
    text = summary(result)
    if options.out is not None:
        written = write_run(log, scenario, Path(options.out))
        text += f'\n{written_to(options.out, written)}'
    publish(result, text, options.json)
    return 0 if log.outcome == 'arrived' else 1
