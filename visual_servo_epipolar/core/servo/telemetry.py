"""Telemetry: the state of the servo as named numbers, to be published, recorded and plotted."""

from collections.abc import Mapping
import math

from visual_servo_epipolar.core.estimate.goal_estimate import GoalEstimate
from visual_servo_epipolar.core.geometry.motion import Pose, Twist
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.odometry.legs import UNKNOWN_RANGE
from visual_servo_epipolar.core.rigs.rig import Joints
from visual_servo_epipolar.core.servo.run_log import Sample
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.twoview.measurement import Measurement
from visual_servo_epipolar.core.twoview.memory import PerceptionMemory

# A replay ramps by the first, and drives by the others.
SINCE_COMMAND = 'since_command_s'
ODOMETRY = 'odometry_x_m', 'odometry_y_m', 'odometry_yaw_rad'
JOINTS = 'pan_rad', 'tilt_rad'


def telemetry(state: ServoState) -> dict[str, float]:
    """
    Return the measurement, the estimates and the command by name; each name ends with its unit.

    Epipoles are abscissae from the principal point; bearings are those of the other camera's
    centre, oriented, right positive. ``focal_ratio`` is the estimated focal length over the true
    one, ``principal_shift_px`` how far right of the true principal point the estimate lies. What
    could not be measured is nan. Raises ValueError before the first image.
    """
    measurement, memory = state.measurement, state.view.memory
    if measurement is None or memory is None:
        raise ValueError('there is no telemetry before the first tracks; step the servo first')
    pose = state.identified.odometry.pose
    wheels = (math.nan,) * 3 if pose is None else (pose.x, pose.y, pose.theta)
    readout, readout_deviation = memory.shutter.estimate
    return {
        **_epipoles(measurement),
        'psi_variance_rad2': float(measurement.covariance[0, 0]),
        'phi_variance_rad2': float(measurement.covariance[1, 1]),
        'psi_phi_covariance_rad2': float(measurement.covariance[0, 1]),
        **_features(measurement, memory),
        'distance_estimate_m': _distance(state, measurement),
        'linear_m_s': state.twist.linear,
        'angular_rad_s': state.twist.angular,
        'attempt': float(state.run.attempts),
        # New numbers come last: plots look for the others by their place.
        'focal_ratio': math.exp(memory.lens.log_ratio),
        'focal_ratio_deviation': memory.lens.ratio_deviation,
        'principal_shift_px': measurement.focal * memory.lens.shift,
        # y = D / (dD/dy), negative behind the goal.
        'longitudinal_error_m': measurement.difference / state.motion.slope.value,
        'curvature_rad_m': state.identified.curvature.value,
        SINCE_COMMAND: state.since_command,
        'dead_band_linear_m_s': state.identified.dead_band.linear.value,
        'dead_band_angular_rad_s': state.identified.dead_band.angular.value,
        'delay_s': state.identified.delay.value,
        # The pose of the wheels at the image, in their own frame, and the angles of the head.
        **dict(zip(ODOMETRY, wheels, strict=True)),
        **dict(zip(JOINTS, state.view.joints or (math.nan,) * 2, strict=True)),
        'readout_s': readout,
        'readout_deviation_s': readout_deviation,
    }


def odometry_of(values: Mapping[str, float]) -> Pose | None:
    """Return the pose of the wheels that a telemetry has; None without one."""
    x, y, theta = (values.get(name, math.nan) for name in ODOMETRY)
    return None if math.isnan(x + y + theta) else Pose(x, y, theta)


def joints_of(values: Mapping[str, float]) -> Joints | None:
    """Return the angles of the head that a telemetry has; None without one."""
    pan, tilt = (values.get(name, math.nan) for name in JOINTS)
    return None if math.isnan(pan + tilt) else Joints(pan, tilt)


def _distance(state: ServoState, measurement: GoalEstimate) -> float:
    """Return d_hat as its law uses it [m]: law smooth takes it from the memory, or as ranged."""
    one_motion = state.phase.straight and state.phase is not Phase.MATCHING_FEATURES
    return measurement.distance(UNKNOWN_RANGE) if one_motion else state.motion.distance


def _epipoles(measurement: Measurement) -> dict[str, float]:
    """Return epipoles and bearings, nan where they are not trusted."""
    bearings, focal = measurement.seen_bearings, measurement.focal
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
    }


def _features(measurement: Measurement, memory: PerceptionMemory) -> dict[str, float]:
    """Return what comes from features and inliers alone, without bearings."""
    return {
        'inliers': float(measurement.inliers),
        'features': float(measurement.features),
        'parallax_px': measurement.parallax_px,
        'heading_error_rad': measurement.heading_error,
        'tilt_rad': memory.attitude.tilt,
        'roll_rad': memory.attitude.roll,
        'noise_px': measurement.noise_px,
        'feature_difference_px2': measurement.difference * measurement.focal**2,
        'feature_error_px': measurement.feature_error * measurement.focal,
    }


def sample(stamp_ns: int, pose: Pose, phase: Phase, values: Mapping[str, float]) -> Sample:
    """Return the sample of one step from its true ``pose`` and telemetry, ``values`` by name."""
    return Sample(
        stamp_ns=stamp_ns,
        pose=pose,
        twist=Twist(values['linear_m_s'], values['angular_rad_s']),
        phase=phase,
        features=int(values['features']),
        epipole_current=values['epipole_current_px'],
        epipole_desired=values['epipole_desired_px'],
        bearing_current=values['bearing_current_rad'],
        bearing_desired=values['bearing_desired_rad'],
        feature_difference=values['feature_difference_px2'],
        feature_error=values['feature_error_px'],
        distance_estimate=values['distance_estimate_m'],
    )
