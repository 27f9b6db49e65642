"""Settings of every managed node, free of ROS."""

from dataclasses import dataclass

from visual_servo_epipolar.core.settings import setting, Settings


@dataclass(frozen=True, kw_only=True)
class LifecycleSettings(Settings):
    """Settings of a managed node."""

    autostart_node: bool = setting(
        True, 'Configure and activate at the start; false: ros2 lifecycle does it', read_only=True
    )
