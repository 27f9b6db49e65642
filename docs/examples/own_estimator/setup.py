"""An example: one estimator under the entry points that visual_servo_epipolar looks at."""

from setuptools import setup

setup(
    name='own_estimator',
    version='0.1.0',
    py_modules=['own_estimator'],
    entry_points={'visual_servo_epipolar.estimators': ['linear_8pt = own_estimator:linear_8pt']},
)
