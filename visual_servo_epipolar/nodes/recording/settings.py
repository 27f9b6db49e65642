"""Settings of the recorder node."""

from dataclasses import dataclass

from visual_servo_epipolar.core.settings import setting
from visual_servo_epipolar.nodes.startup.settings import LifecycleSettings


@dataclass(frozen=True, kw_only=True)
class RecorderNodeSettings(LifecycleSettings):
    """Settings of the node: what is recorded, where to, and what the robot does if that fails."""

    bag: str = setting(
        '', 'Folder of the bag; empty: rosbag2_ and the date, where it was started', read_only=True
    )
    topics: tuple[str, ...] = setting(
        ('*',), 'Topics to record: names, or patterns with * and ?', read_only=True
    )
    exclude: tuple[str, ...] = setting(
        ('*overlay/image_raw',), 'Topics not to record, likewise', read_only=True
    )
    autostart: bool = setting(
        True, 'Begin as soon as the node is active, not on ~/start', read_only=True
    )
    report: bool = setting(True, 'Publish /diagnostics once a second', read_only=True)
    on_error: str = setting(
        'continue',
        'When the disk fails or is full, the robot',
        choices=('continue', 'stop_servo'),
        read_only=True,
    )
    servo: str = setting('servo_node', 'Whose ~/stop is called by stop_servo', read_only=True)
