"""Settings of the connections of the nodes, free of ROS: topics, frames, time."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from visual_servo_epipolar.core.cameras.registry import CAMERA_INFO, camera_of_size
from visual_servo_epipolar.core.settings import fixed, internal, setting, Settings

OWN_TF = '-r /tf:=tf -r /tf_static:=tf_static in a namespace'  # of a frame_prefix


def _reliability(what: str) -> Any:
    text = f'Subscribe to {what} as: auto finds out what the driver offers'
    return fixed('auto', text, choices=('auto', 'reliable', 'best_effort'))


def _mount_from_tf() -> Any:
    return fixed(False, 'Take the mount from /tf_static unless a camera_ setting is set')


@dataclass(frozen=True, kw_only=True)
class LifecycleSettings(Settings):
    """Settings of a managed node."""

    autostart_node: bool = fixed(
        True, 'Configure and activate at the start; false: ros2 lifecycle does it'
    )


@dataclass(frozen=True, kw_only=True)
class CalibrationSettings(LifecycleSettings):
    """Settings of a node that goes by camera_info."""

    rectified: bool = fixed(
        False, 'Images are rectified: P of camera_info holds, its distortion does not apply'
    )
    cropped: bool = fixed(
        False, 'Images are cut out of larger ones: the principal point may lie anywhere'
    )


@dataclass(frozen=True, kw_only=True)
class ImageSettings(CalibrationSettings):
    """Settings of a node that images come to."""

    projection: str = fixed(
        CAMERA_INFO,
        'Images are: camera_info, what it says; or what their size tells, which the '
        'tracker publishes as camera_info where no other node does: equirectangular, 360 deg',
    )
    transport: str = fixed(
        'raw',
        'Images come as: compressed are JPEG or PNG, on image_raw/compressed',
        choices=('raw', 'compressed'),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.projection != CAMERA_INFO:
            camera_of_size(self.projection, (64, 32))  # ValueError for one that is unknown


@dataclass(frozen=True, kw_only=True)
class DriverNodeSettings(CalibrationSettings):
    """Settings of the connections of a node that drives the robot by its camera."""

    RENAMED: ClassVar[Mapping[str, str]] = {'ackermann': 'base: car'}
    GONE: ClassVar[Mapping[str, Any]] = {'ackermann': False}

    enable_stamped_cmd_vel: bool = fixed(False, 'Publish geometry_msgs/TwistStamped on cmd_vel')
    watchdog: bool = internal(
        True, 'Stop the robot when tracks or images stay away; off where time itself waits'
    )
    max_latency: float = setting(
        0.5,
        "Largest age of an image, by the node's clock; older images make the robot hold; 0 = "
        'off [s]',
        low=0.0,
        high=60.0,
    )
    enable_timeout: float = fixed(
        0.0,
        'Largest age of the last true on enable; 0 = enable not used [s]',
        low=0.0,
        high=10.0,
    )
    base_frame: str = fixed('base_link', 'Frame of the commands')
    mount_from_tf: bool = _mount_from_tf()
    camera_reliability: str = _reliability('the camera')


@dataclass(frozen=True, kw_only=True)
class HeadJoints(Settings):
    """Names of the joints of a head, and what commands it."""

    pan_joint: str = fixed('pan_joint', 'Joint of joint_states that pans the head to the left')
    tilt_joint: str = fixed(
        'tilt_joint', 'Joint of joint_states that tilts the head down; empty: there is none'
    )
    head_command: str = fixed(
        'position',
        'On head/command, as JointState: position, angles; velocity, rates; as '
        'JointTrajectory: trajectory',
        choices=('position', 'velocity', 'trajectory'),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        pan, tilt = self.pan_joint, self.tilt_joint
        if not pan or pan == tilt:
            raise ValueError(
                f'pan_joint must be the name of a joint other than tilt_joint, got {pan!r} and '
                f"{tilt!r}; set both to their names in joint_states, tilt_joint: '' without a tilt"
            )


@dataclass(frozen=True, kw_only=True)
class ServoNodeSettings(HeadJoints, DriverNodeSettings):
    """Settings of the connections of the node."""

    arming_timeout: float = setting(
        10.0,
        '~/start expires if the robot cannot begin to drive within this time [s]',
        low=0.1,
        high=3600.0,
    )
    resume: str = setting(
        'automatic',
        'After a hold: automatic = continue; manual = only ~/start begins a new run',
        choices=('automatic', 'manual'),
    )


@dataclass(frozen=True, kw_only=True)
class RouteNodeSettings(DriverNodeSettings, ImageSettings):
    """Settings of the node: the folder of the route, and where images and metres come from."""

    route: str = setting(
        '', 'Folder of the route, which is repeated, or written after recording', path=True
    )
    path_source: str = fixed(
        'odometry',
        'Metres of a way that is recorded come from: odom, or the commands on cmd_vel',
        choices=('odometry', 'commands'),
    )


@dataclass(frozen=True, kw_only=True)
class TrackerNodeSettings(ImageSettings):
    """Settings of the node: source of the photograph, and QoS of images."""

    desired_image: str = fixed(
        '',
        'File of the photograph, or a folder of several of one pose; empty: wait for '
        'desired/image_raw or ~/capture_desired',
        path=True,
    )
    photograph: str = fixed(
        '',
        'File where a captured photograph is kept with its camera, .yaml; empty: it is not kept',
        path=True,
    )
    capture_frames: int = internal(
        10, 'Images at rest of which a captured photograph is the mean', low=1, high=100
    )
    capture_adds: bool = setting(
        False, 'A captured photograph is added to those of this pose; false: it replaces them'
    )
    renew: bool = fixed(
        False, 'After an arrival the view in a light that no photograph has is kept beside them'
    )
    max_photographs: int = internal(4, 'Most photographs of one pose', low=1, high=16)
    camera_reliability: str = _reliability('images')

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

    RENAMED: ClassVar[Mapping[str, str]] = {'frame_prefix': OWN_TF}
    GONE: ClassVar[Mapping[str, Any]] = {'frame_prefix': ''}

    start: tuple[float, float, float] = setting(
        (1.0, -3.5, 8.0), 'Start in the plane of the paper: x [m], y [m], heading error [deg]'
    )
    seed: int = fixed(0, 'Seed of odometry noise', low=0, high=2**31 - 1)
    model: str = fixed(
        'pioneer',
        'Base: pioneer, a differential drive, or ackermann, a car',
        choices=('pioneer', 'ackermann'),
    )
    lockstep: bool = fixed(False, 'Own /clock, and move one frame for each command')
    begin: bool = internal(True, 'Lockstep: begin as soon as somebody listens to ground_truth')
    rate: float = internal(100.0, 'Rate of the base [Hz]', low=1.0, high=1000.0)
    frame_rate: float = fixed(
        11.0, 'Frames a second, the step of lockstep [Hz]', low=0.1, high=200.0
    )
    enable_stamped_cmd_vel: bool = fixed(False, 'Take geometry_msgs/TwistStamped on cmd_vel')
    world_frame: str = internal('world', 'Frame of ground truth: goal at its origin')
    odom_frame: str = fixed('odom', 'Frame of the odometry')
    base_frame: str = fixed('base_link', 'Frame of the base')

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.start) != 3:
            raise ValueError(
                f'start must be three numbers, x [m], y [m], heading error [deg], got {self.start}'
            )


@dataclass(frozen=True, kw_only=True)
class CameraRig(HeadJoints):
    """What carries the simulated camera, and the names of its joints and frames."""

    RENAMED: ClassVar[Mapping[str, str]] = {'frame_prefix': OWN_TF}
    GONE: ClassVar[Mapping[str, Any]] = {'frame_prefix': ''}

    rig: str = fixed(
        'fixed',
        'What carries the camera: fixed (a mount), or pan_tilt (a head)',
        choices=('fixed', 'pan_tilt'),
    )
    camera_frame: str = fixed(
        'camera_optical_frame', 'Frame of the images: x right, y down, z ahead'
    )
    base_frame: str = fixed('base_link', 'Frame of the base')


@dataclass(frozen=True, kw_only=True)
class RecorderNodeSettings(LifecycleSettings):
    """Settings of the node: what is recorded, and where to."""

    GONE: ClassVar[Mapping[str, Any]] = {'on_error': 'continue', 'servo': 'servo_node'}

    bag: str = fixed(
        '', 'Folder of the bag; empty: rosbag2_ and the date, where it was started', path=True
    )
    topics: tuple[str, ...] = fixed(('*',), 'Topics to record: names, or patterns with * and ?')
    exclude: tuple[str, ...] = fixed(('*overlay/image_raw',), 'Topics not to record, likewise')
    autostart: bool = fixed(True, 'Begin as soon as the node is active, not on ~/start')
    report: bool = internal(True, 'Publish /diagnostics once a second')

    def __post_init__(self) -> None:
        super().__post_init__()
        if not any(self.topics):
            raise ValueError(f"topics must name what to record, got {self.topics}; '*' is all")


@dataclass(frozen=True, kw_only=True)
class DockNodeSettings(CalibrationSettings):
    """Settings of the connections of the node."""

    INTERNAL: ClassVar[frozenset[str]] = frozenset({'cropped', 'camera_reliability'})
    RENAMED: ClassVar[Mapping[str, str]] = {
        'dock_backwards': 'a camera_yaw beyond 1.57, and topic_tools transform',
        'path_source': 'odometry alone, on odom',
        'pose_frame': 'the base alone, by child_frame_id of odom',
        'servo': '-r servo_node/start:=NAME/start -r servo_node/stop:=NAME/stop',
    }
    GONE: ClassVar[Mapping[str, Any]] = {
        'dock_backwards': False,
        'path_source': 'odometry',
        'pose_frame': 'base',
        'servo': 'servo_node',
    }

    camera_reliability: str = _reliability('camera_info')
    mount_from_tf: bool = _mount_from_tf()
    serve_action: bool = fixed(
        False, 'Serve the action dock_robot of nav2_msgs: requests start the servo'
    )
