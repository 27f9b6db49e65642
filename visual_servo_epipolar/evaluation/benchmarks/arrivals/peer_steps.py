"""Adapter: peer laws as ``step(state, observation, settings) -> state`` of the closed loop."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields

from visual_servo_epipolar.core.geometry.motion import saturate, Twist
from visual_servo_epipolar.core.geometry.rays import image_points
from visual_servo_epipolar.core.laws.command import Command, HALT
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.perception.observation import Observation
from visual_servo_epipolar.core.perception.perceive import perceive
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.step import step
from visual_servo_epipolar.core.stamps import seconds_between
from visual_servo_epipolar.evaluation.benchmarks.arrivals.peer_laws import (
    never_resting,
    points,
    polar,
    relative_pose,
)
from visual_servo_epipolar.simulation.closed_loop import Control

MATCHED_PX, MATCHED_FRAMES = 0.7, 5  # median feature error at which a peer has arrived
STILL_M_S, STILL_RAD_S, STILL_FRAMES = 1e-3, 1e-3, 55  # at which it stands, for five seconds
NEAR_PX = 2.0  # feature error at which a peer that stands has arrived too


@dataclass(frozen=True)
class PeerState(ServoState):
    """The servo's state, and whether a peer drives backwards, and for how long it stands."""

    backwards: bool = False
    still: int = 0


Law = Callable[[PeerState, Measurement, Observation], Twist]


def position_based(state: PeerState, measurement: Measurement, observation: Observation) -> Twist:
    """Return the twist of the polar law; it decides at its first image which end goes first."""
    return polar(relative_pose(measurement, observation), backwards=state.backwards)


def homography_based(
    state: PeerState, measurement: Measurement, observation: Observation
) -> Twist:
    """Return the twist of the law that never rests."""
    elapsed = seconds_between(state.run.run_start_ns, measurement.stamp_ns)
    return never_resting(relative_pose(measurement, observation), elapsed)


def image_based(state: PeerState, measurement: Measurement, observation: Observation) -> Twist:
    """Return the twist of the classical law on points."""
    return points(image_points(observation.current), image_points(observation.desired))


def as_step(law: Law) -> Control:
    """
    Return ``law`` as a step of the closed loop.

    It has our perception, our limits and our stop where nothing can be trusted. It has arrived
    when the features match to their noise, or nearly and it stands; it has failed when it stands
    where they do not.
    """

    def drive(state: ServoState, observation: Observation, settings: ServoSettings) -> ServoState:
        perception = perceive(observation, settings, state.view.frame, state.view.memory)
        measurement = perception.measurement
        peer = _take_in(_as_peer(state), measurement, observation)
        peer = peer.changed(memory=perception.memory)
        decided = _decide(peer, measurement, observation, law, settings)
        return decided.changed(frame=state.view.frame + 1)

    return drive


def _as_peer(state: ServoState) -> PeerState:
    if isinstance(state, PeerState):
        return state
    return PeerState(**{item.name: getattr(state, item.name) for item in fields(state)})


def _take_in(state: PeerState, measurement: Measurement, observation: Observation) -> PeerState:
    """Take in a measurement; the first trusted one decides which end goes first."""
    state = state.changed(measurement=measurement)
    if state.phase is not Phase.WAITING or measurement.bearings is None:
        return state
    return state.changed(
        phase=Phase.MATCHING_FEATURES,
        run_start_ns=measurement.stamp_ns,
        backwards=relative_pose(measurement, observation).ahead < 0.0,
    )


def _decide(
    state: PeerState,
    measurement: Measurement,
    observation: Observation,
    law: Law,
    settings: ServoSettings,
) -> PeerState:
    if state.phase in (Phase.WAITING, Phase.ARRIVED, Phase.FAILED):
        return state.changed(command=HALT)
    if _is_lost(measurement, settings):
        return _held(state, measurement, settings)
    if state.phase is Phase.HOLDING:
        state = state.changed(phase=Phase.MATCHING_FEATURES, reason='')
    error = measurement.feature_error * measurement.focal
    twist = saturate(
        law(state, measurement, observation),
        max_linear=settings.max_linear,
        max_angular=settings.max_angular,
    )
    stands = abs(twist.linear) < STILL_M_S and abs(twist.angular) < STILL_RAD_S
    state = state.changed(
        command=Command(twist),
        settled=state.settling.settled + 1 if error <= MATCHED_PX else 0,
        still=state.still + 1 if stands else 0,
    )
    rests = state.still >= STILL_FRAMES
    if state.settling.settled >= MATCHED_FRAMES or (rests and error <= NEAR_PX):
        return state.changed(phase=Phase.ARRIVED, command=HALT, reason='matched')
    if rests:
        return _fail(state, f'stands still with the features {error:.1f} px off')
    return state


def _is_lost(measurement: Measurement, settings: ServoSettings) -> bool:
    """Return whether there are too few features, or a baseline that cannot be trusted."""
    few = measurement.features < settings.min_features
    return few or (measurement.bearings is None and measurement.parallax > settings.near_parallax)


def _held(state: PeerState, measurement: Measurement, settings: ServoSettings) -> PeerState:
    if state.phase is not Phase.HOLDING:
        return state.changed(
            phase=Phase.HOLDING, phase_start_ns=measurement.stamp_ns, command=HALT
        )
    waited = seconds_between(state.run.phase_start_ns, measurement.stamp_ns)
    if waited > settings.holding_timeout:
        return _fail(state, f'lost the features: {measurement.reason}')
    return state


def _fail(state: PeerState, reason: str) -> PeerState:
    return state.changed(phase=Phase.FAILED, command=HALT, reason=reason)


PEERS: Mapping[str, Control] = {
    'ours': step,
    'position-based': as_step(position_based),
    'homography-based': as_step(homography_based),
    'image-based': as_step(image_based),
}
