"""Messages that nobody should send: of any type, or nearly right; their number, and memory."""

from array import array
from collections.abc import Callable
import gc
from importlib import import_module
import os
from pathlib import Path
from typing import Any

from geometry_msgs.msg import Twist as TwistMessage
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
import numpy as np
from rclpy.serialization import deserialize_message, serialize_message
from rosidl_parser.definition import AbstractNestedType, AbstractString, Array, BasicType
from sensor_msgs.msg import CameraInfo, PointCloud2
from servo_rig import AWAY, CAMERA, WORLD
from servo_states import PHASES
from std_msgs.msg import String

from visual_servo_epipolar.core.geometry.motion import Pose, Twist
from visual_servo_epipolar.messages import write

# On each subscription and service; before a release by hand: FUZZ_MESSAGES=2000.
COUNT = int(os.environ.get('FUZZ_MESSAGES', '60'))
GROWTH_MB = 8.0  # of the process: a message that is kept would be more
BITS = {'int8': 7, 'uint8': 8, 'int16': 15, 'uint16': 16, 'int32': 31, 'uint32': 32}
BITS.update(int64=63, uint64=64)
NUMBERS = (0.0, 1.0, -1.0, 0.5, 1e-300, 1e38, -1e38, np.inf, -np.inf, np.nan)
WORDS = ('', 'camera', 'map', 'waiting', 'holding', 'a\0b', '\U0001f916', 'x' * 999, 'ä\n' * 9)


def anything(kind: Any, rng: np.random.Generator) -> Any:
    """Return a message of ``kind`` in which every field is at or beyond what makes sense."""
    message = kind()
    for name, slot in zip(message.get_fields_and_field_types(), kind.SLOT_TYPES, strict=True):
        setattr(message, name, _value(slot, rng))
    return message


def _value(slot: Any, rng: np.random.Generator) -> Any:
    if isinstance(slot, AbstractNestedType):
        longest = 20 if isinstance(slot.value_type, BasicType) else 2
        size = slot.size if isinstance(slot, Array) else int(rng.choice([0, 1, longest]))
        return [_value(slot.value_type, rng) for _ in range(size)]
    if isinstance(slot, AbstractString):
        return str(rng.choice(WORDS))
    if not isinstance(slot, BasicType):
        return anything(getattr(import_module('.'.join(slot.namespaces)), slot.name), rng)
    if slot.typename == 'boolean':
        return bool(rng.random() < 0.5)
    if slot.typename == 'octet':
        return bytes([int(rng.integers(0, 256))])
    if slot.typename in ('float', 'double'):
        return float(rng.choice(NUMBERS))
    last = 2 ** BITS[slot.typename] - 1
    first = 0 if slot.typename.startswith('u') else -last - 1
    return [first, last, 0, 1, 5, 100][int(rng.integers(0, 6))]


def wired(message: Any) -> Any:
    """Return what arrives of a message."""
    return deserialize_message(serialize_message(message), type(message))


def sent_to(node: Any, rng: np.random.Generator) -> None:
    """Hand one message, or one that is nearly right, to each subscription of a ``node``."""
    for item in list(node.subscriptions):
        message = nearly(item.msg_type, rng) if rng.random() < 0.5 else None
        item.callback(wired(message or anything(item.msg_type, rng)))


def nearly(kind: Any, rng: np.random.Generator) -> Any:
    """Return a message that makes sense but for one of its numbers, None of other types."""
    stamp_ns, number = int(rng.integers(0, 2**33)), float(rng.choice(NUMBERS))
    if kind is Odometry:
        pose, twist = Pose(*rng.uniform(-5.0, 5.0, 3)), Twist(0.1, 0.1)
        message = write.odometry(pose, twist, stamp_ns, 'odom', 'base_link')
        fields = [message.pose.pose.position, message.pose.pose.orientation]
        setattr(fields[rng.integers(0, 2)], str(rng.choice(['x', 'y', 'z'])), number)
        return message
    if kind is PointCloud2:
        return nearly_tracks(rng, stamp_ns)
    if kind is CameraInfo:
        return nearly_camera(rng)
    if kind is TwistMessage:
        return write.twist(Twist(number if np.isfinite(number) else 9.0, 0.1))
    if kind is TwistStamped:
        return write.twist_stamped(Twist(0.1, 0.1), stamp_ns, str(rng.choice(WORDS)))
    if kind is String:
        return write.text(str(rng.choice([phase.value for phase in PHASES])))
    return None


def nearly_tracks(rng: np.random.Generator, stamp_ns: int) -> PointCloud2:
    """Return tracks with one thing wrong with them, or nothing."""
    message = write.features(WORLD.observe(AWAY, int(rng.integers(0, 99))), stamp_ns, 'camera')
    field = message.fields[int(rng.integers(0, len(message.fields)))]
    wrong = int(rng.integers(0, 9))
    if wrong == 0:
        field.datatype = int(rng.integers(0, 256))
    elif wrong == 1:
        field.offset = int(rng.choice([1, 60, 10_000, 2**32 - 1]))
    elif wrong == 2:
        field.name = str(rng.choice(WORDS))
    elif wrong == 3:
        message.point_step = int(rng.choice([0, 1, 44, 2**32 - 1]))
    elif wrong == 4:
        message.width, message.height = (int(rng.choice([0, 1, 2**32 - 1])) for _ in range(2))
    elif wrong == 5:
        message.is_bigendian = True
    elif wrong == 6:
        _spoil(message.data, rng)
    elif wrong == 7:
        del message.data[int(rng.integers(0, len(message.data) + 1)) :]
    return message


def _spoil(data: array, rng: np.random.Generator) -> None:
    """Write a number that makes no sense over eight bytes somewhere."""
    at = int(rng.integers(0, len(data) - 8))
    data[at : at + 8] = array('B', np.float64(rng.choice(NUMBERS)).tobytes())


def nearly_camera(rng: np.random.Generator) -> CameraInfo:
    """Return a camera_info with one thing wrong with it, or nothing."""
    message = write.camera_info(CAMERA, 0, 'camera')
    wrong = int(rng.integers(0, 6))
    if wrong == 0:
        message.k[int(rng.integers(0, 9))] = float(rng.choice(NUMBERS))
    elif wrong == 1:
        message.d = [float(rng.choice(NUMBERS)) for _ in range(int(rng.choice([1, 4, 5, 8, 14])))]
    elif wrong == 2:
        message.distortion_model = str(rng.choice(['equidistant', 'fisheye', *WORDS]))
    elif wrong == 3:
        message.width = int(rng.choice([0, 1, 640, 2**32 - 1]))
    elif wrong == 4:
        message.binning_x, message.roi.x_offset = (int(rng.choice([0, 2, 2**32 - 1])), 7)
    return message


def resident_mb() -> float:
    """Return the memory in use."""
    gc.collect()
    return int(Path('/proc/self/statm').read_text().split()[1]) * 4096 / 1e6


def assert_stays_small(
    tell: Callable[[np.random.Generator, int], None],
    seed: int,
    count: int = COUNT // 2,
    end: Callable[[], float] = lambda: 0.0,
) -> None:
    """Tell the same things twice: what is kept is a leak, but for what ``end`` returns [MB]."""
    used = []
    for _ in range(2):
        rng = np.random.default_rng(seed)
        for number in range(count):
            tell(rng, number)
        kept = end()
        used.append(resident_mb())
    assert used[1] - used[0] < GROWTH_MB + kept
