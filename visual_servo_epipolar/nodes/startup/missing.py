"""Missing packages: what a command or a node needs, in one line with what to do."""

from collections.abc import Mapping
from importlib import import_module
from importlib.util import find_spec
import re

from visual_servo_epipolar.core.errors import InputError

ROS = re.compile(r'rclpy|rpyutils|ament_\w+|rosidl_\w+|rosgraph_msgs|\w+_(interfaces|msgs|srvs)')
NO_ROS = (
    'ROS 2 cannot be imported ({}); source your ROS 2 Jazzy, or run "make setup" and use .venv'
)
DASK = 'pip install "visual_servo_epipolar[dask]"'
BAGS = 'pip install rosbags mcap (on Ubuntu 24.04 in a venv with --system-site-packages)'
REMEDIES: Mapping[str, str] = {
    'rosbags': BAGS,
    'mcap': BAGS,
    'cv2': 'apt install python3-opencv, or pip install opencv-python-headless',
    'dask': DASK,
    'distributed': DASK,
    'matplotlib': 'apt install python3-matplotlib, or pip install matplotlib',
    'scipy': 'apt install python3-scipy, or pip install scipy',
}


def require(*packages: str, otherwise: str = '', load: bool = True) -> None:
    """Import ``packages``, or see that they are there; raises InputError with what to do."""
    for package in packages:
        try:
            if load:
                import_module(package)
            elif find_spec(package) is None:
                raise ModuleNotFoundError(f'No module named {package!r}', name=package)
        except ImportError as error:
            alternative = f', or {otherwise}' if otherwise else ''
            raise InputError(f'{remedy(error)}{alternative}') from None


def remedy(error: ImportError) -> str:
    """Return what is missing and what to do about it; raises ``error`` if it is our own module."""
    package = (error.name or '').partition('.')[0]
    if package == __name__.partition('.')[0]:
        raise error
    if ROS.fullmatch(package):
        return NO_ROS.format(error)
    if not package:  # a library that is there and cannot be loaded
        return f'{error}; install what it needs'
    return f'{package} is missing; {REMEDIES.get(package, f"pip install {package}")}'
