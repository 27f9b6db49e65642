"""Observations: tracked features as rays, with the distortion of the camera removed."""

from dataclasses import dataclass, replace
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, IntArray
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.geometry.lens import corrected, Lens
from visual_servo_epipolar.core.geometry.motion import HALF_PI, Pose
from visual_servo_epipolar.core.geometry.rays import LEAST_FORWARD
from visual_servo_epipolar.core.geometry.rotation import rotated
from visual_servo_epipolar.core.rigs.rig import HeadView, Joints, Lean, Rig
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.core.tracking.sampling import overlap
from visual_servo_epipolar.core.twoview.estimator import Attitude, COLD_DEVIATION


@dataclass(frozen=True, slots=True, eq=False)
class MatchedRays:
    """
    Matches of one image with the photograph as unit rays, shape (N, 3) each, at ``stamp_ns``.

    A feature behind the camera (z < 0) is a ray as any other. ``pixel_angles``, shape (N, 2), are
    the angles of one pixel at each current and desired ray [rad], None for those of a pinhole
    without distortion. ``focal`` [px] only turns pixel thresholds into angles and back. ``edges``
    are the bearings of the left and the right edge of the image [rad], right positive.
    """

    stamp_ns: int
    current: FloatArray
    desired: FloatArray
    focal: float
    edges: tuple[float, float] = (-HALF_PI, HALF_PI)
    pixel_angles: FloatArray | None = None

    @property
    def resolution(self) -> FloatArray:
        """Angle of one pixel at each current and desired ray [rad], shape (N, 2)."""
        if self.pixel_angles is not None:
            return self.pixel_angles
        forward = np.stack([self.current[:, 2], self.desired[:, 2]], axis=1)
        forward = np.maximum(forward, LEAST_FORWARD)
        return np.asarray(forward * np.sqrt(forward) / self.focal)

    def __len__(self) -> int:
        return len(self.current)


