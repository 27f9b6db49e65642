"""Collecting: the views that a geometry begins with, a few and none like the one before."""

from collections.abc import Sequence

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.estimators.base import Attitude
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.mapping.adjustment.window import Window
from visual_servo_epipolar.core.mapping.feature_observations import FeatureObservations
from visual_servo_epipolar.core.mapping.initialization import Start
from visual_servo_epipolar.core.mapping.selection import kept_features

MIN_COLLECTED = 8  # features of a view to begin with
MOST_COLLECTED = 4  # views to begin with: more cost more time, and are passed soon
MOST_STARTS = 2  # that are tried at one view

Starts = tuple[Start, ...]


def bootstrap_obstacle(sightings: FeatureObservations, bearings: Sequence[Bearings]) -> str:
    """Return in words why nothing can begin with a view; empty if it can."""
    if len(sightings) < MIN_COLLECTED:
        return f'{len(sightings)} features, {MIN_COLLECTED} needed to begin'
    return '' if bearings else 'two views show no baseline to begin with'


def starts_of(view: int, bearings: Sequence[Bearings], attitude: Attitude) -> Starts:
    """Return what two views tell of keyframe ``view``."""
    return tuple(Start(view, each, attitude) for each in bearings[:MOST_STARTS])


def with_bootstrap_room(window: Window, starts: Starts) -> tuple[Window, Starts]:
    """Return a window with room for one more view, and the starts of the views in it."""
    if len(window) < MOST_COLLECTED:
        return window, starts
    earlier = tuple(start._replace(view=start.view - 1) for start in starts if start.view > 0)
    return window.without_view(0), earlier


def with_bootstrap_view(
    window: Window,
    sightings: FeatureObservations,
    places: tuple[FloatArray, FloatArray],
    most: int,
) -> Window:
    """Return the window with one more view at ``places`` by both accounts, ``most`` features."""
    window = window.with_view(sightings, *places)
    return window.of_features(kept_features(window, np.ones(len(window.ids), bool), most))
