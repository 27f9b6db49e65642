"""Peers behind the door of the servo: ``step(state, observation, settings) -> state``."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace

from visual_servo_epipolar.benchmarks.peer_laws.homography_based import never_resting, TurningGains
from visual_servo_epipolar.benchmarks.peer_laws.image_based import PointGains, points
from visual_servo_epipolar.benchmarks.peer_laws.pose_measurement import read
from visual_servo_epipolar.benchmarks.peer_laws.position_based import is_behind, polar, PolarGains
from visual_servo_epipolar.core.geometry.motion import saturate, STANDSTILL, Twist
from visual_servo_epipolar.core.geometry.rays import image_points
from visual_servo_epipolar.core.perception.perceive import Measurement, Observation, perceive
from visual_servo_epipolar.core.servo.phases.table import Phase
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.step import step
from visual_servo_epipolar.core.stamps import seconds_between
from visual_servo_epipolar.simulation.closed_loop import Step

MATCHED_PX, MATCHED_FRAMES = 0.7, 5  # median feature error at which a peer has arrived
STILL_M_S, STILL_RAD_S, STILL_FRAMES = 1e-3, 1e-3, 55  # at which it stands, for five seconds
NEAR_PX = 2.0  # feature error at which a peer that stands has arrived too


@dataclass(frozen=True, slots=True)
class PeerState(ServoState):
    """The servo's state, and whether a peer drives backwards, and for how long it stands."""

    backwards: bool = False
    still: int = 0


Law = Callable[[PeerState, Measurement, Observation], Twist]


def position_based(gains: PolarGains) -> Law:
    """Return the polar law; it decides at its first image which end goes first."""
    return lambda state, measurement, observation: polar(
        read(measurement, observation), gains, backwards=state.backwards
    )


def homography_based(gains: TurningGains) -> Law:
    """Return the law that never rests."""

    def law(state: PeerState, measurement: Measurement, observation: Observation) -> Twist:
        elapsed = seconds_between(state.run_start_ns, measurement.stamp_ns)
        return never_resting(read(measurement, observation), gains, elapsed=elapsed)

    return law


def image_based(gains: PointGains) -> Law:
    """Return the classical law on points."""
    return lambda state, measurement, observation: points(
        image_points(observation.current), image_points(observation.desired), gains
    )


def behind_the_door(law: Law) -> Step:
    """
    Return ``law`` as a step of the closed loop.

    It has our perception, our limits and our stop where nothing can be trusted. It has arrived
    when the features match to their noise, or nearly and it stands; it has failed when it stands
    where they do not.
    """

    def drive(state: ServoState, observation: Observation, settings: ServoSettings) -> ServoState:
        memory = None if state.measurement is None else state.measurement.memory
        measurement = perceive(observation, settings, state.frame, memory)
        peer = _seen(_as_peer(state), measurement, observation)
        return replace(
            _decided(peer, measurement, observation, law, settings), frame=state.frame + 1
        )

    return drive


def _as_peer(state: ServoState) -> PeerState:
    if isinstance(state, PeerState):
        return state
    return PeerState(**{item.name: getattr(state, item.name) for item in fields(state)})


def _seen(state: PeerState, measurement: Measurement, observation: Observation) -> PeerState:
    """Take in what was seen; the first trusted view says which end goes first."""
    state = replace(state, measurement=measurement)
    if state.phase is not Phase.WAITING or measurement.bearings is None:
        return state
    return replace(
        state,
        phase=Phase.MATCHING_FEATURES,
        run_start_ns=measurement.stamp_ns,
        backwards=is_behind(read(measurement, observation)),
    )


def _decided(
    state: PeerState,
    measurement: Measurement,
    observation: Observation,
    law: Law,
    settings: ServoSettings,
) -> PeerState:
    if state.phase in (Phase.WAITING, Phase.ARRIVED, Phase.FAILED):
        return replace(state, twist=STANDSTILL)
    if _is_lost(measurement, settings):
        return _held(state, measurement, settings)
    if state.phase is Phase.HOLDING:
        state = replace(state, phase=Phase.MATCHING_FEATURES, reason='')
    error = measurement.feature_error * measurement.focal
    twist = saturate(
        law(state, measurement, observation),
        max_linear=settings.max_linear,
        max_angular=settings.max_angular,
    )
    stands = abs(twist.linear) < STILL_M_S and abs(twist.angular) < STILL_RAD_S
    state = replace(
        state,
        twist=twist,
        settled=state.settled + 1 if error <= MATCHED_PX else 0,
        still=state.still + 1 if stands else 0,
    )
    rests = state.still >= STILL_FRAMES
    if state.settled >= MATCHED_FRAMES or (rests and error <= NEAR_PX):
        return replace(state, phase=Phase.ARRIVED, twist=STANDSTILL, reason='matched')
    if rests:
        return _failed(state, f'stands still with the features {error:.1f} px off')
    return state


def _is_lost(measurement: Measurement, settings: ServoSettings) -> bool:
    """Return whether there are too few features, or a baseline that cannot be trusted."""
    few = measurement.features < settings.min_features
    return few or (measurement.bearings is None and measurement.parallax > settings.near_parallax)


def _held(state: PeerState, measurement: Measurement, settings: ServoSettings) -> PeerState:
    if state.phase is not Phase.HOLDING:
        return replace(
            state, phase=Phase.HOLDING, phase_start_ns=measurement.stamp_ns, twist=STANDSTILL
        )
    waited = seconds_between(state.phase_start_ns, measurement.stamp_ns)
    if waited > settings.holding_timeout:
        return _failed(state, f'lost the features: {measurement.reason}')
    return state


def _failed(state: PeerState, reason: str) -> PeerState:
    return replace(state, phase=Phase.FAILED, twist=STANDSTILL, reason=reason)


PEERS: Mapping[str, Step] = {
    'ours': step,
    'position-based': behind_the_door(position_based(PolarGains())),
    'homography-based': behind_the_door(homography_based(TurningGains())),
    'image-based': behind_the_door(image_based(PointGains())),
}
