"""Images of a camera in motion: each row is what the camera sees as that row is exposed."""

from dataclasses import replace

import numpy as np
import pytest

from visual_servo_epipolar.core.geometry.motion import integrate, Pose, STANDSTILL, Twist
from visual_servo_epipolar.simulation.bases import LEVEL, Nod
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.cameras import CameraSettings
from visual_servo_epipolar.simulation.sensor import CameraMotion

SMALL = CameraSettings(
    width=160, height=128, focal_length=96.2, principal_u=79.2, principal_v=63.8, noise=0.0
)
BARREL = replace(SMALL, distortion=(-0.2, 0.03, 0.0, 0.0, 0.0))
FISHEYE = replace(SMALL, distortion_model='equidistant', focal_length=60.0)
HERE, READOUT = Pose.from_start(0.4, -2.0, 8.0), 0.033


def taken(
    settings: CameraSettings, twist: Twist = STANDSTILL, pose: Pose = HERE, nod: Nod = LEVEL
) -> np.ndarray:
    return CameraSimulator(settings).capture(pose, 0, CameraMotion(twist, nod)).astype(float)


@pytest.mark.parametrize('settings', [SMALL, BARREL, FISHEYE], ids=['pinhole', 'barrel', 'wide'])
@pytest.mark.parametrize('twist', [Twist(0.0, 1.0), Twist(0.5, -0.7)], ids=['turn', 'arc'])
def test_each_row_is_what_is_seen_as_it_is_read_out(settings, twist) -> None:
    image = taken(replace(settings, readout=READOUT), twist)
    misses = {
        readout: sum(
            np.abs(
                image[row, 20:140]
                - taken(settings, pose=integrate(HERE, twist, readout * row / settings.height))[
                    row, 20:140
                ]
            ).mean()
            for row in (30, 80, 120)
        )
        for readout in (0.0, READOUT - 0.006, READOUT, READOUT + 0.006)
    }
    assert min(misses, key=misses.__getitem__) == READOUT


def test_each_row_leans_as_the_body_does_while_it_is_read_out() -> None:
    nod = Nod(0.01, 1.0)
    image = taken(replace(SMALL, readout=READOUT), nod=nod)
    misses = [
        sum(
            np.abs(image[row] - taken(SMALL, nod=Nod(0.01 + late * row / 128))[row]).mean()
            for row in (10, 60, 115)
        )
        for late in (0.0, READOUT - 0.006, READOUT, READOUT + 0.006)
    ]
    assert np.argmin(misses) == 2


def test_a_shutter_that_is_open_blurs_along_the_motion() -> None:
    still = taken(SMALL)
    blurred = taken(replace(SMALL, shutter=0.05), Twist(0.0, 1.0))  # by 4.8 px
    across, down = (np.abs(np.diff(blurred, axis=axis)).mean() for axis in (1, 0))
    assert across < 0.6 * np.abs(np.diff(still, axis=1)).mean()
    assert down > 0.6 * np.abs(np.diff(still, axis=0)).mean()


@pytest.mark.parametrize('changes', [{}, {'readout': READOUT, 'shutter': 0.02}])
def test_at_rest_or_in_an_instant_the_image_is_the_same_to_the_bit(changes) -> None:
    twist = STANDSTILL if changes else Twist(0.3, 1.0)
    np.testing.assert_array_equal(taken(replace(SMALL, **changes), twist), taken(SMALL))


def test_a_focus_that_breathes_scales_the_image() -> None:
    settings = replace(SMALL, breathing=0.05, frame_rate=2.0)  # frame 1: a quarter of its period
    image, rest = (CameraSimulator(settings).capture(HERE, frame) for frame in (1, 0))
    np.testing.assert_array_equal(rest, taken(SMALL))
    misses = [
        np.abs(taken(replace(SMALL, focal_length=zoom * SMALL.focal_length)) - image).mean()
        for zoom in (1.0, 1.04, 1.05, 1.06)
    ]
    assert np.argmin(misses) == 2
