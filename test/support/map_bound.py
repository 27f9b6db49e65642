"""Bound: Fisher information of photograph and all views; and errors of the memory beside it."""

from collections.abc import Iterable
from dataclasses import dataclass
import math

from map_study import map_after_drive, seen_from, StudySettings, StudyTrial, trial
import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.mapping.localization import MapLocalization

STEP = 1e-6
TINY, KNOWN = 1e-9, 1e-4
VIEW = 5


def bound(trial: StudyTrial) -> FloatArray:
    """
    Return the least covariance of the last view's pose, (5, 5), that an estimate can have.

    Unknown are all features, all views, the attitudes of photograph and mount. What is wrong does
    not count: no estimate knows more than one that is told which matches are wrong.
    """
    views, count = len(trial.views), len(trial.features)
    photograph = np.concatenate([np.zeros(3), trial.attitude])
    first = VIEW * (views + 1) + 2
    information = np.zeros((first + 3 * count, first + 3 * count))
    for k, view in enumerate((*trial.views, photograph)):
        right = trial.seen[k] & trial.right[k] if k < views else trial.right.any(0)
        _add_view(information, trial, k, view, np.asarray(right, bool))
    _add_attitudes(information, trial)
    _add_scale(information, trial)
    # The photograph is where it is: x, y and heading of it are no unknowns.
    fixed = VIEW * views + np.arange(3)
    diagonal = np.arange(first, len(information))
    information[diagonal, diagonal] += 1e-6
    free = np.setdiff1d(np.arange(len(information)), fixed)
    covariance = np.linalg.inv(information[np.ix_(free, free)])
    last = VIEW * (views - 1) + np.arange(VIEW)
    return np.asarray(covariance[np.ix_(last, last)])


def _add_view(
    information: FloatArray, trial: StudyTrial, k: int, view: FloatArray, seen: BoolArray
) -> None:
    rows = np.flatnonzero(seen)
    features = trial.features[rows]
    first = VIEW * (len(trial.views) + 1) + 2

    def pixels(step: FloatArray, move: FloatArray) -> FloatArray:
        return trial.settings.camera.pixels(seen_from(features + move, view + step))

    still, nothing = np.zeros(VIEW), np.zeros(3)
    here = pixels(still, nothing)
    scale = STEP * trial.settings.noise
    views = [(pixels(STEP * axis, nothing) - here) / scale for axis in np.eye(VIEW)]
    moves = [(pixels(still, STEP * axis) - here) / scale for axis in np.eye(3)]
    by_view, by_point = (np.stack(each, axis=-1) for each in (views, moves))
    own, points = VIEW * k + np.arange(VIEW), first + 3 * rows[:, None] + np.arange(3)
    information[np.ix_(own, own)] += np.einsum('nri,nrj->ij', by_view, by_view)
    information[points[:, :, None], points[:, None]] += by_point.swapaxes(1, 2) @ by_point
    cross = by_view.swapaxes(1, 2) @ by_point
    information[own[None, :, None], points[:, None]] += cross
    information[points[:, :, None], own[None, None]] += cross.swapaxes(1, 2)


def _add_attitudes(information: FloatArray, trial: StudyTrial) -> None:
    views = len(trial.views) + 1
    jitter = max(trial.settings.jitter, 1e-4) ** -2
    for axis in range(2):
        each, mount = VIEW * np.arange(views) + 3 + axis, VIEW * views + axis
        information[each, each] += jitter
        information[each, mount] -= jitter
        information[mount, each] -= jitter
        information[mount, mount] += views * jitter + trial.settings.tilt_deviation**-2


def _add_scale(information: FloatArray, trial: StudyTrial) -> None:
    """Add what is known of the whole way from view to view; of one view, how far off it is."""
    places = trial.views[:-1, :2] if len(trial.views) > 1 else trial.views[:, :2]
    slope = np.zeros((len(places), 2))
    steps = np.diff(places, axis=0)
    ways = np.hypot(*steps.T)
    slope[1:] += steps / ways[:, None]
    slope[:-1] -= steps / ways[:, None]
    slope /= max(float(ways.sum()), TINY) * max(trial.settings.scale_error, 1e-3)
    if len(trial.views) == 1:
        slope = places / (places**2).sum() / KNOWN
    row = np.zeros(len(information))
    row[: VIEW * len(places)].reshape(-1, VIEW)[:, :2] = slope
    information += np.outer(row, row)


PLANE = slice(0, 3)  # lateral, longitudinal, heading


@dataclass(frozen=True, eq=False)
class TrialErrors:
    """
    TrialErrors of T trials, (T, 3): lateral and longitudinal [m], heading [rad].

    ``bounds``, (T, 3), are the least deviations; ``squares``, (T,), what errors are in deviations
    that were told, of three numbers; ``found`` and ``wrong`` the wrong matches that were dropped,
    and that there were; ``innocent`` others that were dropped; ``silent`` trials without a pose.
    """

    values: FloatArray
    bounds: FloatArray
    squares: FloatArray
    found: int
    wrong: int
    innocent: int
    silent: int

    @property
    def rms(self) -> FloatArray:
        """Root mean square of lateral and longitudinal error [m] and of heading's [rad]."""
        return np.asarray(np.sqrt((self.values**2).mean(0)))

    @property
    def bound(self) -> FloatArray:
        """Root mean square of the bounds."""
        return np.asarray(np.sqrt((self.bounds**2).mean(0)))

    @property
    def normalised_error(self) -> float:
        """Root mean square of errors in the deviations that were told: one, if those are right."""
        return math.sqrt(float(self.squares.mean()) / 3.0)


def localize(drive: StudyTrial) -> MapLocalization | None:
    """Return what the memory says of the last view of a drive."""
    last = len(drive.views) - 1
    _, said = map_after_drive(drive).after(drive.observations(last), drive.motion(last))
    return said


def errors_of(settings: StudySettings, seeds: Iterable[int]) -> TrialErrors:
    """Return the errors of the memory over trials with these seeds."""
    rows, bounds, squares = [], [], []
    found = wrong = innocent = silent = 0
    for seed in seeds:
        drive = trial(settings, seed)
        said = localize(drive)
        if said is None:
            silent += 1
            continue
        error = (said.pose - drive.views[-1])[PLANE]
        rows.append(error)
        bounds.append(np.sqrt(np.diag(bound(drive))[PLANE]))
        squares.append(error @ np.linalg.solve(said.covariance[PLANE, PLANE], error))
        outliers = set(np.flatnonzero(~drive.right.any(0)).tolist()) & set(
            said.geometry.window.ids.tolist()
        )
        dropped = set(said.geometry.wrong.tolist())
        found += len(outliers & dropped)
        wrong += len(outliers)
        innocent += len(dropped - outliers)
    arrays = np.array(rows), np.array(bounds), np.array(squares)
    return TrialErrors(*arrays, found, wrong, innocent, silent)
