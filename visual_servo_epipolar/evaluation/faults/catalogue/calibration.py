"""Faults of calibration and of the photograph: what is told is not so."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from visual_servo_epipolar.core.arrays import Image as Pixels
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.evaluation.faults.catalogue.fault import (
    always,
    at_first,
    Fault,
    Faults,
    Strike,
    striking,
    StruckRun,
)
from visual_servo_epipolar.evaluation.live.wire import Envelope, HOP_NS
from visual_servo_epipolar.evaluation.live.world import WorldSettings
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings

INFO, DESIRED = '/camera_info', '/desired/image_raw'
SCALES = (0.25, 0.35, 0.5, 0.7, 1.4, 2.0, 2.8, 4.0)
FOCAL_RATIOS = (0.8, 0.85, 1.2, 1.25)


def _wrong_focal(settings: WorldSettings, rng: np.random.Generator) -> WorldSettings:
    ratio = float(rng.choice(FOCAL_RATIOS))
    return replace(settings, camera=replace(settings.camera, believed_focal_ratio=ratio))


@striking
def _info(scene: StruckRun, change: Callable[[Any], object]) -> None:
    """Change what camera_info says, from now on."""
    scene.alter(INFO, change)


def _lens(model: str, *coefficients: float) -> Strike:
    def change(info: Any) -> None:
        info.distortion_model, info.d = model, list(coefficients)

    return _info(change)


def _longer(info: Any) -> None:
    info.k[0], info.k[4] = 1.3 * info.k[0], 1.3 * info.k[4]


def _transpose(info: Any) -> None:
    info.k = np.asarray(info.k).reshape(3, 3).T.ravel()


def _scale_matrix(scene: StruckRun) -> None:
    """Let K be that of images of another size, or of another lens."""
    ratio, whole = float(scene.rng.choice(SCALES)), scene.hits(0.5)
    scene.notes.append(f'{"K" if whole else "focal length"} times {ratio:g}')

    def scale(info: Any) -> None:
        k = np.array(info.k)
        k[[0, 4, 2, 5] if whole else [0, 4]] *= ratio
        info.k = k

    scene.alter(INFO, scale)


def _focal(value: float) -> Strike:
    def change(info: Any) -> None:
        info.k[0] = value

    return _info(change)


def _larger(info: Any) -> None:
    info.width, info.height = 2 * info.width, 2 * info.height


def _flickering(scene: StruckRun) -> None:
    """Let two cameras speak in turns."""
    scene.alter(INFO, lambda info: _longer(info) if scene.hits(0.5) else None)


@striking
def photograph(scene: StruckRun, pixels: Callable[[StruckRun], Pixels]) -> None:
    """Let somebody publish another photograph."""
    message: Any = write.image(pixels(scene), 'mono8', 0, 'camera_optical_frame')
    scene.filter(DESIRED, lambda envelope: [replace(envelope, message=message)])
    scene.world.wire.send(Envelope(DESIRED, message, 2 * HOP_NS))


def _other_room(scene: StruckRun) -> Pixels:
    return taken(replace(scene.world.settings.camera, scene_seed=77), DESIRED_POSE)


def _other_pose(scene: StruckRun) -> Pixels:
    goal, turn = DESIRED_POSE, scene.draw(-0.05, 0.05)
    pose = Pose(goal.x + scene.draw(-0.2, 0.2), goal.y - scene.draw(0.1, 0.3), goal.theta + turn)
    return taken(scene.world.settings.camera, pose)


def _black(scene: StruckRun) -> Pixels:
    camera = scene.world.settings.camera
    return np.zeros((camera.height, camera.width), np.uint8)


def taken(camera: CameraSettings, pose: Pose) -> Pixels:
    """Return an image as the camera takes it."""
    return CameraSimulator(camera).capture(pose, 0)


FAULTS: Faults = {
    'focal_wrong': at_first('focal length told 15 to 25 % wrong', prepare=_wrong_focal),
    'lens_wrong': at_first(
        'told a distortion that is not there', _lens('plumb_bob', -0.35, 0.12, 0.0, 0.0, 0.0)
    ),
    'lens_fisheye': at_first('told a fisheye', _lens('equidistant', 0.0, 0.0, 0.0, 0.0)),
    'matrix_transposed': at_first('K column by column', _info(_transpose)),
    'matrix_scaled': at_first(
        'K, or its focal length alone, of 1/4 to 4 times the size', _scale_matrix
    ),
    'info_missing': always('no camera_info', lambda scene: scene.lose(INFO)),
    'info_uncalibrated': always('K[0] of camera_info is 0', _focal(0.0)),
    'info_nan': always('K[0] is nan', _focal(np.nan)),
    'info_changes': Fault('another focal length in mid-run', _info(_longer)),
    'info_flickers': always('two cameras in turns', _flickering),
    'info_larger': always('camera_info of larger images', _info(_larger)),
    'photograph_other_room': always('a photograph of another room', photograph(_other_room)),
    'photograph_other_pose': Fault('another photograph in mid-run', photograph(_other_pose)),
    'photograph_black': always('a black photograph', photograph(_black)),
}
