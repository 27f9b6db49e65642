"""Prints the table of tracking.md on photographs of the same and of another room."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
import sys

import numpy as np

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.errors import TrackingError
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.tracking.matching import desired_view, DesiredView, match
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.regions import start_in
from visual_servo_epipolar.simulation.scenario import load, Scenario

SCENARIOS = Path(__file__).parents[2] / 'config' / 'scenarios'
ROOMS, STARTS = range(1, 9), 5  # photographs; views of each room from either region
REGIONS = ('front', 'anywhere')


def small_room() -> Scenario:
    """Return the furnished room through the camera of the poor one."""
    poor = load(SCENARIOS / 'poor_texture.yaml')
    return replace(poor, camera=replace(poor.camera, scene='room'))


def views(scenario: Scenario, region: str) -> Iterator[tuple[int, DesiredView, list[Image]]]:
    """Yield seed, photograph and views of each room."""
    for seed in ROOMS:
        here = replace(scenario, camera=replace(scenario.camera, scene_seed=seed, seed=seed))
        world = CameraSimulator(here.camera)
        starts = [start_in(region, seed, k, here, source='images') for k in range(STARTS)]
        images = [world.capture(Pose.from_start(*start), k) for k, start in enumerate(starts)]
        yield seed, desired_view(world.photograph()), images


def matches(view: DesiredView, image: Image) -> int:
    """Return the matches of a photograph with an image, 0 where it is not seen."""
    try:
        return len(match(view, image).indices)
    except TrackingError:
        return 0


def row(name: str, region: str, scenario: Scenario) -> str:
    """Return how many pairs are found, of the same and of another room."""
    rooms = list(views(scenario, region))
    same = [matches(view, image) for _, view, images in rooms for image in images]
    others = [
        matches(view, images[seed % STARTS])
        for seed, view, _ in rooms
        for other, _, images in rooms
        if other != seed
    ]
    return (
        f'| {name} | {region} | {sum(n > 0 for n in same)} of {len(same)} | '
        f'{min(same)} / {np.median(same):.0f} | {sum(n > 0 for n in others)} of {len(others)} |'
    )


def main() -> None:
    """Print a row for each scenario and region as it is there."""
    print('| images | starts | same room: seen | matches, least / median | another room: seen |')
    print('|---|---|---|---|---|')
    scenarios = {'320x256': small_room(), '640x480': load(SCENARIOS / 'small.yaml')}
    for name, scenario in scenarios.items():
        for region in REGIONS:
            print(row(name, region, scenario), flush=True)


if __name__ == '__main__':
    sys.exit(main())
