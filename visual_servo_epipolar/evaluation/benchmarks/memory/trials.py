"""Trials: errors of the memory over many drives, against the bound."""

from collections.abc import Iterable
from dataclasses import dataclass
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.mapping.localization import MapLocalization
from visual_servo_epipolar.evaluation.benchmarks.memory.bound import bound
from visual_servo_epipolar.evaluation.benchmarks.memory.study import (
    remembered,
    StudySettings,
    Trial,
    trial,
)

PLANE = slice(0, 3)  # lateral, longitudinal, heading


@dataclass(frozen=True, eq=False)
class Errors:
    """
    Errors of T trials, (T, 3): lateral and longitudinal [m], heading [rad].

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
    def normalised(self) -> float:
        """Root mean square of errors in the deviations that were told: one, if those are right."""
        return math.sqrt(float(self.squares.mean()) / 3.0)


def localized(drive: Trial) -> MapLocalization:
    """Return what the memory says of the last view of a drive."""
    last = len(drive.views) - 1
    _, said = remembered(drive).after(drive.sightings(last), drive.motion(last))
    return said


def errors_of(settings: StudySettings, seeds: Iterable[int]) -> Errors:
    """Return the errors of the memory over trials with these seeds."""
    rows, bounds, squares = [], [], []
    found = wrong = innocent = silent = 0
    for seed in seeds:
        drive = trial(settings, seed)
        said = localized(drive)
        if said.reason:
            silent += 1
            continue
        error = (said.pose - drive.views[-1])[PLANE]
        rows.append(error)
        bounds.append(np.sqrt(np.diag(bound(drive))[PLANE]))
        squares.append(error @ np.linalg.solve(said.covariance[PLANE, PLANE], error))
        outliers = set(np.flatnonzero(~drive.right.any(0)).tolist()) & set(said.ids.tolist())
        dropped = set(said.dropped.tolist())
        found += len(outliers & dropped)
        wrong += len(outliers)
        innocent += len(dropped - outliers)
    arrays = np.array(rows), np.array(bounds), np.array(squares)
    return Errors(*arrays, found, wrong, innocent, silent)
