"""``visual_servo simulate``: one closed loop in memory, without ROS; and the folder of a run."""

import argparse
from collections.abc import Mapping
from contextlib import closing
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from visual_servo_epipolar.commands.arguments import scenario_of
from visual_servo_epipolar.commands.console import Progress, summary, written_to
from visual_servo_epipolar.commands.outputs import publish, write_json
from visual_servo_epipolar.core.servo.run_log import RunLog
from visual_servo_epipolar.files import made_folder
from visual_servo_epipolar.messages.settings_text import installed_versions
from visual_servo_epipolar.nodes.startup.missing import require
from visual_servo_epipolar.report.run_file import RunFile, save_run
from visual_servo_epipolar.simulation.closed_loop import verdict
from visual_servo_epipolar.simulation.scenario import Scenario
from visual_servo_epipolar.simulation.views import drive


def run(options: argparse.Namespace) -> int:
    """Run, write, print; return 0 if the robot arrived."""
    if options.out is not None:
        require('matplotlib', otherwise='leave out --out')
    scenario = scenario_of(options)
    with closing(Progress()) as progress:
        progress.say('preparing the world ...')
        start = tuple(options.start)
        log = drive(scenario, start, options.seed, options.source, watch=progress)
    result = verdict(log, scenario.camera.rig())
    text = summary(result)
    if options.out is not None:
        written = write_run(log, scenario, Path(options.out))
        text += f'\n{written_to(options.out, written)}'
    publish(result, text, options.json)
    return 0 if log.outcome == 'arrived' else 1


def write_run(log: RunLog, scenario: Scenario, folder: Path) -> list[str]:
    """Write result, samples and figures into ``folder``; return their names."""
    result = verdict(log, scenario.camera.rig())
    with made_folder(folder):
        write_json(result, str(folder / 'result.json'))
        run = save_run(RunFile(log, settings_of(scenario), installed_versions()), folder)
        from visual_servo_epipolar.report import figures  # last: matplotlib may be broken

        return ['result.json', *(path.name for path in (run, *figures.save_all(log, folder)))]


def settings_of(scenario: Scenario) -> Mapping[str, Mapping[str, Any]]:
    """Return the settings of each part of a scenario."""
    return {item.name: asdict(getattr(scenario, item.name)) for item in fields(scenario)}
