"""Folder of a run: result.json, run.json with every sample, and figures."""

from collections.abc import Mapping
from dataclasses import asdict, fields
from importlib import metadata
from pathlib import Path
from typing import Any

from visual_servo_epipolar.commands.files.output import write_json
from visual_servo_epipolar.core.servo.run_log import RunLog
from visual_servo_epipolar.files import made_folder
from visual_servo_epipolar.messages.settings_text import installed_versions
from visual_servo_epipolar.report.run_file import RunFile, save_run
from visual_servo_epipolar.simulation.mounts.registry import new_rig
from visual_servo_epipolar.simulation.run_monitor import verdict
from visual_servo_epipolar.simulation.scenario import Scenario

LIBRARIES = ('opencv-python-headless', 'opencv-python', 'matplotlib', 'rclpy', 'rosbags')


def write_run(log: RunLog, scenario: Scenario, folder: Path) -> list[str]:
    """Write result, samples and figures into ``folder``; return their names."""
    result = verdict(log, new_rig(scenario.camera))
    with made_folder(folder):
        write_json(result, str(folder / 'result.json'))
        run = save_run(RunFile(log, settings_of(scenario), versions()), folder)
        from visual_servo_epipolar.report import figures  # last: matplotlib may be broken

        return ['result.json', *(path.name for path in (run, *figures.save_all(log, folder)))]


def settings_of(scenario: Scenario) -> Mapping[str, Mapping[str, Any]]:
    """Return the settings of each part of a scenario."""
    return {item.name: asdict(getattr(scenario, item.name)) for item in fields(scenario)}


def versions() -> dict[str, str]:
    """Return the versions of this package, of Python, and of the libraries that matter."""
    found = dict(installed_versions())
    for name in LIBRARIES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found
