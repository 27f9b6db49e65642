"""An example: one matcher under the entry points that visual_servo_epipolar looks at."""

from setuptools import setup

setup(
    name='own_matcher',
    version='0.1.0',
    py_modules=['own_matcher'],
    entry_points={'visual_servo_epipolar.matchers': ['orb = own_matcher:ORB']},
)
