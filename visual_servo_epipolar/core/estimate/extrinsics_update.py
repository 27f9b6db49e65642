"""Extrinsics update: when bearings update the mount, and when the result is accepted."""

from dataclasses import replace
import math

import numpy as np

from visual_servo_epipolar.core.estimate.extrinsics import (
    corrected,
    Extrinsics,
    is_linear,
    LEAST_DEVIATION,
    moved,
    moved_to,
    placed,
    RANGED,
    ranged,
    seen,
    seen_anew,
    unplaced,
    YAW,
)
from visual_servo_epipolar.core.perception.measurement import Measurement

SIGNIFICANT = (
    4.0,
    3.5,
)  # deviations from the configured one, until believed: at first, after a miss
# Below which little is gained [rad, m, m]; an offset aside alone is never certain.
LEAST = (math.radians(2.0), 0.1, math.inf)
# Of a yaw that legs by a memory of views tell, and its deviations from the configured one.
LEAST_OF_LEGS, SIGNIFICANT_OF_LEGS = math.radians(0.15), 2.0
LEAST_STEP = 0.02  # between two updates, travel [m] or turn [rad]
NEAR, UNCERTAIN = 0.15, math.radians(1.5)  # distance [m], deviation of a bearing [rad]
GATE = 6.0  # deviations beyond which a bearing begins the path anew
# Deviations from the configured mount beyond which it is not the mount that was learnt, and the
# least deviation of a yaw that walks [rad].
PLAUSIBLE, WALKED = 5.0, 0.05
FAULT = 5  # what one bearing beyond it counts as a contradiction


def update_extrinsics(
    before: Extrinsics, measurement: Measurement, travel: float, *, missed: bool
) -> Extrinsics:
    """Return the belief after ``travel`` [m] and a ``measurement``; sooner if ``missed``."""
    # Without a deviation, as the paper's estimator has none, bearings tell nothing of the path.
    known = math.isfinite(measurement.deviation) and not measurement.rivals
    bearings = measurement.bearings if known else None
    deviation = max(measurement.deviation, LEAST_DEVIATION) if bearings else math.nan
    remembers = measurement.remembered
    if not before.placed or measurement.rivals:  # which of two it is, its way is to tell first
        before = replace(before, remembers=remembers, placed=False)
        return placed(before, bearings, deviation) if bearings else before
    before = replace(before, travel=before.travel + travel)
    heading = measurement.heading_error
    turn = math.remainder(heading - before.heading, 2.0 * math.pi)
    if not math.isfinite(heading) or max(abs(before.travel), abs(turn)) < LEAST_STEP:
        return before
    # Two views do not know the lens: what they are off by is no motion.
    switched = remembers is not before.remembers
    if deviation > UNCERTAIN:
        bearings = None
    after = moved(before, heading)
    if bearings and not switched and not is_linear(after, bearings.psi, deviation):
        after = moved_to(before, heading, bearings.psi, deviation)
    if measurement.offset is not None:
        after = ranged(after, math.hypot(*measurement.offset), measurement.offset_deviation)
    if bearings is None or after.distance < NEAR:
        return after
    before = replace(before, remembers=remembers)
    seen_now = seen_anew if switched else seen
    after, innovation = seen_now(replace(after, remembers=remembers), bearings.psi, deviation)
    if abs(innovation) > GATE:
        anew = placed(before, bearings, deviation)
        return replace(anew, contradictions=before.contradictions + FAULT)
    if switched:
        return after
    if not is_plausible(after):
        anew = placed(unplaced(before.configured, before.deviations), bearings, deviation)
        return replace(anew, contradictions=before.contradictions + FAULT)
    believed = after.believed or is_significant(after, missed)
    return replace(after, contradictions=max(before.contradictions - 1, 0), believed=believed)


def with_yaw(before: Extrinsics, yaw: float, deviation: float) -> Extrinsics:
    """Return the belief after legs showed a ``yaw`` [rad], if it is not the one gone by."""
    off = abs(math.remainder(yaw - before.mount[0], 2.0 * math.pi))
    if not (before.believed or off > max(SIGNIFICANT_OF_LEGS * deviation, LEAST_OF_LEGS)):
        return before
    innovation = math.remainder(yaw - before.mean[YAW], 2.0 * math.pi)
    after = corrected(before, YAW, innovation, deviation * deviation)
    return replace(after, believed=True) if is_plausible(after) else before


def is_plausible(belief: Extrinsics) -> bool:
    """Return whether the mount may be what was learnt, and not a path that led nowhere."""
    changes = np.abs(belief.mean[YAW:] - belief.configured)
    deviations = np.maximum(belief.deviations, [WALKED, 0.0, 0.0])
    return bool((changes <= PLAUSIBLE * deviations).all())


def is_significant(belief: Extrinsics, missed: bool) -> bool:
    """Return whether what was learnt of the mount differs from the configured one, and matters."""
    _, distance, *deviations = np.sqrt(belief.covariance.diagonal()).tolist()
    if distance > RANGED[missed]:
        return False
    changes = (belief.mean[YAW:] - belief.configured).tolist()
    return any(
        abs(change) > SIGNIFICANT[missed] * deviation and abs(change) > least
        for change, deviation, least in zip(changes, deviations, LEAST, strict=True)
    )
