"""Settings of the connections of the nodes, free of ROS: topics, frames, time."""

from dataclasses import dataclass

from visual_servo_epipolar.core.settings import setting, Settings

RELIABILITIES = ('auto', 'reliable', 'best_effort')  # of images, as in nodes.qos
RESUMES = ('automatic', 'manual')
TRANSPORTS = ('raw', 'compressed')


@dataclass(frozen=True, kw_only=True)
class LifecycleSettings(Settings):
    """Settings of a managed node."""

    autostart_node: bool = setting(
        True, 'Configure and activate at the start; false: ros2 lifecycle does it', read_only=True
    )


@dataclass(frozen=True, kw_only=True)
class ServoNodeSettings(LifecycleSettings):
    """Settings of the connections of the node."""

    enable_stamped_cmd_vel: bool = setting(
        False, 'Publish geometry_msgs/TwistStamped on cmd_vel', read_only=True
    )
    rectified: bool = setting(
        False,
        'Images are rectified: P of camera_info holds, its distortion does not apply',
        read_only=True,
    )
    cropped: bool = setting(
        False,
        'Images are cut out of larger ones: the principal point may lie anywhere',
        read_only=True,
    )
    watchdog: bool = setting(
        True, 'Stop the robot when tracks stay away; off where time itself waits', read_only=True
    )
    max_latency: float = setting(
        0.5,
        'Age of an image, by the clock of the node, above which it is not driven by; 0 = off [s]',
        low=0.0,
        high=60.0,
    )
    arming_timeout: float = setting(
        10.0,
        'Time within which the robot must begin to drive after ~/start, or the order lapses [s]',
        low=0.1,
        high=3600.0,
    )
    resume: str = setting(
        'automatic',
        'After a hold the run goes on: automatic, by itself; manual, anew and on ~/start alone',
        choices=RESUMES,
    )
    enable_timeout: float = setting(
        0.0,
        'Age of the last true on enable at which the robot is stopped; 0 = none is needed [s]',
        low=0.0,
        high=10.0,
        read_only=True,
    )
    base_frame: str = setting('base_link', 'Frame of the commands', read_only=True)
    mount_from_tf: bool = setting(
        False,
        'Take how the camera is mounted from /tf_static, where no camera_ setting tells it',
        read_only=True,
    )
    camera_reliability: str = setting(
        'auto',
        'Subscribe to camera_info as: auto finds out what the driver offers',
        choices=RELIABILITIES,
        read_only=True,
    )


@dataclass(frozen=True, kw_only=True)
class TrackerNodeSettings(LifecycleSettings):
    """Settings of the node: source of the photograph, and QoS of images."""

    desired_image: str = setting(
        '',
        'File of the photograph; empty: wait for desired/image_raw or ~/capture_desired',
        read_only=True,
    )
    photograph: str = setting(
        '',
        'File where a captured photograph is kept with its camera, .yaml; empty: it is not kept',
        read_only=True,
    )
    capture_frames: int = setting(
        10,
        'Images at rest of which a captured photograph is the mean',
        low=1,
        high=100,
        read_only=True,
    )
    rectified: bool = setting(
        False,
        'Images are rectified: P of camera_info holds, its distortion does not apply',
        read_only=True,
    )
    cropped: bool = setting(
        False,
        'Images are cut out of larger ones: the principal point may lie anywhere',
        read_only=True,
    )
    transport: str = setting(
        'raw',
        'Images come as: compressed are JPEG, PNG, TIFF, on image_raw/compressed',
        choices=TRANSPORTS,
        read_only=True,
    )
    camera_reliability: str = setting(
        'auto',
        'Subscribe to images as: auto finds out what the driver offers',
        choices=RELIABILITIES,
        read_only=True,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.desired_image and self.photograph:
            raise ValueError(
                'desired_image and photograph exclude each other: the first is given, the second '
                'captured; set one of them'
            )


@dataclass(frozen=True, kw_only=True)
class UnicycleSettings(Settings):
    """Where the robot starts, and whose time it lives in."""

    start: tuple[float, float, float] = setting(
        (1.0, -3.5, 8.0), 'Start in the plane of the paper: x [m], y [m], heading error [deg]'
    )
    seed: int = setting(0, 'Seed of odometry noise', low=0, high=2**31 - 1, read_only=True)
    lockstep: bool = setting(
        False, 'Own /clock, and move one frame for each command', read_only=True
    )
    begin: bool = setting(
        True, 'Lockstep: begin as soon as somebody listens to ground_truth', read_only=True
    )
    rate: float = setting(100.0, 'Rate of the base [Hz]', low=1.0, high=1000.0, read_only=True)
    frame_rate: float = setting(
        11.0, 'Frames a second, the step of lockstep [Hz]', low=0.1, high=200.0, read_only=True
    )
    enable_stamped_cmd_vel: bool = setting(
        False, 'Take geometry_msgs/TwistStamped on cmd_vel', read_only=True
    )
    world_frame: str = setting(
        'world', 'Frame of ground truth: goal at its origin', read_only=True
    )
    odom_frame: str = setting('odom', 'Frame of the odometry', read_only=True)
    base_frame: str = setting('base_link', 'Frame of the base', read_only=True)
    frame_prefix: str = setting(
        '',
        'Put before odom_frame and base_frame, as robot1/ where robots share /tf',
        read_only=True,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.start) != 3:
            raise ValueError(
                f'start must be three numbers, x [m], y [m], heading error [deg], got {self.start}'
            )
        _ = self.frames  # raises ValueError for a name that tf2 refuses

    @property
    def frames(self) -> tuple[str, str, str]:
        """The frames of world, odometry and base; robots share the world."""
        prefix = self.frame_prefix
        return (
            frame_name('', self.world_frame),
            frame_name(prefix, self.odom_frame),
            frame_name(prefix, self.base_frame),
        )


@dataclass(frozen=True, kw_only=True)
class CameraFrames(Settings):
    """Names of the frames of the camera and of what it is screwed to."""

    camera_frame: str = setting(
        'camera_optical_frame', 'Frame of the images: x right, y down, z ahead', read_only=True
    )
    base_frame: str = setting('base_link', 'Frame of the base', read_only=True)
    frame_prefix: str = setting(
        '', 'Put before both, as robot1/ where robots share /tf', read_only=True
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        _ = self.camera, self.base  # raise ValueError for a name that tf2 refuses

    @property
    def camera(self) -> str:
        """The full name of the camera's frame."""
        return frame_name(self.frame_prefix, self.camera_frame)

    @property
    def base(self) -> str:
        """The full name of the base's frame."""
        return frame_name(self.frame_prefix, self.base_frame)


def frame_name(prefix: str, name: str) -> str:
    """Return the full name of a frame; ValueError if tf2 would refuse it."""
    full = prefix + name
    if not name or full.startswith('/'):
        raise ValueError(
            f'a frame must have a name that does not begin with /, got {full!r}; '
            "write 'base_link', and a prefix as 'robot1/'"
        )
    return full
