"""Image sensor: noise, a drifting gain, blur; when rows are exposed and images stamped."""

from bisect import bisect_right
from collections import deque
import math
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from visual_servo_epipolar.core.arrays import as_gray, BoolArray, FloatArray, Image
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.geometry.motion import (
    integrate,
    motion_between,
    Pose,
    STANDSTILL,
    Twist,
)
from visual_servo_epipolar.core.geometry.rays import normalised
from visual_servo_epipolar.core.rigs.rig import AT_REST, Joints
from visual_servo_epipolar.core.stamps import NANOSECONDS, seconds_between
from visual_servo_epipolar.simulation.bases import LEVEL, Nod

DESIRED_FRAME = -1  # frame index of the desired photograph
MAX_RAY = 4.0  # farther from the axis no pinhole sees anything (76 deg)
MAX_NOISE = 50.0  # standard deviation [grey levels]
MIN_DEPTH_M = 0.3  # of what is in view
SPARE = 64  # how far the noise field may be shifted [px]


class Sensor:
    """
    Degrades images of one ``size``, width and height [px].

    ``noise`` is its deviation [grey levels], ``gain_drift`` the amplitude of a drift of the gain,
    ``blur`` a sigma [px]. The output follows from these, the seed and the frame index alone.
    """

    def __init__(
        self,
        size: tuple[int, int],
        seed: int,
        *,
        noise: float = 0.0,
        gain_drift: float = 0.0,
        blur: float = 0.0,
    ) -> None:
        self._seed, self._noise, self._gain_drift, self._blur = seed, noise, gain_drift, blur
        rng = np.random.default_rng(seed)
        self._phase = float(rng.uniform(0.0, 2.0 * math.pi))
        shape = (size[1] + SPARE, size[0] + SPARE)
        self._unit_noise = rng.standard_normal(shape, dtype=np.float32)
        self._field: tuple[float, NDArray[np.int16]] | None = None  # by its deviation

    def capture(self, image: Image, frame_index: int, gain: float = 1.0) -> Image:
        """
        Return ``image``, shape (H, W), as frame ``frame_index`` of the sensor: -1, 0, 1, ...

        The noise grows with the ``gain`` that made the image so bright.
        """
        image = as_gray(image)
        if self._blur > 0.0:
            image = np.asarray(cv2.GaussianBlur(image, (0, 0), self._blur), np.uint8)
        # Seeds must not be negative: the photograph is 0, the frames start at 1.
        rng = np.random.default_rng((self._seed, frame_index - DESIRED_FRAME))
        if self._gain_drift > 0.0:
            image = cv2.convertScaleAbs(image, alpha=self._drifting_gain(frame_index, rng))
        if self._noise > 0.0:
            return self._noisy(image, min(gain * self._noise, MAX_NOISE), rng)
        return image.copy()

    def _drifting_gain(self, frame_index: int, rng: np.random.Generator) -> float:
        """Return 1 + drift: a slow wave, three quarters of it, and a little flicker."""
        wave = math.sin(self._phase + 2.0 * math.pi * frame_index / 97.0)  # frames
        return 1.0 + self._gain_drift * (0.75 * wave + 0.25 * rng.uniform(-1.0, 1.0))

    def _noisy(self, image: Image, noise: float, rng: np.random.Generator) -> Image:
        """Return ``image`` with a part of the field of noise, shifted and mirrored by chance."""
        if self._field is None or self._field[0] != noise:
            self._field = noise, np.rint(noise * self._unit_noise).astype(np.int16)
        (height, width), start = image.shape, rng.integers(0, SPARE + 1, 2)
        mirrored = rng.integers(0, 2, 2)
        down, right = np.where(mirrored, SPARE - start, start).tolist()
        rows, columns = (1 - 2 * mirrored).tolist()
        part = self._field[1][::rows, ::columns][down : down + height, right : right + width]
        noisy = cv2.add(image, np.ascontiguousarray(part), dtype=cv2.CV_8U)
        return np.asarray(noisy, dtype=np.uint8)


def as_jpeg(image: Image, quality: int) -> Image:
    """Return ``image``, shape (H, W), as a JPEG of that ``quality``, 1 to 100, shows it."""
    _, content = cv2.imencode('.jpg', image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(content, cv2.IMREAD_GRAYSCALE), dtype=np.uint8)


class Shutter(NamedTuple):
    """
    Row v of H is exposed for ``exposure`` [s], around v / H * ``readout`` [s] after the first one.

    The photograph is taken at rest. ``breathing`` is the amplitude of the focal length as a share,
    with a period of ``frames``.
    """

    readout: float = 0.0
    exposure: float = 0.0
    breathing: float = 0.0
    frames: float = 1.0

    def zoom(self, frame: int | None) -> float:
        """Return the focal length of ``frame`` over that of the photograph, frame -1."""
        if self.breathing == 0.0 or frame is None or frame == DESIRED_FRAME:
            return 1.0
        return 1.0 + self.breathing * math.sin(2.0 * math.pi * frame / self.frames)

    @property
    def is_instant(self) -> bool:
        """Whether a camera in motion sees what one at rest does."""
        return self.readout == self.exposure == 0.0


