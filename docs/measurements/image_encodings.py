"""
Measures where runs on images end that come as drivers send them: python image_encodings.py.

The same starts, each image packed into a message and read from it: raw in every encoding, JPEG.
Prints how far the grey levels are off, and the ends of the runs from those of mono8.
"""

from collections.abc import Callable, Sequence
from functools import partial
import sys
from typing import Any

import cv2
import numpy as np
from sensor_msgs.msg import CompressedImage
from sensor_msgs.msg import Image as ImageMessage

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.messages import read, write
from visual_servo_epipolar.messages.encodings import ENCODINGS
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator, ImageView
from visual_servo_epipolar.simulation.closed_loop import Loop
from visual_servo_epipolar.simulation.scenario import Scenario
from visual_servo_epipolar.simulation.sensor import CameraMotion, STILL

STARTS = ((0.4, -2.5, 4.0), (-0.8, -3.2, -6.0), (1.0, -3.5, 8.0))
QUALITIES = (80, 50)
PADDING = 6  # bytes after each row

Packing = Callable[[Image], Any]


def raw(image: Image, encoding: str) -> ImageMessage:
    """Return a grey ``image`` in an encoding, with padded rows."""
    kind = ENCODINGS[encoding]
    pixels: Any = image[..., None]
    if kind.luminance is not None:
        pixels = np.full((*image.shape, 2), 128, np.uint8)
        pixels[..., kind.luminance] = image
    elif kind.channels > 1:
        pixels = np.repeat(pixels, kind.channels, axis=2)
    rows = np.pad(np.ascontiguousarray(pixels).reshape(len(image), -1), ((0, 0), (0, PADDING)))
    below = np.full((len(rows) // 2 * kind.planar, rows.shape[1]), 128, np.uint8)
    message = write.image(np.vstack([rows, below]), encoding, 0, 'camera')
    message.height, message.width = image.shape
    return message


def jpeg(image: Image, quality: int) -> CompressedImage:
    """Return ``image`` as image_transport compresses it."""
    message = CompressedImage(format='mono8; jpeg compressed ')
    encoded = cv2.imencode('.jpg', image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    message.data.frombytes(encoded.tobytes())
    return message


class PackedView(ImageView):
    """View through camera and tracker, with every image packed in a message and read from it."""

    def __init__(self, simulator: CameraSimulator, tracker: Tracker, packing: Packing) -> None:
        super().__init__(simulator, tracker)
        self._packing = packing
        tracker.set_desired(self._through(self.desired))

    def observe(self, pose: Pose, frame: int, motion: CameraMotion = STILL) -> Features:
        """Return the features seen from ``pose`` in frame number ``frame``."""
        self.image = self._through(self.simulator.capture(pose, frame, motion))
        self.features = self.tracker.track(self.image)
        return self.features

    def _through(self, image: Image) -> Image:
        return read.gray(self._packing(image))


def end(scenario: Scenario, start: Sequence[float], packing: Packing) -> Pose:
    """Return where a run from ``start`` ends, if it arrives."""
    x, y, heading = start
    view = PackedView(CameraSimulator(scenario.camera), Tracker(scenario.tracker), packing)
    log = Loop(scenario.loop((x, y, heading), 0), view, scenario.camera.nominal_camera).run()
    if log.outcome != 'arrived':
        raise SystemExit(f'a run from {start} failed: {log.reason}')
    return log.samples[-1].pose


def packings() -> dict[str, Packing]:
    """Return what to pack images in, by name, mono8 first."""
    packed: dict[str, Packing] = {name: partial(raw, encoding=name) for name in ENCODINGS}
    return packed | {f'jpeg {it}': partial(jpeg, quality=it) for it in QUALITIES}


def difference_mm(a: Pose, b: Pose) -> float:
    """Return the distance of two poses [mm]."""
    return 1e3 * float(np.hypot(a.x - b.x, a.y - b.y))


def main(scenario: Scenario, starts: Sequence[Sequence[float]]) -> None:
    """Print the table; encodings that give the same grey levels to the last bit share a run."""
    photograph = CameraSimulator(scenario.camera).photograph()
    groups: dict[bytes, list[str]] = {}
    made = packings()
    for name, packing in made.items():
        groups.setdefault(read.gray(packing(photograph)).tobytes(), []).append(name)
    reference = [end(scenario, start, made['mono8']) for start in starts]
    print(
        '| images | grey levels off, rms | end from that of mono8 [mm] | end from the goal [mm] |'
    )
    print('|---|---|---|---|')
    for gray, names in groups.items():
        off = np.frombuffer(gray, np.uint8).astype(float) - photograph.ravel()
        ends = [end(scenario, start, made[names[0]]) for start in starts]
        apart = max(map(difference_mm, ends, reference))
        goal = ', '.join(f'{difference_mm(item, Pose(0.0, 0.0, 0.0)):.2f}' for item in ends)
        rms = float(np.sqrt((off**2).mean()))
        print(f'| {", ".join(names)} | {rms:.2f} | {apart:.2f} | {goal} |', flush=True)


if __name__ == '__main__':
    main(Scenario(), STARTS[: int(sys.argv[1]) if len(sys.argv) > 1 else len(STARTS)])
