"""Reasons why an image does not count, or a run goes no further: each one with its text, here."""

from enum import Enum


class Because(str):
    """Text of a ``reason``, with its values filled in; the empty text is that of no reason."""

    reason: 'Reason'

    def __new__(cls, text: str, reason: 'Reason | None' = None) -> 'Because':
        """Return a text; pickle gives it its reason afterwards."""
        made = super().__new__(cls, text)
        made.reason = reason or Reason.OTHER
        return made


class Reason(Enum):
    """Reason by name: what is decided by one is decided by its name, never by its text."""

    NONE = ''
    OTHER = '{}'  # in words of an estimator, or of whoever calls
    # No bearings: what two views, or a memory of views, do not tell.
    FEW_FEATURES = '{} features, {} needed'
    MEMORY_OVER = '{}; few_features_timeout of {:g} s is over'
    SMALL_PARALLAX = 'a parallax of {:.2f} px is too small for epipoles'
    SKIPPED = 'a memory of views knows the epipoles'
    FEW_INLIERS = 'only {} of {} matches agree on one geometry'
    CLUSTERED = 'the features are clustered within {:.1f} deg'
    UNDECIDED = 'the cheirality vote is undecided ({:.3f})'
    TILTED = 'the camera tilted by {:.1f} deg between the views'
    UNCERTAIN = 'the bearings are uncertain by {:.1f} deg'
    LEAPT = 'the bearings leapt by {:.1f} deg in one frame'
    TWO_GEOMETRIES = 'two geometries fit the features: one plane dominates the scene'
    TURNED_OTHERWISE = 'the features as a whole have turned by {:.0f} deg more'
    ROLLED_OVER = 'the image has rolled by {:.0f} deg, as if it were mirrored or upside down'
    DISPROVED = 'the bearings contradict what was driven; they are looked for anew'
    OTHER_LENS = 'the matches contradict the camera: {}'
    # A run that cannot begin or go on.
    NONE_IN_VIEW = 'no feature of the photograph is in view'
    FEW_IN_VIEW = 'no feature of the photograph is in view for certain: {} found, {} needed'
    NONE_AHEAD = 'no feature is ahead in both views'
    UNTRUSTED = 'bearings not trusted in {}'
    STAMPS_LEAPT = 'no image for {:.1f} s by their stamps'
    OTHER_GOAL = (
        'the photograph has changed in mid-run: its tracks lead to another goal; send the one it '
        'began with, or reset'
    )
    OTHER_CAMERA = (
        'camera_info has changed in mid-run: {}; the photograph is of another camera; publish '
        'the one it began with, or reset'
    )
    NO_JOINTS = (
        'the angles of the head at the image are not known: it may look anywhere; let its driver '
        'publish them, or set rig: fixed'
    )
    # The end of a run.
    RUN_TIMED_OUT = 'the run took longer than {:g} s, still {}'
    HELD = 'held for {:g} s: {}'
    LOST = 'tracks lost or untrusted for {:g} s: {}, {:.1f} s ago'
    PHASE_TIMED_OUT = '{} took longer than {:.3g} s{}'
    SWINGS = (
        ': the robot turns to and fro; check whether camera_info belongs to these images, and '
        'latency to this base'
    )
    DIVERGED = 'the desired epipole ran away to infinity in {}'
    MISSED = 'features are {:.1f} px off, parallax {:.1f} px, at the end of attempt {}{}'
    DISOBEYED = '{} times in this run: {}'
    RESTARTED = (
        'step 1 was given up {} times: the turn that begins it loses the view, or it leads away; '
        'begin farther away and in front of the goal'
    )
    NO_RETREAT = (
        'the robot would have to back off, and max_retreat is 0; begin farther away and in '
        'front of the goal, or give it the metres of free floor behind the robot'
    )
    BACKWARD = 'drove {:.1f} m backward in this run (max_retreat), still {}'
    LONG_WAY = 'drove {:.0f} m in {} and is not there (initial_distance)'
    EXCURSION = '{} leads away from the goal: {:.1f} times the distance (max_excursion)'

    def of(self, *values: object) -> Because:
        """Return the text with its ``values``."""
        return Because(self.value.format(*values), self)


def reason_of(text: str) -> Reason:
    """Return the reason of a ``text``: OTHER where it does not come from this table."""
    if isinstance(text, Because):
        return text.reason
    return Reason.OTHER if text else Reason.NONE
