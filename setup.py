"""Installation by colcon (ament_python) and by pip; the tools are set up in pyproject.toml."""

from glob import glob
from pathlib import Path
import re

from setuptools import find_packages, setup

NAME = 'visual_servo_epipolar'
NODES = (
    'unicycle_node',
    'camera_node',
    'tracker_node',
    'servo_node',
    'recorder_node',
    'dock_node',
    'route_node',
)
SHARE = f'share/{NAME}'


def version() -> str:
    """Read the version where it is defined, without importing the package."""
    text = Path(NAME, '__init__.py').read_text(encoding='utf-8')
    found = re.search(r"^__version__ = '([^']+)'$", text, re.MULTILINE)
    if found is None:
        raise RuntimeError(f"{NAME}/__init__.py must define __version__ = 'x.y.z'; restore it")
    return found.group(1)


setup(
    name=NAME,
    version=version(),
    description='Drive a unicycle robot to the pose of a photograph, by epipolar geometry.',
    # No file: colcon build --symlink-install runs this in a folder of its own, without README.md.
    long_description='Epipolar visual servoing of mobile robots: ROS 2 nodes, simulator, tools.',
    long_description_content_type='text/plain',
    author='visual_servo_epipolar developers',
    author_email='ros-maintainers@visual-servo-epipolar.org',
    maintainer='visual_servo_epipolar developers',
    maintainer_email='ros-maintainers@visual-servo-epipolar.org',
    license='Apache-2.0',
    python_requires='>=3.10',
    zip_safe=False,
    packages=find_packages(include=[NAME, f'{NAME}.*']),
    package_data={'': ['*.html', '*.xml']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (SHARE, ['package.xml']),
        (f'{SHARE}/config', sorted(glob('config/*.*'))),
        (f'{SHARE}/config/rigs', sorted(glob('config/rigs/*.yaml'))),
        (f'{SHARE}/config/scenarios', sorted(glob('config/scenarios/*.yaml'))),
        (f'{SHARE}/config/sros2', sorted(glob('config/sros2/*.xml'))),
        (f'{SHARE}/launch', sorted(glob('launch/*.launch.py'))),
    ],
    # For pip alone. On a native ROS these come from rosdep (package.xml), and apt's cv2 has no
    # metadata for pip to see. That does no harm: colcon installs with --no-deps, and executables
    # made by setuptools >= 47.2 start through importlib.metadata and do not check requirements.
    # rclpy and the messages are no pip packages on a native ROS: never list them here.
    install_requires=[
        'matplotlib>=3.6.3',
        'mcap>=1.5.0',
        'numpy>=1.26.4',
        'opencv-python-headless>=4.6.0.66',
        'PyYAML>=6.0.1',
        'rosbags>=0.11.9',
    ],
    extras_require={
        # ROS 2 Jazzy as wheels, for a machine without ROS. Exact, and always all together:
        # unpinned, pip mixes in wheels of a later ROS that do not load beside these.
        'ros': [
            'ros-jazzy-common-interfaces==5.3.6',
            'ros-jazzy-rclpy==7.1.6',
            'ros-jazzy-rmw-fastrtps-cpp==8.4.3',
            'ros-jazzy-test-msgs==2.0.3',  # an action, for the tests of dock_robot
        ],
        # `colcon test` runs pytest only if this extra has this name and lists pytest.
        'test': [
            'av>=12.3.0',
            'dask[distributed]>=2023.12.1',
            'hypothesis>=6.98.15',
            'mcap-ros2-support',
            'psutil>=5.9.8',
            'pytest>=7.4.4',
            'pytest-xdist>=3.4.0',
            'scipy>=1.11.4',
        ],
        'video': ['av>=12.3.0'],  # a small video of the demo, H.264; no robot needs it
        'lint': ['import-linter', 'mypy', 'ruff', 'types-PyYAML'],
        'bench': ['poselib'],  # a peer to measure against
        'dask': ['dask[distributed]>=2023.12.1'],  # sweep --scheduler
        'colcon': ['colcon-common-extensions', 'setuptools<80'],
    },
    entry_points={
        'console_scripts': [
            f'visual_servo = {NAME}.__main__:main',
            *(f'{node} = {NAME}.nodes.startup.executables:{node}' for node in NODES),
        ],
    },
)
