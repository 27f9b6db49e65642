"""
Tracker: the features of the desired view, from frame to frame of the current one.

Pyramidal Lucas-Kanade follows the features; each is then aligned with its patch in the desired
image, so that small errors do not add up to drift. Lost features are predicted and searched for,
and when too few remain the whole image is matched anew.
"""

from dataclasses import replace
import math

import numpy as np

from visual_servo_epipolar.core.arrays import as_gray, Image, median
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.errors import TrackingError
from visual_servo_epipolar.core.goal import Goal, goal_id
from visual_servo_epipolar.core.tracking.alignment import FIRST_ITERATIONS
from visual_servo_epipolar.core.tracking.candidates import Candidates
from visual_servo_epipolar.core.tracking.canvas import Canvas
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.core.tracking.flow import flow, Frame, OpenCVError
from visual_servo_epipolar.core.tracking.matchers.registry import matcher_of
from visual_servo_epipolar.core.tracking.matching import desired_view, DesiredView
from visual_servo_epipolar.core.tracking.photographs import (
    Photographs,
    Rematching,
    TiedView,
)
from visual_servo_epipolar.core.tracking.reacquisition import (
    among_neighbours,
    Predictions,
    reacquire,
)
from visual_servo_epipolar.core.tracking.sampling import (
    float_image,
    FloatImage,
    inside_border,
    patches_for_one,
)
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracks import Tracks
from visual_servo_epipolar.core.tracking.warps import Warps

MARGIN = 4.0  # features nearer to the border of the current image are dropped [px]
MOST_SHIFT = 0.25  # of the width, of features since a wide lens was matched
FEW_FACTOR = 3  # the search is so many times wider below min_features