INSTANT = Shutter()


class Receipt(NamedTuple):
    """
    Images are received ``delay`` [s] after their exposure, with ``jitter``, and stamped then.

    Without both they have the stamp of their exposure. None comes before its ``readout`` [s] ends.
    """

    delay: float = 0.0
    jitter: float = 0.0
    seed: int = 0
    readout: float = 0.0

    @property
    def stamps(self) -> bool:
        """Whether images are stamped when they are received."""
        return self.delay > 0.0 or self.jitter > 0.0

    def delay_ns(self, frame: int) -> int:
        """Return how late ``frame``, 0, 1, ..., is received [ns]."""
        chance = 0.0
        if self.jitter > 0.0:
            chance = float(np.random.default_rng((self.seed, 8, frame)).standard_normal())
        return round(max(self.delay + self.jitter * chance, self.readout) * NANOSECONDS)


class CameraMotion(NamedTuple):
    """How base and body move while rows are exposed, and the joints of a head, which stand."""

    twist: Twist = STANDSTILL
    nod: Nod = LEVEL
    joints: Joints = AT_REST


STILL = CameraMotion()


class BodyState(NamedTuple):
    """Where a base is, its velocity, and how its body nods."""

    pose: Pose
    twist: Twist
    nod: Nod = LEVEL


class PoseHistory:
    """What a base did of late; between two entries it drove an arc."""

    def __init__(self) -> None:
        self._entries: deque[tuple[int, BodyState]] = deque(maxlen=256)  # more than any delay

    def add(self, stamp_ns: int, state: BodyState) -> None:
        """Take in the true ``state`` at ``stamp_ns``; time that runs backwards begins anew."""
        if self._entries and self._entries[-1][0] >= stamp_ns:
            self._entries.clear()
        self._entries.append((stamp_ns, state))

    def during(self, stamp_ns: int, seconds: float) -> BodyState:
        """Return the state at ``stamp_ns``, and its mean velocity for ``seconds`` from there."""
        state = self.at(stamp_ns)
        if seconds == 0.0:
            return state
        after = self.at(stamp_ns + round(seconds * NANOSECONDS))
        way, turn = motion_between(state.pose, after.pose)
        return state._replace(twist=Twist(way / seconds, turn / seconds))

    def at(self, stamp_ns: int) -> BodyState:
        """Return the state at ``stamp_ns``, that of the nearest entry where there is none."""
        k = bisect_right(self._entries, stamp_ns, key=lambda entry: entry[0])
        if k in (0, len(self._entries)):
            return self._entries[max(k - 1, 0)][1]
        (before_ns, before), (after_ns, after) = self._entries[k - 1], self._entries[k]
        gap, since = seconds_between(before_ns, after_ns), seconds_between(before_ns, stamp_ns)
        way, turn = motion_between(before.pose, after.pose)
        arc, nod = Twist(way / gap, turn / gap), before.nod.towards(after.nod, since / gap, gap)
        return BodyState(integrate(before.pose, arc, since), arc, nod)


def interpolated(nodes: FloatArray, share: FloatArray) -> FloatArray:
    """Return the parabola through ``nodes``, (3, ..., D), of 0, 1/2 and 1, at ``share``, (...)."""
    s = share[..., None]
    start, middle, end = nodes
    return np.asarray(
        (2.0 * s - 1.0) * (s - 1.0) * start
        + 4.0 * s * (1.0 - s) * middle
        + s * (2.0 * s - 1.0) * end
    )


def in_image(points: FloatArray, camera: CameraModel) -> tuple[FloatArray, BoolArray]:
    """
    Return the pixels, shape (..., N, 2), and which are in view, shape (..., N).

    ``points``, shape (..., N, 3), have the axes of the camera.
    """
    planar = camera.planar
    if planar is None:
        return _in_wide_image(points, camera)
    depth = points[..., 2]
    rays = points[..., :2] / np.maximum(depth, MIN_DEPTH_M)[..., None]
    rays = np.minimum(np.maximum(rays, -MAX_RAY), MAX_RAY).reshape(-1, 2)
    pixels = planar.pixels_of(rays)
    visible = camera.contains(pixels)
    if planar.distorts or 0.5 * max(camera.width, camera.height) > camera.fx:
        # Such a lens may show, folded back into the image, what it cannot see.
        visible &= (np.abs(rays) < MAX_RAY).all(axis=1)
    return pixels.reshape(*depth.shape, 2), visible.reshape(depth.shape) & (depth > MIN_DEPTH_M)


def _in_wide_image(points: FloatArray, camera: CameraModel) -> tuple[FloatArray, BoolArray]:
    """Return the pixels, and which are in view, of a lens that may see what is behind it."""
    pixels = camera.pixels(normalised(points.reshape(-1, 3)))
    near = np.sqrt((points * points).sum(axis=-1)) <= MIN_DEPTH_M
    visible = camera.contains(pixels).reshape(near.shape) & ~near
    return pixels.reshape(*near.shape, 2), visible
