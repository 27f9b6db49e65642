"""
How wrong features are beside the seams of a panorama that is stitched from two lenses.

`python docs/measurements/stitching_bands.py`: of images of 960x480 from poses near the goal and
beside it, tracked against the photograph, by the angle to the nearer seam. The truth is what each
lens sees from its own centre, 0.1 m apart.
"""

from dataclasses import replace

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.mounts.camera_settings import TwoLensSettings

CAMERA = TwoLensSettings(width=960, height=480, distortion_model='equirectangular')
BANDS = (0.0, 2.0, 5.0, 10.0, 20.0, 90.0)  # from the seam [deg]
NEAR = tuple((0.05 * k, -0.1 * k, 2.0 * k) for k in range(1, 5))
FAR = tuple((0.4 * k, -0.3 * k, 25.0 * k) for k in range(1, 5))
FRAMES, WRONG_PX = 4, 3.0
LENSES = (1.0, -1.0)  # ahead and behind


def main() -> None:
    """Print a table."""
    both = CameraSimulator(CAMERA)
    half = 0.5 * CAMERA.lens_baseline
    lens = {
        side: CameraSimulator(replace(CAMERA, lens_baseline=0.0, mount_forward=side * half))
        for side in LENSES
    }
    for name, starts in (('near', NEAR), ('far', FAR)):
        angles, errors = [], []
        for start in starts:
            tracker = Tracker(TrackerSettings(max_features=200), both.camera)
            tracker.set_desired(both.photograph())
            pose = Pose.from_start(*start)
            for frame in range(FRAMES):
                features = tracker.track(both.capture(pose, frame))
            there, angle = _truth(lens, features.desired, pose, both)
            angles.append(angle)
            errors.append(np.linalg.norm(_around(features.current - there), axis=1))
        _print(name, np.degrees(np.concatenate(angles)), np.concatenate(errors))


def _truth(
    lens: dict[float, CameraSimulator], desired: FloatArray, pose: Pose, both: CameraSimulator
) -> tuple[FloatArray, FloatArray]:
    """Return where features are in the image from ``pose``, and their angle to a seam."""
    behind = both.camera.rays(desired)[:, 2] < 0.0
    points = _by_lens(
        behind, *(lens[side].renderer.trace(desired, DESIRED_POSE) for side in LENSES)
    )
    seen = [lens[side].renderer.project(points, pose)[0] for side in LENSES]
    rays = [both.camera.rays(pixels)[:, 2] for pixels in seen]
    current = _by_lens(np.abs(rays[1]) > np.abs(rays[0]), *seen)
    for side, mine in ((1, rays[1] < 0.0), (0, rays[0] >= 0.0)):
        current[mine] = seen[side][mine]
    return current, np.abs(np.arcsin(both.camera.rays(current)[:, 2]))


def _by_lens(behind: BoolArray, ahead: FloatArray, back: FloatArray) -> FloatArray:
    return np.where(behind[:, None], back, ahead)


def _around(offset: FloatArray) -> FloatArray:
    u = offset[:, 0] - CAMERA.width * np.rint(offset[:, 0] / CAMERA.width)
    return np.column_stack([u, offset[:, 1]])


def _print(name: str, angles: FloatArray, errors: FloatArray) -> None:
    for low, high in zip(BANDS, BANDS[1:], strict=False):
        chosen = errors[(angles >= low) & (angles < high)]
        wrong = float((chosen > WRONG_PX).mean()) if len(chosen) else 0.0
        median = float(np.median(chosen)) if len(chosen) else float('nan')
        where = f'{name}, {low:g} to {high:g} deg'
        print(f'{where}: {len(chosen)} features, {median:.2f} px, {wrong:.1%} wrong')


if __name__ == '__main__':
    main()
