"""
Law: the departures from the paper that it takes, the controls of its steps, its state machine.

A law is chosen by an expression: a name of ``registry.LAWS``, then departures to add or to leave
out, such as ``full-retreat`` or ``paper+true_sigma+speed_ramps``.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, TypeAlias

from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.laws.machine import StateMachine
from visual_servo_epipolar.core.laws.two_steps import equations

EpipoleControls: TypeAlias = Callable[..., tuple[float, float]]
MatchingControl: TypeAlias = Callable[..., Twist]


def departure(text: str) -> bool:
    """Declare a departure: a field, False in the paper, that ``text`` describes."""
    value: bool = field(default=False, metadata={'departure': text})
    return value


@dataclass(frozen=True, slots=True, kw_only=True)
class Law:
    """
    Law of the servo: its departures from the paper, each True or False, controls and phases.

    ``epipole_controls`` takes the place of eq. (12) or (20), with the signature of
    ``equations.auxiliary_controls``; ``matching_control`` that of eqs. (21)-(22), with that of
    ``equations.match_features``; ``machine`` has phases other than the paper's two steps and what
    goes with them. None stands for the paper's own. ``on_arcs`` is the machine on a base that does
    not turn in place; None of a law that has to.
    """

    true_sigma: bool = departure(
        'take sigma = sign cos(psi - theta) by cheirality, not as printed'
    )
    discordant_turn: bool = departure(
        'turn e_au to the side where the distance shrinks, and hold it there in step 1'
    )
    retreat: bool = departure("back off at the goal's heading where it lies beside or behind")
    contact_braking: bool = departure('slow down by the time to contact at the end of step 1')
    compensate_rotation: bool = departure('take D from features turned to the desired heading')
    line_following: bool = departure("steer along the goal's axis in step 2, not u_2 = 0")
    slope_gain: bool = departure('scale the gain of step 2 by the measured slope of D')
    speed_ramps: bool = departure('limit accelerations, and brake by them')
    curvature_feedforward: bool = departure('counter the turn that unequal wheels add')
    new_attempts: bool = departure('back off and repeat both steps after a miss (IX-2)')
    final_turn: bool = departure('end with a turn in place to the heading of the goal')
    memory: bool = departure('take bearings, offset and heading from all views of the way')
    learnt_dead_band: bool = departure('learn which commands are too slow for the base to follow')
    anticipation: bool = departure(
        'go by where the robot will be when it obeys, where that is late'
    )
    epipole_controls: EpipoleControls | None = None
    matching_control: MatchingControl | None = None
    machine: StateMachine | None = None
    on_arcs: StateMachine | None = None

    def changed(self, departures: Mapping[str, bool]) -> 'Law':
        """Return this law with some departures taken (True) or left out (False)."""
        changes: dict[str, Any] = dict(departures)
        return replace(self, **changes)


DEPARTURES: dict[str, str] = {
    item.name: item.metadata['departure'] for item in fields(Law) if 'departure' in item.metadata
}
DEFAULT_LAW = 'full'
TEXT = (
    'Control law: paper (sign as printed), corrected (true sigma), full (all departures), smooth '
    '(one motion), or one of another package'
)


def epipole_controls(law: Law, *, finite_time: bool) -> EpipoleControls:
    """Return the function that gives (nu_1, nu_2): eq. (12), eq. (20), or the law's own."""
    if law.epipole_controls is not None:
        return law.epipole_controls
    return equations.finite_time_controls if finite_time else equations.auxiliary_controls


def matching_control(law: Law) -> MatchingControl:
    """Return the function that gives the twist of step 2: eqs. (21)-(22), or the law's own."""
    return law.matching_control or equations.match_features
