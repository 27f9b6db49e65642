"""
Control laws beside ours: shared starts, features, limits and measure of success.

The peers are given the true pose, the best that a law based on position can have, and look at
features alone: where they lose them they stop. ``polar`` is the law of Aicardi, Casalino, Bicchi,
Balestrino (1995): with e the distance, a the direction of the goal against the heading and b
against the goal's heading, u = g cos(a) e and w = k a + g cos(a) sin(a) / a (a + h b) make
(e^2 + a^2 + h b^2) / 2 fall. Close to the goal, where directions change fast, the robot covers the
way ahead and turns to the final heading. ``graceful`` is Nav2's controller, ``displaced`` drives a
point ahead of the axle (section IX-1 of the paper).
"""

from collections.abc import Callable, Mapping
import math
from operator import itemgetter
from typing import Any

from visual_servo_epipolar.core.geometry.motion import HALF_PI, Pose, saturate, Twist, wrap_angle
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.laws.steering import aim, curvature, Gains, polar_pose
from visual_servo_epipolar.core.rigs.rig import Command, HALT
from visual_servo_epipolar.core.servo.run_log import summarise, WRONG_DEG, WRONG_M
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.stamps import seconds_between
from visual_servo_epipolar.core.twoview.measurement import Measurement
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.core.twoview.perceive import perceive
from visual_servo_epipolar.evaluation.benchmarks.sweeps import LONGEST_S, within
from visual_servo_epipolar.evaluation.tables import aligned, cells, Columns, number, numbers
from visual_servo_epipolar.simulation.closed_loop import Control, Loop
from visual_servo_epipolar.simulation.regions import start_in
from visual_servo_epipolar.simulation.scenario import Scenario
from visual_servo_epipolar.simulation.views import points_of
from visual_servo_epipolar.sweeping.summary import quantile

CLOSE = 0.05  # distance at which directions change fast [m]
APPROACH, TURN, ALIGN = 0.3, 1.0, 1.5  # polar law: g and k [1/s], weight h of the final heading
MATCHED_PX, MATCHED_FRAMES = 0.7, 5  # median feature error at which a peer has arrived
STILL, STILL_FRAMES = 1e-3, 55  # speed at which it stands [m/s, rad/s], for five seconds
NEAR_PX = 2.0  # feature error at which a peer that stands has arrived too


def as_step(law: Callable[[], Twist]) -> Control:
    """
    Return ``law`` as a step of one closed loop.

    It has our perception of the features, our limits and our stop where there are too few. It has
    arrived when the features match to their noise, or nearly and it stands; it has failed when it
    stands where they do not.
    """
    still = 0  # frames for which it has stood

    def drive(state: ServoState, observation: Observation, settings: ServoSettings) -> ServoState:
        nonlocal still
        perception = perceive(observation, settings, state.view.frame, state.view.memory)
        seen, frame = perception.measurement, state.view.frame + 1
        state = state.changed(measurement=seen, memory=perception.memory, frame=frame)
        if state.phase.ended:
            return state.changed(command=HALT)
        if seen.features < settings.min_features:
            return _held(state, seen, settings)
        if state.phase is not Phase.MATCHING_FEATURES:
            state = state.changed(phase=Phase.MATCHING_FEATURES, reason='')
            state = state.changed(run_start_ns=state.run.run_start_ns or seen.stamp_ns)
        error = seen.feature_error * seen.focal
        twist = saturate(law(), max_linear=settings.max_linear, max_angular=settings.max_angular)
        stands = max(abs(twist.linear), abs(twist.angular)) < STILL
        still = still + 1 if stands else 0
        settled = state.settling.settled + 1 if error <= MATCHED_PX else 0
        if settled >= MATCHED_FRAMES or (still >= STILL_FRAMES and error <= NEAR_PX):
            return state.changed(phase=Phase.ARRIVED, command=HALT, reason='matched')
        if still >= STILL_FRAMES:
            return _fail(state, f'stands still with the features {error:.1f} px off')
        return state.changed(command=Command(twist), settled=settled)

    return drive


