"""A drive of two metres through a room, as camera and wheels tell it; and what may befall it."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.evaluation.faults.world import small_camera
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator

S = 1_000_000_000
BEGIN_NS = 1_700_000_000 * S
IMAGES, PER_IMAGE = 45, 5  # at 10 Hz, and messages of odometry to each
SPEED, LENGTH = 0.5, 2.0  # [m/s, m]: it stands for 0.4 s at the end


@dataclass(frozen=True)
class Seen:
    """An image, when it came and its stamp [ns]."""

    came_ns: int
    stamp_ns: int
    image: Image


@dataclass(frozen=True)
class Told:
    """A pose by odometry, when it came and its stamp [ns]."""

    came_ns: int
    stamp_ns: int
    pose: Pose
    frame: str = 'odom'

    def moved(self, x: float = 0.0, y: float = 0.0) -> 'Told':
        return replace(self, pose=replace(self.pose, x=self.pose.x + x, y=self.pose.y + y))


@dataclass(frozen=True)
class RecordedDrive:
    """What came in the course of a drive."""

    camera: CameraModel
    images: list[Seen]
    odometry: list[Told]


@cache
def room_drive() -> RecordedDrive:
    settings = small_camera(3)
    simulator = CameraSimulator(settings)
    images, odometry = [], []
    for k in range(PER_IMAGE * IMAGES):
        seconds = k / (10 * PER_IMAGE)
        driven = min(SPEED * seconds, LENGTH)
        now_ns = BEGIN_NS + round(seconds * S)
        odometry.append(Told(now_ns, now_ns, Pose(3.0 + driven, 1.0, 0.0)))
        if k % PER_IMAGE == 0:
            pose = Pose.from_start(0.0, driven - 3.5, 0.0)
            images.append(Seen(now_ns, now_ns, simulator.capture(pose, len(images))))
    return RecordedDrive(settings.nominal_camera, images, odometry)


Change = Callable[[list[Seen], list[Told]], tuple[list[Seen], list[Told]]]


def befallen(change: Change) -> RecordedDrive:
    """Return the drive with a change of what came."""
    drive = room_drive()
    return RecordedDrive(drive.camera, *change(list(drive.images), list(drive.odometry)))


def wheels(change: Callable[[list[Told]], list[Told]]) -> Change:
    """Return a change of what the odometry tells alone."""
    return lambda images, odometry: (images, change(odometry))


def moved(along: Callable[[int], float]) -> Change:
    """Return what moves pose k of the odometry forward [m]."""
    return wheels(lambda odometry: [it.moved(along(k)) for k, it in enumerate(odometry)])


def backward(images: list[Seen], odometry: list[Told]) -> tuple[list[Seen], list[Told]]:
    return (
        [replace(it, image=other.image) for it, other in zip(images, images[::-1], strict=True)],
        [replace(it, pose=other.pose) for it, other in zip(odometry, odometry[::-1], strict=True)],
    )


def to_and_fro(images: list[Seen], odometry: list[Told]) -> tuple[list[Seen], list[Told]]:
    """Let the robot turn round after 1.1 m; no view is the very same on the way back."""
    back_images, back_odometry = backward(images, odometry)
    middle = IMAGES // 2 + 1
    begin = middle * PER_IMAGE
    seen = [replace(it, image=it.image ^ 1) for it in back_images[middle:]]
    return images[:middle] + seen, odometry[:begin] + back_odometry[begin:]


def rolled(back: float) -> Change:
    """Return what lets the robot roll back where it stops."""
    return moved(lambda k: -back * (k >= PER_IMAGE * IMAGES - 10))


def two_sources(x: float, y: float = 0.0, frame: str = 'odom') -> Change:
    def change(odometry: list[Told]) -> list[Told]:
        others = [
            Told(it.came_ns + S // 100, it.stamp_ns + S // 100, it.moved(x, y).pose, frame)
            for it in odometry
        ]
        return sorted(odometry + others, key=lambda it: it.came_ns)

    return wheels(change)


def stamps(of_images: Callable[[int], int], of_odometry: Callable[[int], int]) -> Change:
    return lambda images, odometry: (
        [replace(it, stamp_ns=of_images(it.stamp_ns)) for it in images],
        [replace(it, stamp_ns=of_odometry(it.stamp_ns)) for it in odometry],
    )


def shown(which: Callable[[int], int]) -> Change:
    """Return what lets image k show what the image ``which(k)`` showed."""
    return lambda images, odometry: (
        [replace(it, image=images[which(k)].image) for k, it in enumerate(images)],
        odometry,
    )


def swapped(images: list[Seen], odometry: list[Told]) -> tuple[list[Seen], list[Told]]:
    """Let each second image overtake the one before, but the first."""
    pairs = [*images[:1], *(images[((k - 1) ^ 1) + 1] for k in range(1, IMAGES))]
    stamped = zip(pairs, images, strict=True)
    return [replace(it, came_ns=each.came_ns) for it, each in stamped], odometry


def same(stamp_ns: int) -> int:
    return stamp_ns


# What no route may come of, and the words for it.
REFUSED: dict[str, tuple[Change, str]] = {
    'backward': (
        backward,
        'after 0.00 m, 0.6 s from the first image: the robot drove backward by',
    ),
    'to and fro': (to_and_fro, 'after 1.10 m, 2.4 s from the first image: the robot drove back'),
    'rolls back': (rolled(0.07), 'the robot drove backward by 0.07 m, at most 0.05 m can be'),
    'odometry ends early': (
        wheels(lambda odometry: odometry[:110]),
        '/odom is 2.22 s older than the image, stamped 1700000002.18 s and 1700000004.40 s',
    ),
    'odometry leaps': (
        moved(lambda k: 0.6 * (k // 40 % 2)),
        '/odom leaps by 0.61 m and 0.00 rad in 0.020 s, at most 5 m/s and 12 rad/s can be',
    ),
    'odometry is reset': (
        moved(lambda k: -4.0 * (k >= 100)),
        'after 0.95 m, 1.9 s from the first image: /odom leaps by 3.99 m',
    ),
    'odometry is silent': (
        wheels(lambda odometry: odometry[:50] + odometry[180:]),
        '/odom was silent for 2.62 s, at most 1 s can be',
    ),
    'two sources 4 cm apart': (two_sources(0.04), '/odom goes to and fro by 0.03 m in 0.020 s'),
    'two sources side by side': (two_sources(0.0, 0.04), '/odom goes to and fro by 0.04 m'),
    'two sources 30 cm apart': (two_sources(0.3), '/odom leaps by 0.29 m and 0.00 rad in 0.010 s'),
    'odometry stands still': (
        wheels(lambda odometry: [replace(it, pose=odometry[0].pose) for it in odometry]),
        'the robot did not drive, by /odom; look at its wheels',
    ),
    'two frames': (two_sources(0.0, 0.0, 'ekf'), '/odom is in the frame'),
    'a camera that hangs': (shown(lambda k: 0), 'have shown the very same for 0.6 s of driving'),
    'one that hangs for a while': (
        shown(lambda k: 20 if 20 <= k < 30 else k),
        'after 1.30 m, 2.6 s from the first image: the images have shown the very same for 0.6 s',
    ),
    'a buffer that is played again': (
        shown(lambda k: k - 10 if 30 <= k < 35 else k),
        'images of another time of the run come with new stamps',
    ),
    'images since boot': (
        stamps(lambda stamp_ns: stamp_ns - BEGIN_NS + 12 * S, same),
        '/odom is 1699999988.00 s newer than the image, stamped 1700000000.00 s and 12.00 s',
    ),
    'images stamped 0': (
        stamps(lambda stamp_ns: 0, same),
        '/odom is 1700000000.00 s newer than the image, stamped 1700000000.00 s and 0.00 s',
    ),
    'odometry of a simulator': (
        stamps(same, lambda stamp_ns: stamp_ns - BEGIN_NS),
        's older than the image, stamped ',
    ),
    'stamps that are all the same': (
        stamps(lambda stamp_ns: BEGIN_NS, same),
        '44 images are not newer than the one before, 1 are; let their driver stamp each',
    ),
    'a bag in a loop': (
        lambda images, odometry: (
            images + [replace(it, came_ns=it.came_ns + 5 * S) for it in images],
            odometry,
        ),
        'the stamps went back by 4.4 s: a bag played in a loop, or a clock that was set',
    ),
}
# What a route comes of all the same, its length [m], and what is said about it.
TAKEN: dict[str, tuple[Change, float, str]] = {
    'as it was': (wheels(lambda odometry: odometry), LENGTH, ''),
    'rocking by millimetres': (moved(lambda k: 0.004 * (k // 10 % 2)), LENGTH, ''),
    'rolls back': (rolled(0.03), LENGTH, ''),
    'odometry twice': (
        wheels(lambda odometry: [it for it in odometry for _ in range(2)]),
        LENGTH,
        '',
    ),
    'images out of order': (
        swapped,
        LENGTH,
        '22 images are left out, not newer than the one before',
    ),
    'each image twice': (
        shown(lambda k: k // 2 * 2),
        LENGTH,
        '22 images are left out, the same as the one before while the robot drove',
    ),
    'odometry begins late': (
        wheels(lambda odometry: odometry[75:]),
        1.25,
        '15 images are left out, before /odom begins, 1.5 s after the first',
    ),
}
