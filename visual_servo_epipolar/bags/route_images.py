"""Images along a way that was recorded, with where the base was at the time of each."""

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
import math
from operator import itemgetter
from os.path import commonprefix
from typing import Any

from visual_servo_epipolar.bags.reading.bag import Bag, BagTopic
from visual_servo_epipolar.bags.reading.run import image_size, usable
from visual_servo_epipolar.bags.reading.topics import assign_roles, camera_notes
from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.cameras.equirectangular import cut_note
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.cameras.plausibility import differences
from visual_servo_epipolar.core.cameras.registry import CAMERA_INFO, camera_of_size
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.odometry.path import Path
from visual_servo_epipolar.core.routes.teaching import DrivenImages
from visual_servo_epipolar.messages import read

ODOMETRY = 'nav_msgs/msg/Odometry'


class RecordedWay:
    """
    Way in a bag: its ``camera``, and its images with poses of the base, by odometry or commands.

    ``requested`` are names of topics by role, ``odometry`` that of the odometry. Without a
    ``camera``, or a ``projection`` by which the size of images tells it, it is that of camera_info
    for images of a ``kind`` (rectified, cropped). ``notes`` say what was chosen and what is left
    out. Raises InputError if the bag lacks what is needed.
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
        by_info = camera is None and projection == CAMERA_INFO
        roles = ('image', 'camera_info', 'cmd_vel') if by_info else ('image', 'cmd_vel')
        self._bag, self._topics = bag, assign_roles(bag, requested, roles=roles)
        if 'image' not in self._topics:
            raise InputError(
                f'{bag.path}: no images to learn a route from; it has '
                f'{", ".join(bag.topics) or "no topics"}: name them with --topics image=NAME'
            )
        self.notes = [*bag.notes]
        self.notes += camera_notes(bag, self._topics, requested)
        self.camera = camera or (
            self._recorded_camera(kind) if by_info else self._projected_camera(projection)
        )
        motion = self._odometry(odometry) or self._topics.get('cmd_vel')
        if motion is None:
            raise InputError(
                f'{bag.path}: nothing tells how far the robot drove; record odom as well, or '
                'cmd_vel, or name the topic by --odometry NAME'
            )
        self._by_odometry = motion.kind == ODOMETRY
        if not self._by_odometry:
            self.notes.append(f'no odometry: the way is that of {motion.name}')
        self._path = Path(motion.name, ahead=0.0 if self._by_odometry else math.inf)
        self._rows = self._driven(motion)

    def images(self) -> Iterator[tuple[Image, int, Pose]]:
        """Yield the images in order of time, their stamps, and where the base was."""
        path, rows = self._path, deque(self._rows)
        images = DrivenImages(path)
        add: Callable[..., object] = path.add_pose if self._by_odometry else path.add_twist
        for item in self._bag.messages([self._topics['image'].name]):
            with usable(self._bag.path, item):
                stamp_ns, image = read.stamp_ns(item.message.header), read.gray(item.message)
            while rows and (
                rows[0][0] <= stamp_ns or path.at(stamp_ns) is None and path.lag(stamp_ns) > 0.0
            ):
                add(*rows.popleft())
            images.see(image, stamp_ns)
            yield from images.placed()
            if images.trouble:
                break
        images.finish()
        if images.trouble:
            raise InputError(f'{self._bag.path}: no route can be learnt: {images.trouble}')
        self.notes += images.notes

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

    def _odometry(self, name: str) -> BagTopic | None:
        """Return the topic of odometry, by its type: the one of the robot that has the images."""
        every = [it for it in self._bag.topics.values() if it.kind == ODOMETRY]
        if name:
            found = [it for it in every if it.name.strip('/') == name.strip('/')]
            if not found:
                raise InputError(
                    f'{self._bag.path}: no odometry {name!r}; it has '
                    f'{", ".join(it.name for it in every) or "none"}; name one of these, or leave '
                    '--odometry out where cmd_vel was recorded'
                )
            return found[0]
        images = self._topics['image'].name
        shared = {  # so many namespaces with the images, and the root
            it: commonprefix([it.name, images]).count('/')
            for it in every
            if not it.name.endswith('ground_truth')
        }
        nearest = [it for it, count in shared.items() if count == max(shared.values())]
        names = ', '.join(it.name for it in shared)
        if len(nearest) > 1:
            raise InputError(
                f'{self._bag.path}: one topic of odometry is needed, got {len(shared)}: {names}; '
                'say --odometry NAME'
            )
        if len(shared) > 1:
            self.notes.append(f'of {names} the odometry beside the images is {nearest[0].name}')
        return nearest[0] if nearest else None

    def _driven(self, topic: BagTopic) -> list[Sequence[Any]]:
        """Return stamps [ns] with poses and their frames, or with commands, in order of time."""
        rows: list[Sequence[Any]] = []
        for item in self._bag.messages([topic.name]):
            message = item.message
            with usable(self._bag.path, item):
                if self._by_odometry:
                    stamp_ns, frame = read.stamp_ns(message.header), message.header.frame_id
                    rows.append((stamp_ns, read.pose(message), str(frame)))
                else:
                    stamped = hasattr(message, 'header')
                    stamp_ns = read.stamp_ns(message.header) if stamped else item.log_ns
                    rows.append((stamp_ns, read.twist(message)))
        if len(rows) < 2:
            raise InputError(
                f'{self._bag.path}: two messages or more of {topic.name} are needed, got '
                f'{len(rows)}; record while the robot drives'
            )
        return sorted(rows, key=itemgetter(0))
