"""The same cameras as each program writes them, after its documentation: texts of calibrations."""

from pathlib import Path

PINHOLE = (385.25, 386.5, 322.25, 238.75)
PLUMB_BOB = (-0.21, 0.06, 0.0004, -0.0003, 0.0)
FISHEYE = (0.012, -0.0025, 0.0007, -0.0001)


def _text(name: str) -> str:
    return (Path(__file__).parent / 'calibrations' / name).read_text(encoding='utf-8')


OST_YAML, OST_TXT = _text('ost.yaml'), _text('ost.txt')
ECHO, ECHO_ROS1 = _text('ros2_topic_echo.yaml'), _text('rostopic_echo.yaml')
OPENCV_YAML, OPENCV_XML = _text('opencv.yml'), _text('opencv.xml')
CAMCHAIN, EUROC = _text('kalibr_camchain.yaml'), _text('euroc.yaml')
COLMAP, TRANSFORMS = _text('colmap_cameras.txt'), _text('nerfstudio_transforms.json')
# Of the one camera above, by what the program is called.
FILES = {
    'ost.yaml': OST_YAML,
    'ost.txt': OST_TXT,
    'ros2 topic echo': ECHO,
    'ros2 topic echo, for a while': ECHO + ECHO.replace('123456789', '223456789') + ECHO[:150],
    'rostopic echo': ECHO_ROS1,
    'OpenCV YAML': OPENCV_YAML,
    'OpenCV XML': OPENCV_XML,
    'OpenCV JSON': _text('opencv.json'),
    'Kalibr': CAMCHAIN[: CAMCHAIN.index('cam1:')],
    'EuRoC': EUROC,
}
