"""Images along a way that was recorded, with where the base was at the time of each."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from visual_servo_epipolar.bags.reading.bag import Bag, BagTopic
from visual_servo_epipolar.bags.reading.run import image_size, usable
from visual_servo_epipolar.bags.reading.topics import assign_roles, camera_notes
from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.core.cameras.equirectangular import cut_note
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.cameras.plausibility import differences
from visual_servo_epipolar.core.cameras.registry import CAMERA_INFO, camera_of_size
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.geometry.motion import integrate, Pose
from visual_servo_epipolar.messages import read

ODOMETRY = 'nav_msgs/msg/Odometry'
COMMAND_HOLDS_S = 0.5  # longest time that a command is obeyed


class RecordedWay:
    """
    Way in a bag: its ``camera``, and its images with poses of the base, by odometry or commands.

    ``requested`` are names of topics by role, ``odometry`` that of the odometry. Without a
    ``camera``, or a ``projection`` by which the size of images tells it, it is that of camera_info
    for images of a ``kind`` (rectified, cropped). Raises InputError if the bag lacks what is
    needed.
    """

    def __init__(
        self,
        bag: Bag,
        requested: Mapping[str, str],
        *,
        odometry: str = '',
        camera: CameraModel | None = None,
        projection: str = CAMERA_INFO,
        **kind: bool,
    ) -> None:
        told = camera is None and projection == CAMERA_INFO
        roles = ('image', 'camera_info', 'cmd_vel') if told else ('image', 'cmd_vel')
        self._bag, self._topics = bag, assign_roles(bag, requested, roles=roles)
        if 'image' not in self._topics:
            raise InputError(
                f'{bag.path}: no images to learn a route from; it has '
                f'{", ".join(bag.topics) or "no topics"}: name them with --topics image=NAME'
            )
        self.notes = [*bag.notes]
        self.notes += camera_notes(bag, self._topics, requested)
        self.camera = camera or (
            self._recorded_camera(kind) if told else self._projected_camera(projection)
        )
        self._stamps, self._poses = self._driven(odometry)

    def images(self) -> Iterator[tuple[Image, int, Pose]]:
        """Yield the images in the order of recording, their stamps, and where the base was."""
        for item in self._bag.messages([self._topics['image'].name]):
            with usable(self._bag.path, item):
                stamp_ns, image = read.stamp_ns(item.message.header), read.gray(item.message)
            if self._stamps[0] <= stamp_ns <= self._stamps[-1]:
                pose = [float(np.interp(stamp_ns, self._stamps, each)) for each in self._poses.T]
                yield image, stamp_ns, Pose(*pose)

    def _recorded_camera(self, kind: Mapping[str, bool]) -> CameraModel:
        topic, camera = self._topics.get('camera_info'), None
        for item in () if topic is None else self._bag.messages([topic.name]):
            with usable(self._bag.path, item):
                another = read.camera(item.message, **kind)
            if camera is not None and camera != another:
                raise InputError(
                    f'{self._bag.path}: {item.topic} has changed while recording: '
                    f'{differences(camera, another)}; record the way anew, or give a camera file: '
                    '--camera FILE.yaml'
                )
            camera = another
        if camera is None:
            raise InputError(
                f'{self._bag.path}: no camera_info; name its topic with --topics '
                'camera_info=NAME, give a camera file: --camera FILE.yaml, or say --projection '
                'of a camera that sees all around'
            )
        return camera

    def _projected_camera(self, projection: str) -> CameraModel:
        """Return the camera that the size of the first image tells."""
        try:
            camera = camera_of_size(projection, image_size(self._bag, self._topics) or (0, 0))
        except ValueError as error:
            raise InputError(f'{self._bag.path}: {error}') from None
        self.notes += filter(None, [cut_note(camera)])
        return camera

    def _driven(self, name: str) -> tuple[FloatArray, FloatArray]:
        """Return stamps [ns], (M,), and poses of the base, (M, 3), headings unwrapped."""
        topic = self._odometry(name)
        if topic is not None:
            rows = self._by_odometry(topic)
        elif 'cmd_vel' in self._topics:
            self.notes.append(f'no odometry: the way is that of {self._topics["cmd_vel"].name}')
            rows = self._by_commands(self._topics['cmd_vel'])
        else:
            raise InputError(
                f'{self._bag.path}: nothing tells how far the robot drove; record odom as well, '
                'or cmd_vel, or name the topic by --odometry NAME'
            )
        if len(rows) < 2:
            raise InputError(
                f'{self._bag.path}: two poses of the base or more are needed, got {len(rows)}; '
                'record while the robot drives'
            )
        rows.sort(key=lambda row: row[0])
        table = np.array(rows)
        table[:, 3] = np.unwrap(table[:, 3])
        return table[:, 0], table[:, 1:]

    def _odometry(self, name: str) -> BagTopic | None:
        known = [it for it in self._bag.topics.values() if it.kind == ODOMETRY]
        if name:
            found = [it for it in known if it.name.strip('/') == name.strip('/')]
            if not found:
                raise InputError(
                    f'{self._bag.path}: no odometry {name!r}; it has '
                    f'{", ".join(it.name for it in known) or "none"}; name one of these, or leave '
                    '--odometry out where cmd_vel was recorded'
                )
            return found[0]
        usual = [it for it in known if it.name.endswith('odom')]
        if len(usual) > 1:
            names = ', '.join(it.name for it in usual)
            raise InputError(
                f'{self._bag.path}: one topic of odometry is needed, got {len(usual)}: {names}; '
                'say --odometry NAME'
            )
        return usual[0] if usual else None

    def _by_odometry(self, topic: BagTopic) -> list[Sequence[float]]:
        rows: list[Sequence[float]] = []
        for item in self._bag.messages([topic.name]):
            with usable(self._bag.path, item):
                pose = read.odometry(item.message)
            rows.append((read.stamp_ns(item.message.header), pose.x, pose.y, pose.theta))
        return rows

    def _by_commands(self, topic: BagTopic) -> list[Sequence[float]]:
        rows: list[Sequence[float]] = []
        pose, twist, last_ns = Pose(0.0, 0.0, 0.0), None, 0
        for item in self._bag.messages([topic.name]):
            if twist is not None:
                held = min(1e-9 * (item.log_ns - last_ns), COMMAND_HOLDS_S)
                pose = integrate(pose, twist, max(held, 0.0))
            with usable(self._bag.path, item):
                twist = read.twist(item.message)
            last_ns = item.log_ns
            rows.append((last_ns, pose.x, pose.y, pose.theta))
        return rows
