"""
The tracker: which feature of the desired view is where in the current image.

Pyramidal Lucas-Kanade keeps the features from frame to frame; each is then anchored to its patch
in the desired image, so that small errors do not add up to drift. Lost ones are looked for where
their neighbours went, and when too few are left the whole image is matched anew.
"""

from dataclasses import replace

import numpy as np

from visual_servo_epipolar.core.arrays import as_gray, BoolArray, FloatArray, Image
from visual_servo_epipolar.core.errors import TrackingError
from visual_servo_epipolar.core.tracking.candidates import Candidates
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.core.tracking.flow import as_bright, flow
from visual_servo_epipolar.core.tracking.matching import (
    desired_view,
    DesiredView,
    match,
    Matches,
)
from visual_servo_epipolar.core.tracking.predicted_features import (
    motion_between,
    PredictedFeatures,
)
from visual_servo_epipolar.core.tracking.reacquisition import found_again
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.template_alignment import (
    Anchor,
    float_image,
    FloatImage,
    Warps,
)
from visual_servo_epipolar.core.tracking.tracks import Tracks

FIRST_ITERATIONS = 15  # of the alignment after a match: its scale is only known by SIFT
BORDER = 4.0
FEW, FEW_PERIOD = 20, 3  # below so many features, matching may come after so few frames
FEW_FACTOR = 3  # and so many times more are looked for in a frame
ASTRAY_PX = 8.0  # motion against that of all others at which Lucas-Kanade is not believed