class Tracker:
    """
    Tracker of the features of one desired image through a stream of current images.

    ``track`` returns no features before ``set_desired``. The id of a feature is its number in the
    desired view and never changes; a feature that was lost may come back under its id. ``goal``
    is what the features lead to. Of its ``photographs``, in different light, that number
    ``photograph`` is tracked, from 0 on; there are none before there is a desired image.
    ``reason`` says why the last matching of a whole image failed. A ``camera`` whose image is no
    plane is to be noted; others need none. Views are on its ``canvas``. Features of small images
    are smaller, and ``as_many`` more are tracked as take the same time.
    """

    def __init__(
        self,
        settings: TrackerSettings,
        camera: CameraModel | None = None,
        *,
        as_many: bool = True,
    ) -> None:
        self.settings, self._as_many = settings, as_many
        self.canvas = Canvas.of(camera, math.radians(self.settings.stitch_band))
        self.photographs = Photographs()
        self.photograph = 0
        self._previous: Frame | None = None
        self._tracked = Tracks.empty()
        self._candidates: Candidates | None = None
        self._predictions, self._is_prepared = Predictions(), True
        self._frame = 0
        self.goal: Goal[None] = Goal()
        self._rematching = Rematching()
        self._shift = 0.0  # of features against the photograph when it was matched [px]
        self.reason = 'no desired image yet; nothing is tracked until one is given or captured'

    @property
    def has_desired(self) -> bool:
        """Whether there is a desired view."""
        return bool(self.photographs.views)

    @property
    def matchings(self) -> int:
        """How often a whole image was matched."""
        return self._rematching.count

    @property
    def which(self) -> str:
        """Which of several photographs is tracked, in words; '' of one alone, or of none."""
        if len(self.photographs) < 2 or not len(self._tracked):
            return ''
        return f'photograph {self.photograph + 1} of {len(self.photographs)}'

    @property
    def _tied(self) -> TiedView:
        """The photograph that is tracked."""
        return self.photographs.views[self.photograph]

    @property
    def _most(self) -> int:
        """Most features that are tracked at a time."""
        return self._many(self.settings.max_features)

    def _many(self, usual: int) -> int:
        """Return how many patches of this image take as long as a ``usual`` number elsewhere."""
        if not self._as_many:
            return usual
        return round(usual * patches_for_one(self._tied.view.image.shape))

    def _are_few(self, tracked: Tracks) -> bool:
        """Return whether features are so few that others are looked for."""
        return len(tracked) < self._many(self.settings.min_features)

    def is_desired(self, image: Image) -> bool:
        """Return whether ``image``, of shape (H, W), is the desired one, pixel by pixel."""
        return self.has_desired and np.array_equal(self.photographs.images[0], image)

    def set_desired(self, image: Image) -> None:
        """
        Make ``image``, uint8 of shape (H, W), the desired view and forget all features.

        Raises ValueError or TrackingError, and keeps the former view, if it cannot be used.
        """
        matcher = matcher_of(self.settings.matcher, self.settings.matcher_model)
        self.set_view(desired_view(image, matcher, canvas=self.canvas))

    def set_view(self, view: DesiredView) -> None:
        """Make ``view`` the desired one, of which all is known, and forget all features."""
        self.photographs = Photographs((TiedView.first(view),))
        self.goal = Goal(goal_id(view.image))
        self.redetect()

    def see_through(self, camera: CameraModel) -> None:
        """
        Go by this ``camera`` from now on; where that changes anything, all is found anew.

        Raises ValueError or TrackingError, and changes nothing, if it cannot use the photographs.
        """
        canvas = Canvas.of(camera, math.radians(self.settings.stitch_band))
        if canvas == self.canvas:
            return
        if self.has_desired:
            self._check_size(camera.height, camera.width)
            photographs = self.photographs.on_canvas(canvas)
            self.photographs = photographs
            self.goal = Goal(goal_id(photographs.views[0].view.image))
            self.redetect()
        self.canvas = canvas

    def add_desired(self, image: Image) -> None:
        """
        Add ``image``, uint8 of shape (H, W): a photograph of the same pose, in other light.

        Raises ValueError or TrackingError, and changes nothing, if it cannot be used, is of
        another pose, or if there is no desired view yet.
        """
        self.photographs = self.photographs.with_added(image)
        self.redetect()

    def renew(self, image: Image, most: int) -> bool:
        """
        Keep ``image``, of today's light, among at most ``most`` if no photograph is like it.

        Returns whether it is kept; raises as ``add_desired`` does.
        """
        renewed = self.photographs.renewed(image, most)
        is_kept, self.photographs = renewed is not self.photographs, renewed
        if is_kept:
            self.redetect()
        return is_kept

    def expect(self, image: Image, warps: Warps) -> int:
        """
        Begin anew with what ``warps`` expect in ``image``; return how many features are there.

        A matching of the whole image is saved where the view of the photograph is known.
        """
        self.redetect()
        frame = Frame(self.canvas.painted(image))
        aligned = self._aligned(Tracks.detected(warps), float_image(frame.image), FIRST_ITERATIONS)
        found = aligned.without_residual_outliers().without_epipolar_outliers(self.canvas)
        if self._candidates is None or len(found) < self.settings.min_features:
            return len(found)
        self._candidates.remember(warps.ids, self._many(self.settings.candidates))
        self._tracked = self._candidates.limited(found, found, self._most)
        self._shift = _shift(self._tracked)
        self._predictions.correct(found.warps)
        self._previous = frame
        return len(found)

    def redetect(self) -> None:
        """Forget all features; the next image is matched to the desired one anew."""
        if self.has_desired:
            self.reason = 'the photograph was not looked for yet'
        self._previous = None
        self._rematching.forget()
        self._begin(0)

    def _begin(self, photograph: int) -> None:
        """Begin to track that number of ``photograph``, of which no feature is known."""
        self.photograph, self._tracked = photograph, Tracks.empty()
        self._candidates = Candidates(self._tied.view) if self.has_desired else None
        self._predictions, self._is_prepared = Predictions(), True

    def track(self, image: Image) -> Features:
        """
        Return the features of the desired view in ``image``, uint8 of shape (H, W).

        None, with a ``reason``, of an image that OpenCV cannot cope with. Raises ValueError if
        ``image`` is not uint8 grey, or not as large as the desired one.
        """
        image = as_gray(image)
        if not self.has_desired:
            return Features()
        self._check_size(*image.shape)
        self.prepare()
        self._frame += 1
        self._rematching.pass_frame()
        try:
            frame = Frame(self.canvas.painted(image))
            tracked = self._tracked_in(frame)
            self._tracked = replace(tracked, warps=self.canvas.own(tracked.warps))
        except (OpenCVError, np.linalg.LinAlgError) as error:
            self.redetect()
            self.reason = f'the image could not be tracked in: {" ".join(str(error).split())}'
            return Features()
        self._previous, self._is_prepared = frame, False
        shown = self._tracked.take(self.canvas.shows(self._tracked.warps.current))
        return self._tied.features(shown, self.goal.id)

    def _check_size(self, height: int, width: int) -> None:
        """Raise ValueError for an image that is not as large as the desired one [px]."""
        rows, columns = self.photographs.images[0].shape
        if (height, width) != (rows, columns):
            raise ValueError(
                f'image must have the size of the desired one, {columns}x{rows}, got '
                f'{width}x{height}; take both with the same camera and resolution'
            )

    def prepare(self) -> None:
        """Prepare for the next image, while there is time; ``track`` does what was not done."""
        if not self._is_prepared:
            self._predictions.correct(self._tracked.warps)
            self._is_prepared = True

    def _tracked_in(self, frame: Frame) -> Tracks:
        """Return the tracks in ``frame``, by matching all of it where few are left."""
        tracked = self._carried_on(frame)
        is_due = self._rematching.is_due(len(self._tracked), self.settings.rematch_period)
        if is_due and (self._are_few(tracked) or self._has_turned(tracked)):
            tracked = self._replenished(tracked, frame.image)
            self._shift = _shift(tracked)
        return tracked

    def _has_turned(self, tracked: Tracks) -> bool:
        """Return whether a wide lens shows another part of the photograph than when it matched."""
        camera = self.canvas.camera
        if camera is None or camera.wraps or not len(tracked):
            return False
        return abs(_shift(tracked) - self._shift) > MOST_SHIFT * camera.width

    def _carried_on(self, frame: Frame) -> Tracks:
        """Return the tracks of the last frame in this one, without matching the whole image."""
        tracked = self._followed(frame)
        if not self._aligns_now:
            return self._on_common_motion(tracked)
        pixels = float_image(frame.image)
        tracked = self._aligned(tracked, pixels, self.settings.anchor_iterations)
        tracked = self._on_common_motion(tracked.without_residual_outliers())
        return self._reacquired(tracked, pixels).without_epipolar_outliers(self.canvas)

    @property
    def _aligns_now(self) -> bool:
        period = self.settings.anchor_period
        return period > 0 and self._frame % period == 0

    def _followed(self, frame: Frame) -> Tracks:
        """Return the tracks of the last frame, followed to this one by optical flow."""
        if self._previous is None or not len(self._tracked):
            return Tracks.empty()
        before = self._tracked.warps.current.astype(np.float32)
        after, valid = flow(
            self._previous,
            frame,
            before,
            settings=self.settings,
            coarse=self._aligns_now,
            both_ways=self.settings.anchor_period == 0,
        )
        current = after.astype(np.float64)
        valid &= inside_border(current, frame.image.shape, MARGIN)
        return self._tracked.followed(current, valid)

    def _on_common_motion(self, tracked: Tracks) -> Tracks:
        """Drop outliers of the motion since the last frame, which the predictions follow."""
        return tracked.take(self._predictions.follow(self._tracked.warps, tracked.warps))

    def _aligned(self, tracked: Tracks, image: FloatImage, iterations: int) -> Tracks:
        """Return the tracks aligned with the desired image, without those unlike it."""
        alignment = self._tied.anchor.align(tracked.warps, image, iterations=iterations)
        aligned = Tracks(alignment.warps, tracked.ages, alignment.residual)
        similar = alignment.correlation >= self.settings.min_correlation
        return aligned.take(similar & inside_border(aligned.warps.current, image.shape, MARGIN))

    def _reacquired(self, tracked: Tracks, image: FloatImage) -> Tracks:
        """Return the tracks and those missing candidates, tried in turn, that are in ``image``."""
        assert self._candidates is not None
        factor = FEW_FACTOR if len(tracked) < self.settings.min_features else 1
        count = factor * self.settings.search_per_frame
        ids = self._candidates.next_missing(tracked.warps, count, self._most)
        if not len(ids):
            return tracked
        predicted = self._predictions.select(ids)
        predicted = predicted._replace(warps=self.canvas.own(predicted.warps))
        warps = reacquire(predicted, tracked.warps, self._tied.anchor, image, self.canvas)
        found = self._aligned(Tracks.detected(warps), image, FIRST_ITERATIONS)
        if not len(found):
            return tracked
        joined = tracked.joined(found)
        if len(joined) <= self._most:
            return joined
        return self._candidates.limited(joined, tracked, self._most)

    def _replenished(self, tracked: Tracks, image: Image) -> Tracks:
        """Return the tracks filled up with features of a new matching of the whole image."""
        try:
            photograph, matches = self._rematching.matches(
                (self.photographs, self.photograph), len(self._tracked), image, self._most
            )
        except TrackingError as error:
            self.reason = str(error)
            return tracked
        self.reason = ''
        if photograph != self.photograph:
            if len(matches.indices) <= len(tracked):
                return tracked
            self._begin(photograph)
            tracked = self._tracked
        assert self._candidates is not None
        candidates, pixels = self._many(self.settings.candidates), float_image(image)
        warps = self._candidates.matched(matches, tracked.warps, candidates)
        joined = self._with_detected(tracked, warps, pixels)
        if self._are_few(joined):
            missing = self._most - len(joined)
            view, anchor = self._tied.view, self._tied.anchor
            more = among_neighbours(joined.warps, view, anchor, pixels, missing)
            joined = self._with_detected(joined, more, pixels)
        self._candidates.remember(joined.warps.ids, candidates)
        self._predictions.correct(joined.warps)
        return self._candidates.limited(joined, tracked, self._most)

    def _with_detected(self, tracked: Tracks, warps: Warps, image: FloatImage) -> Tracks:
        """Return the tracks and those ``warps`` that the image shows, of one geometry."""
        detected = self._aligned(Tracks.detected(warps), image, FIRST_ITERATIONS)
        return tracked.joined(detected).without_epipolar_outliers(self.canvas)


def _shift(tracks: Tracks) -> float:
    """Return how far to the right of the photograph's features the tracked ones are [px]."""
    if not len(tracks):
        return 0.0
    return median(tracks.warps.current[:, 0] - tracks.warps.desired[:, 0])
