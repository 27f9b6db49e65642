"""
Law: the departures from the paper that it takes, the controls of its steps, its state machine.

A law is chosen by an expression: a name of ``registry.LAWS``, then departures to add or to leave
out, such as ``full-retreat`` or ``paper+true_sigma+speed_ramps``.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from visual_servo_epipolar.core.estimate.settings import (
    Departures,
    EpipoleControls,
    MatchingControl,
)
from visual_servo_epipolar.core.laws.machine import StateMachine
from visual_servo_epipolar.core.laws.two_steps import equations


@dataclass(frozen=True, slots=True, kw_only=True)
class Law(Departures):
    """
    Law of the servo: its departures from the paper, its controls and its phases.

    ``machine`` has phases other than the paper's two steps and what goes with them, None is that
    of the paper. ``on_arcs`` is the machine on a base that does not turn in place; None of a law
    that has to.
    """

    machine: StateMachine | None = None
    on_arcs: StateMachine | None = None

    def changed(self, departures: Mapping[str, bool]) -> 'Law':
        """Return this law with some departures taken (True) or left out (False)."""
        changes: dict[str, Any] = dict(departures)
        return replace(self, **changes)


def epipole_controls(law: Departures, *, finite_time: bool) -> EpipoleControls:
    """Return the function that gives (nu_1, nu_2): eq. (12), eq. (20), or the law's own."""
    if law.epipole_controls is not None:
        return law.epipole_controls
    return equations.finite_time_controls if finite_time else equations.auxiliary_controls


def matching_control(law: Departures) -> MatchingControl:
    """Return the function that gives the twist of step 2: eqs. (21)-(22), or the law's own."""
    return law.matching_control or equations.match_features
