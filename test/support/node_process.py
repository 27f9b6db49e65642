"""A node as a process of its own, on this machine alone."""

import os
from pathlib import Path
import sys

ROOT = Path(__file__).parents[2]


def environment(domain: int) -> dict[str, str]:
    """Return the environment of a process that talks in ``domain``, on this machine alone."""
    return {
        **os.environ,
        'PYTHONPATH': os.pathsep.join(filter(None, [str(ROOT), os.environ.get('PYTHONPATH')])),
        'ROS_DOMAIN_ID': str(domain),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
    }


def arguments(name: str, *more: str) -> list[str]:
    """Return the command line of a node, with ROS arguments."""
    return [sys.executable, '-m', f'visual_servo_epipolar.nodes.{name}', '--ros-args', *more]
