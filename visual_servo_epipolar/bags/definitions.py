"""Message definitions and their hashes: they make a bag readable without the packages."""

from functools import cache
from typing import Any

from rosbags.typesys import get_typestore, Stores

from visual_servo_epipolar.core.errors import InputError

METADATA = 'metadata.yaml'  # of a bag: what it says of itself


@cache
def types_of_ros() -> Any:
    """Return the types of ROS 2; those read here have not changed since dashing."""
    return get_typestore(Stores.ROS2_JAZZY)


def definition(kind: str, type_hash: str = '') -> tuple[str, str]:
    """
    Return the definition of a message type, with those it is made of, and its hash.

    ``kind`` is such as sensor_msgs/msg/Image, ``type_hash`` that which the publisher states, if
    any. Raises InputError for a type that a stock ROS 2 does not have with this hash.
    """
    store = types_of_ros()
    if kind in store.fielddefs:
        digest = str(store.hash_rihs01(kind))
        if type_hash == digest or not type_hash.startswith('RIHS01_'):
            return store.generate_msgdef(kind, ros_version=2)[0], digest
    raise InputError(
        f'no definition of {kind} {type_hash} is known: it is no message of ROS 2 itself; record '
        'it by ros2 bag record'
    )
