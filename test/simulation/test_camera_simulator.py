"""Camera simulator: what it keeps of the last image is seen in none after it."""

from dataclasses import replace

from durations import few_of
import numpy as np
import pytest

from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.disturbances import DisturbanceSettings
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings

SMALL = CameraSettings(
    width=160, height=128, focal_length=96.2, principal_u=79.2, principal_v=63.8
)
HERE, THERE = Pose.from_start(0.6, -3.0, 8.0), Pose.from_start(0.5, -2.9, 7.0)
PERSON = DisturbanceSettings(disturbed_from=0, person=0.8, shadow=0.5)


def afresh(settings: CameraSettings, pose: Pose, frame: int, **disturbances) -> np.ndarray:
    return CameraSimulator(settings, **disturbances).capture(pose, frame)


@pytest.mark.parametrize(
    'changes',
    [{}, {'noise': 0.0}, {'jitter': 0.01}, {'gain_drift': 0.1}],
)
@pytest.mark.parametrize('disturbances', few_of([DisturbanceSettings(), PERSON], keep=(1,)))
def test_a_camera_that_stands_takes_the_images_of_one_that_came(changes, disturbances) -> None:
    settings = replace(SMALL, **changes)
    camera = CameraSimulator(settings, disturbances)
    for frame, pose in enumerate([HERE, HERE, HERE, THERE, HERE]):
        expected = afresh(settings, pose, frame, disturbances=disturbances)
        np.testing.assert_array_equal(camera.capture(pose, frame), expected)


def test_a_camera_that_stands_draws_the_room_once(monkeypatch: pytest.MonkeyPatch) -> None:
    camera, drawn = CameraSimulator(SMALL), []
    render = camera.renderer.render
    monkeypatch.setattr(
        camera.renderer, 'render', lambda *where: drawn.append(where) or render(*where)
    )
    for frame, pose in enumerate([HERE, HERE, HERE, THERE, HERE]):
        camera.capture(pose, frame)
    assert [pose for pose, _ in drawn] == [HERE, THERE, HERE]


@pytest.mark.parametrize('noise', [0.0, 2.0])
def test_who_writes_into_an_image_spoils_no_other(noise: float) -> None:
    settings = replace(SMALL, noise=noise)
    camera = CameraSimulator(settings)
    camera.capture(HERE, 0)[:] = 0
    np.testing.assert_array_equal(camera.capture(HERE, 1), afresh(settings, HERE, 1))


def test_cameras_of_two_rooms_and_seeds_keep_apart() -> None:
    settings = [SMALL, replace(SMALL, seed=1), replace(SMALL, scene_seed=2)]
    cameras = [CameraSimulator(each) for each in settings]
    images = [[camera.capture(HERE, frame) for camera in cameras] for frame in range(2)]
    for k in reversed(range(3)):  # one room is kept
        np.testing.assert_array_equal(images[1][k], afresh(settings[k], HERE, 1))


def test_a_floor_that_begins_to_shake_moves_a_camera_that_stands() -> None:
    camera, shaken = CameraSimulator(SMALL), replace(SMALL, jitter=0.02)
    camera.capture(HERE, 0)
    camera.settings = shaken
    np.testing.assert_array_equal(camera.capture(HERE, 1), afresh(shaken, HERE, 1))


def test_disturbances_begin_and_end_before_a_camera_that_stands() -> None:
    camera = CameraSimulator(SMALL)
    for frame, disturbances in enumerate([DisturbanceSettings(), PERSON, DisturbanceSettings()]):
        camera.disturb(disturbances)
        expected = afresh(SMALL, HERE, frame, disturbances=disturbances)
        np.testing.assert_array_equal(camera.capture(HERE, frame), expected)
