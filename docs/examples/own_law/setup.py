"""An example: one law under the entry points that visual_servo_epipolar looks at."""

from setuptools import setup

setup(
    name='own_law',
    version='0.1.0',
    py_modules=['own_law'],
    entry_points={'visual_servo_epipolar.laws': ['bounded = own_law:BOUNDED']},
)
