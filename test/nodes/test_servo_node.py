"""The servo as a node: it commands while it may, and stops the robot whenever in doubt."""

import math

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
import numpy as np
import pytest
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from servo_rig import (
    AWAY,
    GOAL,
    IN_VIEW,
    NOTHING,
    PERIOD_NS,
    Rig,
    STAMP_NS,
    tracks,
    UNCALIBRATED,
)
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import integrate, STANDSTILL
from visual_servo_epipolar.messages import read, settings_text, write
from visual_servo_epipolar.nodes import qos


@pytest.fixture
def rig(bench):
    return Rig(bench)


def test_a_run_that_has_ended_or_was_reset_begins_anew_on_start_alone(bench) -> None:
    rig = Rig(bench, autostart=False, memory=False)
    rig.see(GOAL)
    bench.call('servo_node/start')
    rig.see(GOAL)
    assert rig.phase == 'arrived'
    rig.see(AWAY)
    assert rig.twist == STANDSTILL
    bench.call('servo_node/start')
    rig.drive()
    answer = bench.call('servo_node/reset')
    assert (answer.success, answer.message) == (True, 'ready for a new run; call ~/start')
    rig.stand()
    bench.call('servo_node/start')
    rig.drive()


def at(u: float):
    """Return what puts a feature at a column."""
    return lambda cloud: np.frombuffer(cloud.data, write.TRACK_LAYOUT)['u'].put(3, u)


BAD = {
    'no cloud': lambda cloud: setattr(cloud, 'fields', cloud.fields[1:]),
    'truncated': lambda cloud: cloud.data.pop(),
    'at no place': at(math.nan),
    'far outside': at(1e300),
    'empty': lambda cloud: None,
}


@pytest.mark.parametrize('bad', BAD)
def test_tracks_that_cannot_be_used_hold_the_robot(rig, bad) -> None:
    rig.drive()
    features = NOTHING if bad == 'empty' else IN_VIEW
    cloud = write.features(features, rig.stamp_ns, 'camera')
    BAD[bad](cloud)
    rig.tell(cloud)
    assert (rig.phase, rig.twist) == ('holding', STANDSTILL)
    assert (bad == 'empty') is not bool(rig.bench.logged('tracks refused: '))
    assert ('0 features, 12 needed' in rig.reason) == (bad == 'empty')
    assert rig.reports[-1].status[0].level == DiagnosticStatus.WARN
    rig.stamp_ns += PERIOD_NS
    rig.resume()


@pytest.mark.parametrize('driving', [False, True])
def test_an_uncalibrated_camera_never_moves_the_robot_and_stops_it(bench, driving) -> None:
    rig = Rig(bench, calibrated=driving)
    if driving:
        rig.drive()
    rig.hear(UNCALIBRATED)
    bench.until(lambda: bench.logged('K[0] = 0 means an uncalibrated camera'), 'the complaint')
    for _ in range(3):
        assert rig.twist == STANDSTILL
        rig.see()


def test_tracks_wait_for_the_first_camera_info(bench) -> None:
    rig = Rig(bench, calibrated=False)
    rig.see()
    assert rig.commands == []
    rig.hear()
    bench.until(lambda: bool(rig.commands), 'a command')
    assert rig.twists()[0] != STANDSTILL


def test_what_it_says_carries_the_stamp_of_the_tracks(bench) -> None:
    epipoles = bench.listen(JointState, 'epipoles')
    markers = bench.listen(MarkerArray, 'servo_node/markers')
    rig = Rig(bench)
    rig.see()

    def of_steps():
        return [item for item in rig.reports if read.is_of_step(read.diagnosis(item))]

    bench.until(lambda: bool(epipoles and of_steps() and markers), 'its report')
    headers = [epipoles[0].header, of_steps()[0].header]
    headers += [marker.header for marker in markers[0].markers]
    assert {read.stamp_ns(header) for header in headers} == {STAMP_NS}
    assert markers[0].markers[0].header.frame_id == 'camera_optical_frame'
    assert rig.words[-1].data == read.diagnosis(of_steps()[0])['phase'] == 'displacing'


