"""Bytes that are no message, on the wire: whoever subscribes lives on and hears the next one."""

import fuzzing
import numpy as np
from rclpy.serialization import serialize_message
from servo_rig import CAMERA, Rig, tracks

from visual_servo_epipolar.core.geometry.motion import STANDSTILL
from visual_servo_epipolar.messages import write

HEAD = 150  # bytes: sizes and names of fields are there


def damaged(data: bytes, rng) -> bytes:
    """Return part of ``data``, and some of its first bytes by others."""
    changed = bytearray(data[: int(rng.choice([len(data), rng.integers(4, len(data))]))])
    for _ in range(int(rng.integers(1, 6))):
        changed[int(rng.integers(4, min(len(changed), HEAD) + 1)) - 1] = int(rng.integers(0, 256))
    return bytes(changed)


def test_a_servo_outlives_bytes_that_are_no_message(bench) -> None:
    rig, rng = Rig(bench, autostart=False, stale_timeout=60.0), np.random.default_rng(7)
    cloud = serialize_message(tracks())
    info = serialize_message(write.camera_info(CAMERA, 0, 'camera'))
    for _ in range(fuzzing.COUNT):
        rig.send(damaged(cloud, rng))
        rig.calibrate(damaged(info, rng))
        bench.executor.spin_once(timeout_sec=0.01)
    bench.settle()
    assert all(twist == STANDSTILL for twist in rig.twists())
    rig.calibrate(write.camera_info(CAMERA, 0, 'camera'))
    rig.see()
    assert bench.call('servo_node/start').success
    rig.drive()
