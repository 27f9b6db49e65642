"""Messages of a route: the taught path, its key views, and how far a repetition has come."""

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Point
from nav_msgs.msg import Path
from visualization_msgs.msg import Marker, MarkerArray

from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.routes.chain import path_poses
from visual_servo_epipolar.core.routes.follower import RouteProgress
from visual_servo_epipolar.core.routes.route import Route
from visual_servo_epipolar.core.routes.run import RouteStep
from visual_servo_epipolar.messages import write

FRAME = 'route'  # axes of the first key view: x forward, y left
DOT, STATION_DOT = 0.06, 0.16  # diameters [m]
PROGRESS = ('view', 'remaining', 'lateral', 'lateral_deviation', 'way', 'turn', 'inliers')
LEVELS = {Phase.HOLDING.value: DiagnosticStatus.WARN, Phase.FAILED.value: DiagnosticStatus.ERROR}


def path(route: Route, stamp_ns: int) -> Path:
    """Return the taught path of a ``route``, in axes of its first key view."""
    message = Path(header=write.header(stamp_ns, FRAME))
    message.poses = [write.pose_stamped(pose, stamp_ns, FRAME) for pose in path_poses(route)]
    return message


def markers(route: Route, stamp_ns: int) -> MarkerArray:
    """Return the key views as dots, the stations as large ones."""
    kinds = (('key views', False, DOT), ('stations', True, STATION_DOT))
    return MarkerArray(
        markers=[_dots(route, *kind, number, stamp_ns) for number, kind in enumerate(kinds)]
    )


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


def _dots(
    route: Route, name: str, are_stations: bool, size: float, number: int, stamp_ns: int
) -> Marker:
    marker = Marker(header=write.header(stamp_ns, FRAME), ns=name, id=number)
    marker.type, marker.pose.orientation.w = Marker.SPHERE_LIST, 1.0
    marker.scale.x = marker.scale.y = marker.scale.z = size
    marker.color.g, marker.color.a = 1.0, 1.0
    marker.color.r = 1.0 if are_stations else 0.0
    views = [view for view in route.views if view.is_station == are_stations]
    marker.points = [Point(x=float(view.pose[0]), y=float(view.pose[1])) for view in views]
    return marker
