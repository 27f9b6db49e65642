"""Settings of a recording."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from visual_servo_epipolar.core.settings import fixed, internal, Settings


@dataclass(frozen=True, kw_only=True)
class RecordSettings(Settings):
    """How a bag is stored, and what happens when the disk is slow or full. 1 MB is 10^6 bytes."""

    GONE: ClassVar[Mapping[str, Any]] = {'split_size': 0.0, 'split_duration': 0.0}

    storage: str = internal('mcap', 'Storage of the bag', choices=('mcap',))
    compression: str = fixed('none', 'Compression of chunks', choices=('none', 'zstd'))
    queue_size: float = internal(
        256.0, 'Messages that may wait for the disk [MB]', low=0.001, high=1e5
    )
    when_full: str = internal(
        'drop',
        'When that many wait: drop and count, or wait (only where time itself waits)',
        choices=('drop', 'wait'),
    )
    flush_period: float = internal(
        0.5, 'Longest time after which what came in survives a kill -9 [s]', low=0.05, high=60.0
    )
    min_free: float = fixed(
        200.0, 'Free space on the disk at which recording ends [MB]', low=0.0, high=1e7
    )

    def __post_init__(self) -> None:
        if self.storage == 'sqlite3':
            raise ValueError(
                'storage must be mcap, got sqlite3, which is read but not written; record mcap '
                'and convert the bag with "ros2 bag convert"'
            )
        super().__post_init__()
