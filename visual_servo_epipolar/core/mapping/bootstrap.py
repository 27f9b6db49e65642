"""Bootstrap: the views that a geometry begins with, a few and none like the one before."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.mapping.adjustment.window import KeyframeWindow
from visual_servo_epipolar.core.mapping.feature_observations import (
    differ_in_place,
    FeatureObservations,
)
from visual_servo_epipolar.core.mapping.initialization import Start
from visual_servo_epipolar.core.mapping.selection import kept_features

MIN_FEATURES = 8  # of a view to begin with
MOST_VIEWS = 4  # to begin with: more cost more time, and are passed soon
MOST_STARTS = 2  # that are tried at one view


@dataclass(frozen=True, slots=True, eq=False)
class Bootstrap:
    """Views to begin with, what pairs tell of them (``starts``); a geometry ``is_due`` or not."""

    starts: tuple[Start, ...] = ()
    last: FeatureObservations | None = None
    is_due: bool = False

    def is_like_last(self, observations: FeatureObservations) -> bool:
        """Return whether a view is like the last one but for a turn."""
        return self.last is not None and not differ_in_place(self.last, observations)

    def with_view(
        self,
        window: KeyframeWindow,
        observations: FeatureObservations,
        places: FloatArray,
        starts: Sequence[Start],
        *,
        most: int,
    ) -> tuple['Bootstrap', KeyframeWindow]:
        """Return bootstrap and window with a view more, at ``places``, (2, 2), by both motions."""
        before = self.starts
        if len(window) >= MOST_VIEWS:
            window = window.without_view(0)
            before = tuple(each._replace(view=each.view - 1) for each in before if each.view > 0)
        here = tuple(start._replace(view=len(window)) for start in starts[:MOST_STARTS])
        window = window.with_view(observations, *places)
        kept = kept_features(window, np.ones(len(window.ids), bool), most)
        bootstrap = Bootstrap((*before, *here), observations, is_due=len(window) > 1)
        return bootstrap, window.of_features(kept)

    @property
    def done(self) -> 'Bootstrap':
        """The same views, that a geometry has been looked for in."""
        return replace(self, is_due=False)


def obstacle(observations: FeatureObservations, bearings: Sequence[Bearings]) -> str:
    """Return in words why nothing can begin with a view; empty if it can."""
    if len(observations) < MIN_FEATURES:
        return f'{len(observations)} features, {MIN_FEATURES} needed to begin'
    return '' if bearings else 'two views show no baseline to begin with'
