"""
Run: one drive to a goal, in a node, a replay and a simulation alike.

It admits an image, or refuses it, by its stamps, goal and camera, and goes on by it: ``decide``
returns the run with the command, and ``update_map`` learns what no command waits for.
Interruptions between two images stop it, or hold it until tracks come back.
"""

from dataclasses import dataclass, replace
from enum import Enum
import math

from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.cameras.plausibility import differences
from visual_servo_epipolar.core.geometry.motion import STANDSTILL
from visual_servo_epipolar.core.goal import NO_GOAL
from visual_servo_epipolar.core.laws.machine import interruption
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.reasons import Reason
from visual_servo_epipolar.core.rigs.rig import HALT
from visual_servo_epipolar.core.servo import supervisor
from visual_servo_epipolar.core.servo.admission import Arrival, FrozenImageCheck
from visual_servo_epipolar.core.servo.estimator import update_map
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState, ViewState
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.core.twoview.observation import Observation


class Interruption(Enum):
    """
    Interruption of a run between two steps.

    STOPPED: ordered to stop. RESET: a new run. HALTED: a standstill that keeps the state. LOST: no
    tracks came in time, or of another camera. TIMED_OUT: none came while it held.
    """

    STOPPED = 'stopped'
    RESET = 'reset'
    HALTED = 'halted'
    LOST = 'lost'
    TIMED_OUT = 'timed out'


def interrupted(state: ServoState, kind: Interruption, reason: str = '') -> ServoState:
    """Return the state after an interruption, with the command to stand; ``reason`` if any."""
    if kind is Interruption.STOPPED:  # waiting, by the same base
        sent = replace(state.motion.sent, withdrawn=True)
        frame, delay = state.view.frame, state.identified.delay
        return ServoState().changed(frame=frame, delay=delay, sent=sent)
    if kind is Interruption.RESET:
        return ServoState()
    if kind is Interruption.LOST:
        return _lost(state, reason)
    if kind is Interruption.TIMED_OUT:
        phase = interruption(state.phase, Event.TIMED_OUT)
        if phase is not None:
            return _halted(state).changed(phase=phase, settled=0, reason=reason)
    return _halted(state)


def _halted(state: ServoState) -> ServoState:
    """Return ``state`` at a standstill; what was commanded until now has moved the robot."""
    if state.command == HALT:
        return state
    sent = replace(state.motion.sent, withdrawn=True)
    return state.changed(
        command=HALT,
        last_linear=state.twist.linear,
        sent=sent,
        dead_band_residual=STANDSTILL,
        stood=None,  # how far the last command led is not known
    )


def _lost(state: ServoState, reason: str) -> ServoState:
    """Return the state after tracks stopped coming: holding where it drove, at a standstill."""
    phase = interruption(state.phase, Event.LOST)
    if phase is None:
        reason = reason if state.phase is Phase.HOLDING else state.reason
        return _halted(state).changed(settled=0, reason=reason)
    # It holds since the last tracks: a phase that had lasted long would count as waiting.
    start_ns = (
        state.run.phase_start_ns if state.measurement is None else state.measurement.stamp_ns
    )
    return _halted(state).changed(phase=phase, phase_start_ns=start_ns, settled=0, reason=reason)


@dataclass(frozen=True, slots=True)
class Run:
    """
    Run of a servo: its ``state`` after the last step, and what it began with.

    ``camera`` is that of the images, None before the first; ``stamp_ns`` the stamp of the last
    image that counted; ``started`` says whether a run goes on or may begin; ``views``, whether
    images show that time passes.
    """

    state: ServoState = ServoState()
    camera: CameraModel | None = None
    stamp_ns: int | None = None
    started: bool = False
    views: FrozenImageCheck = FrozenImageCheck()

    def admit(
        self, arrival: Arrival, *, max_latency: float, still_timeout: float, withheld: str = ''
    ) -> tuple['Run', str]:
        """Return the run after an image came, and why no step is taken by it, or ''."""
        views, trouble = self.views.admit(
            arrival,
            self.stamp_ns if self.state.phase.runs else None,
            drives=self.state.command != HALT,
            max_latency=max_latency,
            still_timeout=still_timeout,
            withheld=withheld if self.started else '',
        )
        return replace(self, views=views), trouble

    def with_camera(self, camera: CameraModel) -> 'Run':
        """Return the run where ``camera`` is that of the images: a run keeps its own."""
        if self.camera == camera or (self.state.phase.runs and self.camera is not None):
            return self
        return replace(self, camera=camera)

    def other_camera(self, camera: CameraModel) -> str:
        """Return in words that ``camera`` is not that of the run; or ''."""
        if self.camera is None or camera == self.camera:
            return ''
        return Reason.OTHER_CAMERA.of(differences(self.camera, camera))

    def other_goal(self, goal: int | None) -> str:
        """Return in words that features of ``goal`` are not of the goal of the run; or ''."""
        changes = self.state.phase.runs and self.state.goal.differs(goal or NO_GOAL)
        return Reason.OTHER_GOAL.of() if changes else ''

    def admitted(
        self, features: Features, goal: int | None, camera: CameraModel
    ) -> tuple[Features, str]:
        """Return ``features`` of the goal and the camera of the run; none, and why, of others."""
        trouble = self.other_goal(goal) or self.other_camera(camera)
        return (Features(), trouble) if trouble else (features, '')

    def decide(
        self,
        observation: Observation,
        settings: ServoSettings,
        *,
        goal: int = NO_GOAL,
        since_command: float = math.nan,
        trouble: str = '',
    ) -> 'Run':
        """
        Return the run with the command; ``trouble``: why features were not admitted.

        None are where a head carries the camera and its angles are missing.
        """
        if settings.carrier.turn_rate > 0.0 and observation.joints is None and len(observation):
            observation, trouble = observation.without_features(), trouble or Reason.NO_JOINTS.of()
        state = change_goal(self.state, goal)
        state = supervisor.decide(state, observation, settings, since_command=since_command)
        if trouble and state.phase is Phase.HOLDING:
            state = state.changed(reason=trouble)
        return replace(self, state=state)

    def update_map(self) -> 'Run':
        """Return the run after what no command waits for."""
        return replace(self, state=update_map(self.state))

    def interrupted(self, kind: Interruption, reason: str = '') -> 'Run':
        """Return the run after an interruption between two steps; one that stops ends it."""
        started = self.started and kind is not Interruption.STOPPED
        return replace(self, state=interrupted(self.state, kind, reason), started=started)


def change_goal(state: ServoState, goal: int) -> ServoState:
    """Return the state that drives to ``goal``, without map if it is new; a run keeps its own."""
    view, before = state.view, state.goal
    if goal in (NO_GOAL, before.id) or (state.phase.runs and before.differs(goal)):
        return state
    after = before.followed_by(goal)
    if before.differs(goal):
        view = ViewState(period=view.period, frame=view.frame)
        return state.changed(view=view, goal=after, known=None)
    return state.changed(goal=after)
