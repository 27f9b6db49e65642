"""
Law table: a law is the departures from the paper that it takes, and the controls of its steps.

``LAWS`` is the only place that knows the names. A law is chosen by an expression: a name, then
departures to add or to leave out, such as ``full-retreat`` or ``paper+true_sigma+speed_ramps``.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
import re
from typing import Any, TypeAlias

from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.laws import equations
from visual_servo_epipolar.core.registry import Registry

EpipoleControls: TypeAlias = Callable[..., tuple[float, float]]
MatchingControl: TypeAlias = Callable[..., Twist]


def departure(text: str) -> bool:
    """Declare a departure: a field, False in the paper, that ``text`` describes."""
    value: bool = field(default=False, metadata={'departure': text})
    return value


@dataclass(frozen=True, slots=True, kw_only=True)
class LawOptions:
    """
    Law of the servo: its departures from the paper, each True or False, and its controls.

    ``epipole_controls`` takes the place of eq. (12) or (20), with the signature of
    ``equations.auxiliary_controls``; ``matching_control`` that of eqs. (21)-(22), with that of
    ``equations.match_features``. None stands for the paper's own.
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
    slope_gain: bool = departure('close in at a rate in step 2, by the slope that D shows')
    speed_ramps: bool = departure('limit accelerations')
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

    def changed(self, departures: Mapping[str, bool]) -> 'LawOptions':
        """Return this law with some departures taken (True) or left out (False)."""
        changes: dict[str, Any] = dict(departures)
        return replace(self, **changes)


DEPARTURES: dict[str, str] = {
    item.name: item.metadata['departure']
    for item in fields(LawOptions)
    if 'departure' in item.metadata
}
PAPER = LawOptions(new_attempts=True)
CORRECTED = PAPER.changed({'true_sigma': True})
FULL = PAPER.changed(dict.fromkeys(DEPARTURES, True))

LAWS: Registry[LawOptions] = Registry(
    'visual_servo_epipolar.laws',
    {'paper': PAPER, 'corrected': CORRECTED, 'full': FULL},
    LawOptions,
)
DEFAULT_LAW = 'full'
TEXT = (
    'Control law: paper (sign as printed), corrected (true sigma), full (all departures), or one '
    'of another package; departures may be added and left out, as in full-retreat'
)


@lru_cache(maxsize=256)
def law_options(expression: str) -> LawOptions:
    """
    Return the law that ``expression`` names: ``name``, then ``+departure`` or ``-departure``.

    Raises
    ------
    ValueError
        If there is no such law or departure; says which there are.

    """
    name = _name_in(expression)
    _, *changes = re.split(r'(?=[+-])', expression[len(name) :])
    unknown = [change[1:] for change in changes if change[1:] not in DEPARTURES]
    if unknown:
        raise ValueError(
            f'law {expression!r} names no departure {", ".join(unknown)}; there are '
            f'{", ".join(DEPARTURES)}'
        )
    return LAWS[name].changed({change[1:]: change[0] == '+' for change in changes})


def _name_in(expression: str) -> str:
    """Return the longest name of a law that ``expression`` begins with; names may hold + and -."""
    names = [name for name in LAWS if re.match(rf'{re.escape(name)}(?![^+-])', expression)]
    if not names:
        raise ValueError(
            f'law must be one of {", ".join(LAWS)}, got {expression!r}; departures are added and '
            'left out as in full-retreat'
        )
    return max(names, key=len)


def epipole_controls(law: LawOptions, *, finite_time: bool) -> EpipoleControls:
    """Return the function that gives (nu_1, nu_2): eq. (12), eq. (20), or the law's own."""
    if law.epipole_controls is not None:
        return law.epipole_controls
    return equations.finite_time_controls if finite_time else equations.auxiliary_controls


def matching_control(law: LawOptions) -> MatchingControl:
    """Return the function that gives the twist of step 2: eqs. (21)-(22), or the law's own."""
    return law.matching_control or equations.match_features
