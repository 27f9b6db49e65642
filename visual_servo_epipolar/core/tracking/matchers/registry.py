"""The matchers by the names that settings give them."""

from visual_servo_epipolar.core.registry import Registry
from visual_servo_epipolar.core.tracking.matchers.base import Matcher
from visual_servo_epipolar.core.tracking.matchers.sift import SIFT

MATCHERS: Registry[Matcher] = Registry('visual_servo_epipolar.matchers', {'sift': SIFT}, Matcher)
