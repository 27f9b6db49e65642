"""The servo's state as named numbers: what is published, recorded and plotted."""

from collections.abc import Mapping
import math

from visual_servo_epipolar.core.geometry.motion import Pose, Twist
from visual_servo_epipolar.core.servo.phases.table import Phase
from visual_servo_epipolar.core.servo.run_log import Sample
from visual_servo_epipolar.core.servo.state import ServoState


def telemetry(state: ServoState) -> dict[str, float]:
    """
    Return what the servo saw and decided, by name; the unit is the end of each name.

    Epipoles are abscissae from the principal point; bearings are those of the other camera's
    centre, oriented, right positive. ``focal_ratio`` is the focal length of the camera matrix over
    the true one, ``principal_shift_px`` how far right of the true one its principal point lies, as
    far as the servo has found out. What could not be measured is nan.
    """
    measurement, memory = state.measurement, state.memory
    if measurement is None or memory is None:
        raise ValueError('there is no telemetry before the first tracks; step the servo first')
    bearings, focal = measurement.bearings, measurement.focal
    return {
        'epipole_current_px': focal * bearings.epipole_current if bearings else math.nan,
        'epipole_desired_px': focal * bearings.epipole_desired if bearings else math.nan,
        'bearing_current_rad': bearings.current if bearings else math.nan,
        'bearing_desired_rad': bearings.desired if bearings else math.nan,
        'psi_rad': bearings.psi if bearings else math.nan,
        'phi_rad': bearings.phi if bearings else math.nan,
        'sigma': bearings.sigma if bearings else math.nan,
        'sigma_confidence': measurement.confidence,
        'trusted': float(bearings is not None),
        'psi_variance_rad2': float(measurement.covariance[0, 0]),
        'phi_variance_rad2': float(measurement.covariance[1, 1]),
        'psi_phi_covariance_rad2': float(measurement.covariance[0, 1]),
        'inliers': float(measurement.inliers),
        'features': float(measurement.features),
        'parallax_px': measurement.parallax_px,
        'heading_error_rad': measurement.heading_error,
        'tilt_rad': memory.attitude.tilt,
        'roll_rad': memory.attitude.roll,
        'noise_px': measurement.noise_px,
        'feature_difference_px2': measurement.difference * focal**2,
        'feature_error_px': measurement.feature_error * focal,
        'distance_estimate_m': state.distance,
        'linear_m_s': state.twist.linear,
        'angular_rad_s': state.twist.angular,
        'attempt': float(state.attempts),
        # New numbers come last: plots look for the others by their place.
        'focal_ratio': math.exp(memory.lens.log_ratio),
        'focal_ratio_deviation': memory.lens.ratio_deviation,
        'principal_shift_px': focal * memory.lens.shift,
        'longitudinal_error_m': state.longitudinal_error,
        'curvature_rad_m': state.curvature.value,
    }


def sample(stamp_ns: int, pose: Pose, phase: Phase, numbers: Mapping[str, float]) -> Sample:
    """Return the record of one step from its telemetry and the ground truth."""
    return Sample(
        stamp_ns=stamp_ns,
        pose=pose,
        twist=Twist(numbers['linear_m_s'], numbers['angular_rad_s']),
        phase=phase,
        features=int(numbers['features']),
        epipole_current=numbers['epipole_current_px'],
        epipole_desired=numbers['epipole_desired_px'],
        bearing_current=numbers['bearing_current_rad'],
        bearing_desired=numbers['bearing_desired_rad'],
        feature_difference=numbers['feature_difference_px2'],
        feature_error=numbers['feature_error_px'],
        distance_estimate=numbers['distance_estimate_m'],
    )