def test_epipoles_are_published_as_measured(bench) -> None:
    epipoles = bench.listen(JointState, 'epipoles')
    Rig(bench).see()
    bench.until(lambda: bool(epipoles), 'epipoles')
    truth = Bearings.from_pose(AWAY)
    telemetry = read.telemetry(epipoles[0])
    # 60 points at 0.2 px from 3.6 m: a tenth of a degree; five times that is no luck.
    assert telemetry['bearing_current_rad'] == pytest.approx(truth.current, abs=math.radians(0.5))
    assert telemetry['bearing_desired_rad'] == pytest.approx(truth.desired, abs=math.radians(1.5))


def test_the_goal_is_published_in_the_base_as_far_as_its_covariance_says(bench) -> None:
    goals = bench.listen(PoseWithCovarianceStamped, 'goal_pose')
    rig, pose = Rig(bench, law='smooth', base_frame='base'), AWAY
    for _ in range(40):
        rig.see(pose)
        stamp_ns = rig.stamp_ns - PERIOD_NS
        if goals and read.stamp_ns(goals[-1].header) == stamp_ns:
            break
        pose = integrate(pose, rig.twists()[-1], 1e-9 * PERIOD_NS)
    message = goals[-1]
    assert (message.header.frame_id, read.stamp_ns(message.header)) == ('base', stamp_ns)
    sine, cosine = math.sin(pose.heading_error), math.cos(pose.heading_error)
    true = [pose.x * sine - pose.y * cosine, pose.x * cosine + pose.y * sine]
    found = message.pose.pose
    error = np.array([found.position.x, found.position.y]) - true
    covariance = message.pose.covariance.reshape(6, 6)[:2, :2]
    assert error @ np.linalg.solve(covariance, error) < 3.0**2
    assert np.sqrt(covariance.trace()) < 0.5 * pose.distance  # it is known, not just not wrong


def test_a_late_listener_still_hears_the_phase(rig) -> None:
    rig.see()
    phases = rig.bench.listen(String, 'phase', qos.LATCHED)
    rig.bench.until(lambda: bool(phases), 'the phase')
    assert phases[0].data == rig.phase


def test_it_gives_stamped_commands(bench) -> None:
    rig = Rig(bench, enable_stamped_cmd_vel=True, base_frame='robot')
    rig.see()
    header = rig.commands[0].header
    assert (read.stamp_ns(header), header.frame_id) == (STAMP_NS, 'robot')
    assert rig.twists()[0] != STANDSTILL


def test_a_setting_changed_on_the_way_is_published_with_the_stamp_it_holds_from(rig) -> None:
    received = rig.bench.listen(String, 'servo_node/settings', qos.LATCHED)
    rig.bench.until(lambda: len(received) == 1, 'settings before')
    rig.see()
    rig.node.set_parameters([Parameter('latency', value=0.5)])
    rig.bench.until(lambda: len(received) == 2, 'settings after')
    before, after = (settings_text.from_text(message.data) for message in received)
    assert (before.values['latency'], before.after_stamp_ns) == (0.1, None)
    assert (after.values['latency'], after.after_stamp_ns) == (0.5, STAMP_NS)


@pytest.mark.parametrize('watchdog', [True, False])
@pytest.mark.parametrize('later_ns', [0, -PERIOD_NS], ids=['repeated', 'backwards'])
def test_stamps_that_do_not_advance_are_said_so(bench, later_ns, watchdog) -> None:
    rig = Rig(bench, watchdog=watchdog)
    rig.see()
    text = 'the stamps do not advance; is /clock published?'
    assert not bench.logged(text)
    bench.call('servo_node/stop')  # nor does a step say it
    rig.send(tracks(stamp_ns=STAMP_NS + later_ns))
    bench.until(lambda: bench.logged(text), 'the warning')


def test_orders_are_logged(rig) -> None:
    rig.see()
    for order, text in (('stop', 'stopped'), ('start', 'started'), ('reset', 'reset, ready')):
        rig.bench.call(f'servo_node/{order}')
        rig.bench.until(lambda text=text: rig.bench.logged(text), text)


def test_a_change_of_phase_is_logged_once_with_its_reason(rig) -> None:
    text = 'waiting -> displacing (apart)'
    rig.drive()
    rig.see()
    rig.bench.until(lambda: rig.bench.logged(text), text)
    rig.bench.settle()
    assert rig.bench.logged(' -> displacing') == [text]