def _held(state: ServoState, measurement: Measurement, settings: ServoSettings) -> ServoState:
    if state.phase is not Phase.HOLDING:
        return state.changed(
            phase=Phase.HOLDING, phase_start_ns=measurement.stamp_ns, command=HALT
        )
    waited = seconds_between(state.run.phase_start_ns, measurement.stamp_ns)
    if waited > settings.holding_timeout:
        return _fail(state, f'lost the features: {measurement.reason}')
    return state


def _fail(state: ServoState, reason: str) -> ServoState:
    return state.changed(phase=Phase.FAILED, command=HALT, reason=reason)


def polar(pose: Pose, settings: ServoSettings) -> Twist:
    """Return the velocity of the polar law; where the goal is behind, the other end drives."""
    ahead = -(pose.x * math.cos(pose.theta) + pose.y * math.sin(pose.theta))
    if pose.distance < CLOSE:
        return Twist(APPROACH * ahead, -TURN * pose.heading_error)
    backwards = ahead < 0.0
    toward = math.atan2(pose.y, pose.x) + (0.0 if backwards else math.pi)  # where that end goes
    against_goal = wrap_angle(toward - HALF_PI)
    against_heading = wrap_angle(against_goal - pose.heading_error)
    cosine = math.cos(against_heading)
    sinc = math.sin(against_heading) / against_heading if against_heading else 1.0
    pull = APPROACH * cosine * sinc * (against_heading + ALIGN * against_goal)
    speed = APPROACH * cosine * pose.distance
    return Twist(-speed if backwards else speed, TURN * against_heading + pull)


SLOWDOWN_M = 0.5  # slowdown_radius of Nav2 is 1.5 m, for 0.5 m/s and more
GAINS = Gains(2.0, 1.0)  # k_phi and k_delta of nav2_graceful_controller by default
BETA, LAMBDA = 0.4, 2.0  # likewise
OFF_AXLE = 0.2  # of the point that ``displaced`` drives, ahead [m]


def graceful(pose: Pose, settings: ServoSettings) -> Twist:
    """Return the velocity of Nav2's graceful controller at ``pose``."""
    at = polar_pose(pose.x, pose.y, pose.heading_error)
    if at.distance == 0.0:
        return Twist(0.0, 0.0)
    kappa = curvature(at, GAINS)
    slow = 1.0 + BETA * abs(kappa) ** LAMBDA
    speed = settings.max_linear * min(1.0 / slow, at.distance / SLOWDOWN_M)
    speed = min(speed, settings.max_angular / max(abs(kappa), 1e-9))
    return Twist(speed, kappa * speed)


def displaced(pose: Pose, settings: ServoSettings) -> Twist:
    """
    Return the velocity that drives a point OFF_AXLE ahead of the axle in any direction, at once.

    Its velocity is (v, OFF_AXLE w) in the robot's axes. The direction is the one that law smooth
    turns to; the heading follows it like a trailer, within a few OFF_AXLE of way.
    """
    sin, cos = math.sin(pose.heading_error), math.cos(pose.heading_error)
    at = polar_pose(pose.x - OFF_AXLE * sin, pose.y + OFF_AXLE * (cos - 1.0), pose.heading_error)
    speed = settings.max_linear * min(1.0, at.distance / SLOWDOWN_M)
    off = math.remainder(aim(at.phi, Gains()) - at.delta, math.tau)
    return Twist(speed * math.cos(off), speed * math.sin(off) / OFF_AXLE)


POSE_LAWS = {'polar': polar, 'graceful': graceful, 'displaced': displaced}
REGIONS = ('front', 'beside')
LAWS = ('full', 'smooth', *POSE_LAWS)
STARTS = 20
COLUMNS: Columns = {
    'region': itemgetter('region'),
    'law': itemgetter('law'),
    'reached %': lambda row: f'{100.0 * row["reached"]:.0f}',
    'lost %': lambda row: f'{100.0 * row["lost"]:.0f}',
    'wrong %': lambda row: f'{100.0 * row["wrong"]:.0f}',
    'position med / p95 mm': lambda row: numbers(
        (row['position_median_m'], row['position_p95_m']), 1, 1e3
    ),
    'heading deg': lambda row: number(row['heading_median_deg'], 2),
    'path / d_0': lambda row: number(row['path_ratio'], 2),
    'time s': lambda row: number(row['duration_s'], 0),
    'time / T_0 med / p95': lambda row: numbers((row['time_ratio'], row['time_ratio_p95']), 2),
    'fewest features': lambda row: f'{row["fewest_features"]:.0f}',
}