class Tracker:
    """
    Tracks the features of one desired image through a stream of current images.

    ``track`` returns no features before ``set_desired``. The id of a feature is its number in the
    desired view and never changes; a feature that was lost may come back under its id.
    """

    def __init__(self, settings: TrackerSettings) -> None:
        self.settings = settings
        self._view: DesiredView | None = None
        self._anchor: Anchor | None = None
        self._previous: Image | None = None
        self._tracked = Tracks.nothing()
        self._candidates: Candidates | None = None
        self._predicted = PredictedFeatures.none()
        self._frame = 0
        self._match_frame: int | None = None
        self.matchings = 0  # of whole images, since the start
        self.reason = 'no desired image yet'

    @property
    def has_desired(self) -> bool:
        """Whether there is a photograph to come back to."""
        return self._view is not None

    def set_desired(self, image: Image) -> None:
        """
        Take ``image`` as the desired view and forget all features.

        Raises ValueError or TrackingError, and keeps the view it had, if it cannot be used.
        """
        view = desired_view(image)
        self._view, self._anchor = view, Anchor(view.image)
        self.redetect()

    def redetect(self) -> None:
        """Forget all features; the next image is matched to the desired one anew."""
        self._previous, self._tracked, self._match_frame = None, Tracks.nothing(), None
        self._candidates = None if self._view is None else Candidates(self._view)
        self._predicted = PredictedFeatures.none()

    def track(self, image: Image) -> Features:
        """
        Return the features of the desired view seen in ``image``, uint8 of shape (H, W).

        Raises
        ------
        ValueError
            If ``image`` is not uint8 grey, or not as large as the desired one.

        """
        image = as_gray(image)
        if self._view is None or self._anchor is None:
            return Features()
        if image.shape != self._view.image.shape:
            raise ValueError(
                f'image must have the size of the desired one, {_size(self._view.image)}, got '
                f'{_size(image)}; take both with the same camera and resolution'
            )
        self._frame += 1
        tracked = self._followed(image)
        image_float = float_image(image) if self._anchors_now else None
        if image_float is not None:
            tracked = self._align(tracked, image_float, self.settings.anchor_iterations)
            tracked = tracked.trustworthy()
        tracked = self._with_the_others(tracked)
        if image_float is not None:
            tracked = self._found_again(tracked, image_float).consistent()
        if len(tracked) < self.settings.min_features and self._may_match():
            tracked = self._replenished(tracked, image)
        self._tracked, self._previous = tracked, image
        self._predicted = self._predicted.seen(tracked.warps)
        return self._features()

    def _may_match(self) -> bool:
        """Return whether it is time: matching takes as long as several frames."""
        if self._match_frame is None:
            return True
        waited = self._frame - self._match_frame
        few = len(self._tracked) < FEW
        return waited >= (self.settings.rematch_period if not few else FEW_PERIOD)

    @property
    def _anchors_now(self) -> bool:
        period = self.settings.anchor_period
        return period > 0 and self._frame % period == 0

    def _followed(self, image: Image) -> Tracks:
        """
        Follow the features from the last image by Lucas-Kanade.

        Checked backward as well if features are never anchored: else the desired patch is judge.
        """
        if self._previous is None or not len(self._tracked):
            return Tracks.nothing()
        before = self._tracked.warps.current.astype(np.float32)
        previous = as_bright(self._previous, image)
        after, found = flow(previous, image, before, settings=self.settings)
        if self.settings.anchor_period == 0:
            back, found_back = flow(image, previous, after, before, settings=self.settings)
            found &= found_back & (np.hypot(*(back - before).T) <= self.settings.forward_backward)
        warps = replace(self._tracked.warps, current=after.astype(np.float64))
        good = found & _inside(warps.current, image)
        return replace(self._tracked, warps=warps, ages=self._tracked.ages + 1).take(good)

    def _with_the_others(self, tracked: Tracks) -> Tracks:
        """Drop features that went another way than all others, and move the predicted along."""
        before = self._tracked.warps
        if not len(tracked):
            self._predicted = self._predicted.aged()
            return tracked
        # Both lists are in the order of the last frame: what was lost is missing from the second.
        places = before.current[np.isin(before.ids, tracked.warps.ids)]
        motion = motion_between(places, tracked.warps.current)
        if motion is None:
            self._predicted = self._predicted.aged()
            return tracked
        self._predicted = self._predicted.moved(motion)
        return tracked.take(~motion.astray(places, tracked.warps.current, ASTRAY_PX))

    def _align(self, tracked: Tracks, image: FloatImage, iterations: int) -> Tracks:
        assert self._anchor is not None
        alignment = self._anchor.align(tracked.warps, image, iterations=iterations)
        aligned = Tracks(alignment.warps, tracked.ages, alignment.residual)
        good = alignment.correlation >= self.settings.min_correlation
        return aligned.take(good & _inside(alignment.warps.current, image))

    def _found_again(self, tracked: Tracks, image: FloatImage) -> Tracks:
        """
        Look for some of the candidates that are not tracked, others in each frame.

        With a full set only for those from where the desired image is hardly covered any more.
        """
        assert self._anchor is not None and self._candidates is not None
        few = FEW_FACTOR if len(tracked) < self.settings.min_features else 1
        keys = self._candidates.next_missing(
            tracked.warps, few * self.settings.search_per_frame, self.settings.max_features
        )
        if not len(keys):
            return tracked
        found = found_again(self._predicted.among(keys), tracked.warps, self._anchor, image)
        both = tracked.joined(self._align(Tracks.fresh(found), image, FIRST_ITERATIONS))
        if len(both) <= self.settings.max_features:
            return both
        kept = np.arange(len(both)) < len(tracked)
        return both.take(self._candidates.spread(both.warps.ids, kept, self.settings.max_features))

    def _replenished(self, tracked: Tracks, image: Image) -> Tracks:
        """Match the whole image with the desired one and fill up with new features."""
        assert self._view is not None and self._candidates is not None
        first = self._match_frame is None
        self._match_frame, self.matchings = self._frame, self.matchings + 1
        try:
            matches = self._matched(image, halved=not first)
        except TrackingError as error:
            self.reason = str(error)
            return tracked
        self.reason = ''
        other = np.flatnonzero(~np.isin(matches.indices, tracked.warps.ids))
        nobody = np.zeros(len(other), bool)
        rows = other[
            self._candidates.spread(matches.indices[other], nobody, self.settings.candidates)
        ]
        indices = matches.indices[rows]
        warps = Warps(
            indices,
            self._view.keypoints.pixels[indices],
            matches.pixels[rows],
            matches.scales[rows, None, None] * np.eye(2),
        )
        fresh = self._align(Tracks.fresh(warps), float_image(image), FIRST_ITERATIONS)
        both = tracked.joined(fresh).consistent()
        self._candidates.remember(both.warps.ids, self.settings.candidates)
        self._predicted = self._predicted.seen(both.warps)
        kept = np.isin(both.warps.ids, tracked.warps.ids)
        return both.take(self._candidates.spread(both.warps.ids, kept, self.settings.max_features))

    def _matched(self, image: Image, *, halved: bool) -> Matches:
        """Match by the halved image, and by the whole one where that gives too little."""
        assert self._view is not None
        if halved:
            try:
                matches = match(self._view, image, halved=True)
            except TrackingError:
                pass
            else:
                if len(matches.indices) >= self.settings.max_features:
                    return matches
        return match(self._view, image)

    def _features(self) -> Features:
        warps = self._tracked.warps
        return Features(
            warps.ids, warps.current, warps.desired, self._tracked.ages, self._tracked.residuals
        )


def _inside(pixels: FloatArray, image: Image | FloatImage) -> BoolArray:
    height, width = image.shape
    u, v = pixels[:, 0], pixels[:, 1]
    inside = (u >= BORDER) & (u < width - BORDER) & (v >= BORDER) & (v < height - BORDER)
    return np.asarray(inside)


def _size(image: Image) -> str:
    return f'{image.shape[1]}x{image.shape[0]}'