@dataclass(frozen=True, slots=True, eq=False)
class Observation(MatchedRays):
    """
    One set of matches, and what else is known of them and of the moment.

    ``dropped`` is the number of features left out, for the lens cannot say where they are;
    ``wide`` is a lens that sees farther off its axis than a plane can hold; ``odometry`` is where
    the wheels say that the base was then, in any frame, None where they do not say; ``head`` tells
    that the rays are in axes of its rig, None without a head. ``rows``, shape (N,), are those of
    the current features from the middle of the image, in heights of it; None where rays are as if
    all rows were read at once.
    """

    dropped: int = 0
    wide: bool = False
    ids: IntArray | None = None
    odometry: Pose | None = None
    head: HeadView | None = None
    rows: FloatArray | None = None
    shared: float = 1.0

    @property
    def joints(self) -> Joints | None:
        """Angles of the head at the image, None without one."""
        return None if self.head is None else self.head.joints

    def without_features(self) -> 'Observation':
        """Return the observation of an image in which nothing is to be trusted."""
        nothing = np.empty((0, 3))
        return replace(
            self,
            current=nothing,
            desired=nothing,
            pixel_angles=None,
            ids=None,
            rows=None,
        )

    def at_one_instant(self, turn: FloatArray) -> 'Observation':
        """
        Return the observation as if all rows were read with the middle one.

        The camera turns by ``turn`` during the readout, a rotation vector in its axes, (3,) [rad].
        """
        if self.rows is None:
            return self
        current = rotated(self.current, self.rows[:, None] * turn) if turn.any() else self.current
        return replace(self, current=current, rows=None)

    def on_rig(self, rig: Rig, joints: Joints) -> 'Observation':
        """Return the observation in axes of a ``rig``; ``joints`` are its angles at the image."""
        return replace(
            self,
            current=rig.rays(self.current, joints),
            desired=rig.rays(self.desired, rig.photograph),
            edges=rig.edges(self.edges, joints),
            pixel_angles=self.resolution,  # those of the camera, wherever it looks
            wide=True,  # seen from the base, features lie on any side
            head=HeadView(joints, rig.reach(self.edges), rig),
            rows=None,  # a head keeps the camera from turning
        )

    def levelled(self, attitude: Attitude, configured: Attitude) -> 'Observation':
        """
        Return the observation of a head with rays turned by the learnt ``attitude``.

        A head turns rays about the vertical, which lies in axes of its camera as it is configured
        to. If the camera leans otherwise, views at other pan angles look tilted and rolled against
        the photograph. Rays follow the lean as far as it is certain, see ``jitter``.
        """
        if self.head is None:
            return self
        joints, _, rig = self.head
        tilt, roll = _believed(attitude.tilt_deviation), _believed(attitude.roll_deviation)
        lean = Lean(
            configured.tilt + tilt * (attitude.tilt - configured.tilt),
            configured.roll + roll * (attitude.roll - configured.roll),
        )
        axes = np.eye(3)
        here, photograph = (
            rig.rays(axes, at).T @ rig.rays(axes, at, lean) for at in (joints, rig.photograph)
        )
        return replace(self, current=self.current @ here, desired=self.desired @ photograph)

    def jitter(self, attitude: Attitude) -> float:
        """Return the jitter of ``attitude`` with what its doubt adds to a view of a head [rad]."""
        if self.head is None:
            return attitude.jitter
        joints, _, rig = self.head
        here, photograph = (rig.rays(np.eye(3), at) for at in (joints, rig.photograph))
        # A lean tilts the camera about its first axis, and rolls it about its last.
        x, _, z = np.linalg.norm(here - photograph, axis=1).tolist()
        doubts = (
            swing * deviation * math.sqrt(_believed(deviation))
            for swing, deviation in ((x, attitude.tilt_deviation), (z, attitude.roll_deviation))
        )
        return math.hypot(attitude.jitter, *doubts)

    def corrected(self, lens: Lens) -> 'Observation':
        """Return the observation without what is wrong with the camera matrix."""
        if lens.corrects_nothing:
            return self
        ratio = math.exp(lens.log_ratio)
        current, growth_current = corrected(self.current, lens)
        desired, growth_desired = corrected(self.desired, lens)
        left, right = (_corrected_edge(edge, ratio, lens.shift) for edge in self.edges)
        return replace(
            self,
            current=current,
            desired=desired,
            focal=self.focal / ratio,
            edges=(left, right),
            pixel_angles=self.resolution * np.stack([growth_current, growth_desired], axis=1),
        )


def _believed(deviation: float) -> float:
    """Return the share of a learnt lean that is believed, by its ``deviation`` [rad]."""
    return COLD_DEVIATION**2 / (COLD_DEVIATION**2 + deviation**2)


def _corrected_edge(edge: float, ratio: float, shift: float) -> float:
    """Return the bearing of an edge of the image [rad], beyond a right angle as well."""
    if abs(edge) >= math.pi:
        return edge
    sine, cosine = math.sin(edge), math.cos(edge)
    return math.atan2(ratio * sine + shift * cosine, cosine)


def observe(features: Features, camera: CameraModel, stamp_ns: int) -> Observation:
    """
    Back-project tracked features to rays, with the distortion of the camera removed.

    A feature whose ray does not lead back to its pixel, in either view, is dropped.
    """
    count, ids = len(features), features.ids
    pixels = np.concatenate([features.current, features.desired])
    rays = camera.rays(pixels)
    usable = camera.round_trips(pixels, rays)
    if not usable.all():
        whole = usable[:count] & usable[count:]
        both = np.concatenate([whole, whole])
        rays, pixels, ids = rays[both], pixels[both], ids[whole]
    rays.flags.writeable = False
    kept = len(ids)
    angles = camera.resolution(rays).reshape(2, kept).T.copy()
    return Observation(
        stamp_ns,
        rays[:kept],
        rays[kept:],
        camera.focal,
        camera.edges,
        angles,
        dropped=count - kept,
        wide=camera.wide,
        ids=ids,
        rows=None if camera.wraps else pixels[:kept, 1] / camera.height - 0.5,
        shared=overlap(pixels[:kept], (camera.height, camera.width)),
    )