Run = dict[str, Any]


def run(*, seed: int, quick: bool, say: Callable[[str], None]) -> dict[str, Any]:
    """Drive every law from every start, and return all runs and a row of figures for each law."""
    count = 1 if quick else STARTS
    runs = []
    for region in REGIONS:
        for index in range(count):
            start = start_in(region, seed, index, Scenario())
            for law in LAWS:
                say(f'laws: {region} {index + 1} of {count}, {law} ...')
                runs.append(one_run(law, start, seed + index) | {'region': region})
    return {
        'starts': count,
        'seed': seed,
        'longest_s': LONGEST_S,
        'reached': {'position_m': WRONG_M, 'heading_deg': WRONG_DEG},
        'rows': [
            {'law': law, 'region': region}
            | scores([it for it in runs if (it['law'], it['region']) == (law, region)])
            for region in REGIONS
            for law in LAWS
        ],
        'runs': runs,
    }


def one_run(law: str, start: tuple[float, float, float], seed: int) -> Run:
    """Return the result of one run of ``law`` from ``start``: x [m], y [m], heading [deg]."""
    scenario = within(Scenario().seeded(seed), LONGEST_S)
    by_pose = POSE_LAWS.get(law)
    if by_pose is None:
        scenario = scenario.with_servo({'law': law})
    view = points_of(scenario, seed)
    loop = Loop(scenario.loop(start, seed), view, scenario.camera.camera)
    control = (
        None if by_pose is None else as_step(lambda: by_pose(loop.driven.pose, scenario.servo))
    )
    summary = summarise(loop.run(control=control))
    return summary | {'law': law, 'fate': _fate(summary)}


def _fate(summary: Mapping[str, Any]) -> str:
    """Return how a run ended by ground truth; what the robot reports is ``outcome``."""
    position, heading = summary['position_error_m'], abs(summary['heading_error_deg'])
    if position <= WRONG_M and heading <= WRONG_DEG:
        return 'reached'
    return 'lost' if 'features' in summary['reason'] and 'lost' in summary['reason'] else 'missed'


def scores(runs: list[Run]) -> dict[str, float]:
    """Return the figures of one row; what no run reached is nan."""
    reached = [it for it in runs if it['fate'] == 'reached']
    seeing = [it for it in runs if it['fate'] != 'lost']
    wrong = [it for it in runs if it['outcome'] == 'arrived' and it['fate'] != 'reached']

    def spread(of: list[Run], name: str, share: float) -> float:
        return quantile([abs(it[name]) for it in of], share)

    ratios = [it['path_length_m'] / math.hypot(*it['start'][:2]) for it in reached]
    return {
        'runs': len(runs),
        'reached': len(reached) / len(runs),
        'lost': sum(it['fate'] == 'lost' for it in runs) / len(runs),
        'wrong': len(wrong) / len(runs),
        'position_median_m': spread(seeing, 'position_error_m', 0.5),
        'position_p95_m': spread(seeing, 'position_error_m', 0.95),
        'heading_median_deg': spread(seeing, 'heading_error_deg', 0.5),
        'path_ratio': quantile(ratios, 0.5),
        'duration_s': spread(reached, 'duration_s', 0.5),
        'time_ratio': spread(reached, 'time_ratio', 0.5),
        'time_ratio_p95': spread(reached, 'time_ratio', 0.95),
        'fewest_features': spread(runs, 'min_visible_features', 0.0),
    }


def table(document: Mapping[str, Any]) -> str:
    """Return the document as text: one row a law and region."""
    reached = document['reached']
    return '\n'.join(
        [
            f'Laws: {document["starts"]} starts a region, point features at 0.2 px, at most '
            f'{document["longest_s"]:g} s; reached means within {reached["position_m"]:g} m and '
            f'{reached["heading_deg"]:g} deg',
            '(lost: the features; wrong: arrived by its report, but not reached; position and '
            'heading of all that did not lose the features, path and time of those that reached; '
            'T_0: the least time of docs/results.md; all but full and smooth are given the pose)',
            '',
            *aligned(' | '.join(COLUMNS), cells(COLUMNS, document['rows']), left=2),
        ]
    )
