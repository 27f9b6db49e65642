"""Settings of the dock node: topics, frames, and what of it moves the robot."""

from dataclasses import dataclass

from visual_servo_epipolar.core.settings import setting
from visual_servo_epipolar.nodes.startup.settings import LifecycleSettings, RELIABILITIES


@dataclass(frozen=True, kw_only=True)
class DockNodeSettings(LifecycleSettings):
    """Settings of the connections of the node."""

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
    camera_reliability: str = setting(
        'auto',
        'Subscribe to camera_info as: auto finds out what the driver offers',
        choices=RELIABILITIES,
        read_only=True,
    )
    base_frame: str = setting('base_link', 'Frame of the base', read_only=True)
    mount_from_tf: bool = setting(
        False,
        'Take how the camera is mounted from /tf_static, where no camera_ setting tells it',
        read_only=True,
    )
    path_source: str = setting(
        'odometry',
        'Metres come from: odom, or the commands on cmd_vel',
        choices=('odometry', 'commands'),
        read_only=True,
    )
    pose_frame: str = setting(
        'base',
        "The pose is published in: base_frame at the image's stamp, or the frame of odom",
        choices=('base', 'odometry'),
        read_only=True,
    )
    enable_stamped_cmd_vel: bool = setting(
        False, 'cmd_vel is geometry_msgs/TwistStamped', read_only=True
    )
    serve_action: bool = setting(
        False, 'Serve the action dock_robot of nav2_msgs: requests start the servo', read_only=True
    )
    servo: str = setting('servo_node', 'Whose ~/start and ~/stop are called', read_only=True)
    dock_backwards: bool = setting(
        False,
        'The camera looks back: take cmd_vel_reversed of the servo, publish it turned round',
        read_only=True,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.pose_frame == 'odometry' and self.path_source != 'odometry':
            raise ValueError(
                "pose_frame 'odometry' must go with path_source 'odometry', got "
                f'{self.path_source!r}: commands have no frame; set pose_frame: base'
            )
