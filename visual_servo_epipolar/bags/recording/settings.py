"""Settings of a recording."""

from dataclasses import dataclass

from visual_servo_epipolar.core.settings import fixed, internal, Settings

MIN_SPLIT_MB = 0.1  # definitions of messages alone take some 0.03


@dataclass(frozen=True, kw_only=True)
class RecordSettings(Settings):
    """How a bag is stored, and what happens when the disk is slow or full. 1 MB is 10^6 bytes."""

    storage: str = internal('mcap', 'Storage of the bag', choices=('mcap',))
    compression: str = fixed('none', 'Compression of chunks', choices=('none', 'zstd'))
    split_size: float = fixed(
        0.0, 'Size of a file at which the next one begins; 0 = never [MB]', low=0.0, high=1e7
    )
    split_duration: float = fixed(
        0.0, 'Time in a file after which the next one begins; 0 = never [s]', low=0.0, high=1e7
    )
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
        if 0.0 < self.split_size < MIN_SPLIT_MB:
            raise ValueError(
                f'split_size must be 0, or at least {MIN_SPLIT_MB:g} MB, got {self.split_size:g}'
            )
