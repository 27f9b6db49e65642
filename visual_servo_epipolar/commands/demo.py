"""A demo: the four real nodes in lockstep; leaves result, figures, video, bag."""

import argparse
from contextlib import closing, ExitStack
from dataclasses import replace
import math
from pathlib import Path
import re
import shutil
import sys
from typing import TYPE_CHECKING

from visual_servo_epipolar.commands.arguments import scenario_of
from visual_servo_epipolar.commands.console import Progress, summary, written_to
from visual_servo_epipolar.commands.options import EXCLUDED
from visual_servo_epipolar.commands.outputs import publish
from visual_servo_epipolar.commands.simulate import write_run
from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.servo.run_log import RunLog, Sample
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.files import made_folder
from visual_servo_epipolar.nodes.startup.missing import require
from visual_servo_epipolar.simulation.closed_loop import LoopSettings, RunMonitor, verdict
from visual_servo_epipolar.simulation.scenario import Scenario

if TYPE_CHECKING:
    from visual_servo_epipolar.nodes.lockstep import Lockstep
    from visual_servo_epipolar.report.images.video import VideoWriter

BAG, VIDEO = 'bag', 'video.mp4'


def run(options: argparse.Namespace) -> int:
    """Run, write, print; return 0 if the robot arrived."""
    require('rclpy', 'matplotlib', load=False)
    if options.bag != 'none':
        require('rosbags', 'mcap', otherwise='--bag none', load=False)
    scenario = scenario_of(options)
    settings = scenario.loop(tuple(options.start), options.seed)
    folder = Path(options.out)
    _clear(folder / BAG)
    (folder / VIDEO).unlink(missing_ok=True)  # of an earlier run
    with ExitStack() as stack:
        stack.enter_context(made_folder(folder))
        progress = stack.enter_context(closing(Progress()))
        video = None
        if not options.no_video and (video := _video(scenario, settings, folder)) is not None:
            stack.enter_context(video)
        progress.say('starting four nodes ...')
        from visual_servo_epipolar.nodes.lockstep import Lockstep

        with Lockstep(scenario, settings) as nodes:
            log = _drive(nodes, settings, options, video, progress)
        result = verdict(log, scenario.camera.rig())
        progress.say('drawing figures ...')
        written = write_run(log, scenario, folder)
    written += [VIDEO] * (video is not None) + [BAG] * (options.bag != 'none')
    publish(result, f'{summary(result)}\n{written_to(folder, written)}', options.json)
    return 0 if log.outcome == 'arrived' else 1


def _drive(
    nodes: 'Lockstep',
    settings: LoopSettings,
    options: argparse.Namespace,
    video: 'VideoWriter | None',
    progress: Progress,
) -> RunLog:
    from visual_servo_epipolar.nodes.lockstep import ObserverNode

    monitor = RunMonitor(settings)

    def watch(sample: Sample, image: Image | None, features: Features | None) -> None:
        progress(sample)
        if video is not None and image is not None and features is not None:
            if settings.head is not None:  # bearings are in axes of the base, not of the image
                sample = replace(sample, bearing_current=math.nan)
            video.add(image, features, sample)

    nodes.add(ObserverNode(monitor, watch, with_images=video is not None, context=nodes.context))
    if options.bag != 'none':
        nodes.record(Path(options.out) / BAG, exclude=EXCLUDED[options.bag])
    nodes.run(lambda: monitor.done)
    return monitor.log()


def _video(scenario: Scenario, settings: LoopSettings, folder: Path) -> 'VideoWriter | None':
    """Return the video to write; None without PyAV."""
    from visual_servo_epipolar.report.images.video import pyav, VideoWriter, WHAT_TO_INSTALL

    if pyav() is None:
        print(f'visual_servo demo: no video without PyAV: {WHAT_TO_INSTALL}', file=sys.stderr)
        return None
    return VideoWriter(
        folder / VIDEO,
        scenario.camera.frame_rate,
        start=Pose.from_start(*settings.start),
        camera=scenario.camera.nominal_camera,
    )


def _clear(bag: Path) -> None:
    """Remove the bag of an earlier run, and nothing else."""
    if bag.is_dir():
        bag_file = re.compile(rf'metadata\.yaml|{bag.name}_\d+(\.mcap)?')
        foreign = [item.name for item in bag.iterdir() if not bag_file.fullmatch(item.name)]
        if foreign:
            raise InputError(
                f'{bag} must be the bag of an earlier run, to be replaced, but holds '
                f'{", ".join(sorted(foreign))}; name another folder by --out'
            )
        shutil.rmtree(bag)
