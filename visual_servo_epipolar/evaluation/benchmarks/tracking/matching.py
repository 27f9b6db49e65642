"""Matching benchmark: photographs of the simulated room in other light, inspected."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
import math
from time import process_time
from typing import Any

import numpy as np

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.perception.inspection.photographs import inspect
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.tracking.matchers.base import Matcher
from visual_servo_epipolar.core.tracking.matchers.registry import matcher_of
from visual_servo_epipolar.evaluation.tables import aligned, number, percentiles
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.choices import REGIONS
from visual_servo_epipolar.simulation.light.settings import DAY, LightSettings
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings

OPTIONS = ('matcher_model',)
RIGHT, WRONG = 1.0, 3.0  # larger error of both bearings of a right pair, and of a wrong one [deg]
NOON = 'noon'
LIGHTS = (*DAY, 'dark')
CAMERA = CameraSettings(
    width=640, height=480, focal_length=384.6, principal_u=319.5, principal_v=239.5
)
HEAD = 'matcher | light | exposure | n | trusted | right | wrong | error, median / p95 [deg] | ms'


@dataclass(frozen=True, slots=True)
class MatchingPlan:
    """How much is done: rooms, views of each, lights, exposures, kind of room."""

    rooms: Sequence[int] = tuple(range(201, 211))  # none of them served to tune a matcher
    views: int = 10
    lights: Sequence[str] = LIGHTS
    exposures: Sequence[str] = ('fixed', 'auto')
    scene: str = 'room'


QUICK = MatchingPlan(rooms=(201,), views=2, lights=(NOON, 'lamp_right'), exposures=('fixed',))


def run(
    *, seed: int, quick: bool, say: Callable[[str], None], matcher_model: str = ''
) -> dict[str, Any]:
    """Return the document of the benchmark, with the network of a file beside SIFT if given."""
    matchers = {'sift': matcher_of('sift')}
    if matcher_model:
        try:
            matchers['onnx'] = matcher_of('onnx', matcher_model)
        except ValueError as error:
            raise InputError(str(error)) from None
    return measure(QUICK if quick else MatchingPlan(), matchers, seed, say)


def measure(
    plan: MatchingPlan, matchers: Mapping[str, Matcher], seed: int, say: Callable[[str], None]
) -> dict[str, Any]:
    """Carry out ``plan``."""
    cells: dict[tuple[str, str, str], list[dict[str, Any]]] = {}
    for scene in plan.rooms:
        say(f'room {scene}')
        rng = np.random.default_rng((seed, scene))
        # In front of the goal, turned by up to 15 deg.
        poses = [
            Pose.from_start(*rng.uniform(*REGIONS['front'].box).tolist())
            for _ in range(plan.views)
        ]
        camera = replace(CAMERA, scene=plan.scene, scene_seed=scene, seed=seed + scene)
        world = CameraSimulator(camera, None, LightSettings(photograph_light=NOON, light=NOON))
        desired = world.photograph()
        for light, exposure in product(plan.lights, plan.exposures):  # a room keeps few lights
            settings = LightSettings(photograph_light=NOON, light=light, exposure=exposure)
            world = CameraSimulator(camera, None, settings)
            images = [world.capture(pose, 0) for pose in poses]
            for name, matcher in matchers.items():
                pairs = cells.setdefault((name, light, exposure), [])
                for pose, image in zip(poses, images, strict=True):
                    pairs.append(_pair(world, desired, image, pose, matcher))
    rows = [
        {
            'matcher': name,
            'light': light,
            'exposure': exposure,
            'pairs': cells[name, light, exposure],
        }
        for name, exposure, light in product(sorted(matchers), plan.exposures, plan.lights)
    ]
    return {'seed': seed, 'scene': plan.scene, 'rows': rows}


def _pair(
    world: CameraSimulator, desired: Image, current: Image, pose: Pose, matcher: Matcher
) -> dict[str, Any]:
    camera, began = world.camera, process_time()
    found = inspect(desired, current, camera, camera, ServoSettings(), matcher)
    seconds, truth = process_time() - began, Bearings.from_pose(pose)
    off = (
        math.degrees(math.remainder(angle - true, math.tau))
        for angle, true in (
            (found.bearing_current, truth.current),
            (found.bearing_desired, truth.desired),
        )
        if found.trusted
    )
    return {
        'start': [pose.x, pose.y, math.degrees(pose.theta) - 90.0],
        'trusted': found.trusted,
        'reason': found.reason,
        'error_deg': max(map(abs, off)) if found.trusted else None,
        'inliers': found.inliers,
        'mean_grey': float(current.mean()),
        'ms': 1e3 * seconds,
    }


def table(document: Mapping[str, Any]) -> str:
    """Return the benchmark as text."""
    lines = [
        f'Matching, pairs of photographs in the simulated {document["scene"]}, the first taken at '
        'noon',
        f'Of trusted pairs the larger error of both bearings; right: within {RIGHT:g} deg, '
        f'wrong: > {WRONG:g} deg; ms: of processor time for both photographs',
        *aligned(HEAD, map(_row, document['rows']), left=3),
    ]
    return '\n'.join(lines)


def _row(it: Mapping[str, Any]) -> list[str]:
    pairs = it['pairs']
    errors = np.array([pair['error_deg'] for pair in pairs if pair['trusted']])
    return [
        it['matcher'],
        it['light'],
        it['exposure'],
        str(len(pairs)),
        str(len(errors)),
        f'{100.0 * float((errors <= RIGHT).sum()) / len(pairs):.0f} %',
        str(int((errors > WRONG).sum())),
        percentiles(errors, 50, 95),
        number(float(np.median([pair['ms'] for pair in pairs])), 0),
    ]


def figures(document: Mapping[str, Any]) -> dict[str, float]:
    """Return what histories compare: the share of pairs that are not right, smaller is better."""
    return {
        f'{it["matcher"]} {it["light"]} {it["exposure"]} not right': 1.0
        - float(np.mean([pair['trusted'] and pair['error_deg'] <= RIGHT for pair in it['pairs']]))
        for it in document['rows']
    }
