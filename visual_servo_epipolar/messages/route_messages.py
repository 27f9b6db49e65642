"""Messages of a route: the taught path, and how far a repetition has come."""

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import Path

from visual_servo_epipolar.core.routes.chain import path_poses
from visual_servo_epipolar.core.routes.follower import RouteProgress
from visual_servo_epipolar.core.routes.route import Route
from visual_servo_epipolar.core.routes.run import RouteStep
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.messages.diagnostics import LEVELS

FRAME = 'route'  # axes of the first key view: x forward, y left
PROGRESS = ('view', 'remaining', 'lateral', 'lateral_deviation', 'way', 'turn', 'inliers')


def path(route: Route, stamp_ns: int) -> Path:
    """Return the taught path of a ``route``, in axes of its first key view."""
    message = Path(header=write.header(stamp_ns, FRAME))
    message.poses = [write.pose_stamped(pose, stamp_ns, FRAME) for pose in path_poses(route)]
    return message


def telemetry(step: RouteStep) -> dict[str, float]:
    """Return what a step commanded, and how far it is if known, in SI units."""
    twist = {'linear_m_s': step.twist.linear, 'angular_rad_s': step.twist.angular}
    return twist if step.progress is None else twist | _progress(step.progress)


def _progress(values: RouteProgress) -> dict[str, float]:
    return {name: float(getattr(values, name)) for name in PROGRESS}


def diagnosis(step: RouteStep, stamp_ns: int, *, name: str) -> DiagnosticArray:
    """Return the phase of a repetition, why, and its progress as a diagnostic status."""
    values: dict[str, object] = {'phase': step.phase, 'reason': step.reason}
    if step.progress is not None:
        values |= _progress(step.progress)
    return write.diagnostics(
        name,
        level=LEVELS.get(step.phase, DiagnosticStatus.OK),
        summary=': '.join(filter(None, [step.phase, step.reason])),
        values=values,
        stamp_ns=stamp_ns,
    )
