"""
Gains that need no luck: section IV-C turned into code, from what is known before the robot moves.

The law works in continuous time for any gains (``theory.least_sine``); what limits them is that it
is sampled, late and bounded. Saturation by one common factor costs time and leaves the path, so
that limits of speed enter only where a command is held for one period. docs/theory.md has the
reasons, test/core/control/test_gains.py the runs.
"""

from dataclasses import dataclass
import math

from visual_servo_epipolar.core.settings import setting, Settings

UNHURRIED = 1.0 / math.e  # gain times delay of an integrator that does not overshoot
SAMPLES_LEFT = 2.0  # turns of one period that e_au keeps from zero
DECAY = 1.0  # k1 t_max of discordant epipoles: e_au keeps 1/e of where it began


@dataclass(frozen=True, kw_only=True)
class Circumstances(Settings):
    """What is known when step 1 begins; bearings are magnitudes, of abscissae at f = 1."""

    concordant: bool = setting(False, 'Whether the epipoles have the same sign')
    current: float = setting(0.35, 'Bearing |atan e_au| at least [rad]', low=0.001, high=1.57)
    desired: float = setting(0.6, 'Bearing |atan e_du| at most [rad]', low=0.001, high=1.56)
    farthest: float = setting(8.0, 'Upper bound d_hat_0 of the distance [m]', low=0.1, high=100.0)
    nearest: float = setting(1.0, 'Lower bound of the distance d_0 [m]', low=0.05, high=100.0)
    max_linear: float = setting(0.4, 'Largest linear speed [m/s]', low=0.01, high=5.0)
    max_angular: float = setting(0.5, 'Largest angular speed [rad/s]', low=0.01, high=10.0)
    deceleration: float = setting(0.5, 'Deceleration of the base [m/s^2]', low=0.01, high=20.0)
    rate: float = setting(11.0, 'Images a second [Hz]', low=0.5, high=1000.0)
    latency: float = setting(0.0, 'From image to motion [s]', low=0.0, high=2.0)
    landing: float = setting(0.002, 'Bearing of e_du that is zero [rad]', low=1e-6, high=0.2)
    depth: float = setting(3.0, 'Depth of the nearest features [m]', low=0.1, high=99)
    spread: float = setting(0.38, 'Mean of |p_d|^2 at unit focal length', low=1e-3, high=10.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.nearest > self.farthest:
            raise ValueError(
                f'nearest must not exceed farthest, got {self.nearest:g} and {self.farthest:g} m'
            )
        if self.landing >= self.desired:
            raise ValueError(
                f'landing must be below desired, got {self.landing:g} and {self.desired:g} rad; '
                'e_du counts as zero already'
            )
        if not self.concordant and self.current + self.desired > 0.5 * math.pi:
            raise ValueError(
                f'discordant bearings must not add up to more than {0.5 * math.pi:.4g} rad, got '
                f'{self.current:g} and {self.desired:g}: e_au may pass through infinity; '
                'turn towards the heading of the goal first'
            )

    @property
    def period(self) -> float:
        """Time for which what was seen determines what is done [s]."""
        return 1.0 / self.rate + self.latency

    @property
    def ratio(self) -> float:
        """Largest d_hat_0 / d_0."""
        return self.farthest / self.nearest


@dataclass(frozen=True, slots=True)
class Gains:
    """
    Gains of (12), (21) at unit focal length, beta / gamma, and what can be promised of them.

    ``k1_alone`` [1/s] may replace ``k1`` once e_du is zero, or where e_au is held; ``transient``
    is the longest time to zero e_du [s] at speeds without limit; ``floor`` the bearing of e_au
    [rad] that is kept until then. ``rate`` [1/s] is that of step 2, which k_t has at the goal.
    """

    k1: float
    k2: float
    beta: int
    gamma: int
    k_t: float
    k1_alone: float
    transient: float
    floor: float
    rate: float

    @property
    def exponent(self) -> float:
        """The exponent beta / gamma of (12)."""
        return self.beta / self.gamma


def derive(known: Circumstances) -> Gains:
    """
    Return the gains for ``known`` (section IV-C).

    Raises
    ------
    ValueError
        If concordant epipoles begin too close to the singularity for any gain.

    """
    beta, gamma = quickest_exponent(known)
    exponent = beta / gamma
    k2 = landing_gain(known, exponent=exponent)
    transient = longest_transient(math.tan(known.desired), k2=k2, exponent=exponent)
    alone = UNHURRIED / known.period
    decay = largest_decay(known)
    floor = least_bearing(known)
    if not known.concordant:
        floor = math.atan(math.tan(known.current) * math.exp(-decay))
    return Gains(
        k1=min(decay / transient, alone),
        k2=k2,
        beta=beta,
        gamma=gamma,
        k_t=matching_gain(known),
        k1_alone=alone,
        transient=transient,
        floor=floor,
        rate=closing_rate(known),
    )


def longest_transient(
    e_desired: float, *, k2: float, exponent: float, shrink: float = 1.0
) -> float:
    """
    Return t_max [s], by which e_du is zero (section IV-C 1): that of d_hat = d, the slowest.

    ``shrink`` is f_hat / f, 1 for a calibrated camera. With a guess d_hat / d may fall to
    f_hat / f while the robot backs away, and (27) to the third power of it.
    """
    rest = 1.0 - exponent
    return float(abs(e_desired) ** rest / (k2 * rest * shrink**3))


def quickest_exponent(known: Circumstances) -> tuple[int, int]:
    """
    Return beta, gamma that zero e_du soonest, as sampling allows (section IV-C 1, revised).

    With k2 of ``landing_gain``, t_max is (e_0 / e_landing)^(1 - b) / (1 - b) periods: least where
    1 - b = 1 / ln(e_0 / e_landing). The paper has b near 0 to bound the increment of d, which
    does not depend on b (``theory.largest_growth``).
    """
    span = math.log(math.tan(known.desired) / math.tan(known.landing))
    gamma = max(3, 2 * round((2.0 * span - 1.0) / 2.0) + 1)  # odd, and 1 - b = 2 / gamma
    return gamma - 2, gamma


def largest_ratio(known: Circumstances) -> float:
    """
    Return a bound of d_hat / d in step 1 (from eqs. 17 and 19).

    It falls while concordant epipoles move apart from the goal. For discordant ones it is
    |sin alpha| over the reserve, where alpha grows to |alpha_0| + |chi_0| at most.
    """
    if known.concordant:
        return known.ratio
    gained = math.sin(known.current + known.desired) / math.sin(known.current)
    return known.ratio * math.exp(DECAY) * gained


def landing_gain(known: Circumstances, *, exponent: float) -> float:
    """Return k2: in one period (15) takes e_du to zero from the landing at most, never past it."""
    landing = math.tan(known.landing)
    return float(landing ** (1.0 - exponent) / (largest_ratio(known) * known.period))


def least_bearing(known: Circumstances) -> float:
    """
    Return what |atan e_au| [rad] must keep, lest a command held for one period carry it past zero.

    It turns by u_2 and by u_1 sin(alpha) / d: twice what the limits allow.
    """
    way = known.max_linear * known.period / known.nearest
    turn = SAMPLES_LEFT * known.max_angular * known.period
    if way >= 0.5 or turn / (1.0 - way) >= 0.5 * math.pi:
        raise ValueError(
            f'one period must be short for the limits, got {known.period:g} s at '
            f'{known.max_linear:g} m/s and {known.max_angular:g} rad/s from {known.nearest:g} m; '
            'lower max_linear or max_angular, or raise rate or nearest'
        )
    return turn / (1.0 - way)


def largest_decay(known: Circumstances) -> float:
    """
    Return the bound of k1 t_max in step 1: the inequality of section IV-C 2 for concordant signs.

    e_au stays beyond the floor alpha_m while e_du is zeroed if k1 t_max is at most

        ln(sin|alpha_0| / (r_0 sin alpha_m))    from the reserve, r_0 = d_hat_0 / d_0, or
        ln(|alpha_0| / (alpha_m + (1 - 1/r_0) |chi_0|))    from (14) and (15) for any r_0;

    so k1 must be small *against* k2, and k2 large, not small. Discordant epipoles are pushed
    outwards and need no bound; DECAY keeps the robot from coming too near the goal.

    Raises
    ------
    ValueError
        If both are negative: no gain is legal.

    """
    if not known.concordant:
        return DECAY
    floor = least_bearing(known)
    by_reserve = known.ratio * math.sin(floor)
    by_lead = floor + (1.0 - 1.0 / known.ratio) * known.desired
    decay = max(math.log(math.sin(known.current) / by_reserve), math.log(known.current / by_lead))
    if decay <= 0.0:
        least = min(by_lead, math.asin(by_reserve) if by_reserve < 1.0 else math.inf)
        raise ValueError(
            f'concordant epipoles need |atan e_au| above {least:.3g} rad with d_hat_0 / d_0 up to '
            f'{known.ratio:.3g}, got {known.current:.3g}; turn first, best to the other sign'
        )
    return decay


def closing_rate(known: Circumstances) -> float:
    """
    Return the rate of step 2 [1/s]: no overshoot by delay, no more braking than the base can do.

    At max_linear it asks for the deceleration rate * max_linear.
    """
    return min(UNHURRIED / known.period, known.deceleration / known.max_linear)


def matching_gain(known: Circumstances) -> float:
    """
    Return k_t of (21) for D in rays, from the depth of the scene.

    Near the goal (23) is D = -2 mean|p_d|^2 / Z d~ at most, so that k_t 2 mean|p_d|^2 / Z is the
    rate.
    """
    return closing_rate(known) * known.depth / (2.0 * known.spread)
