"""Draws the figures of docs/theory.md, from the laws themselves: python docs/theory_figures.py."""

from collections.abc import Callable
from dataclasses import dataclass, replace
import math
from pathlib import Path
import sys

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, NullFormatter
import numpy as np
import theory_bounds as theory

from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, integrate, Pose, saturate
from visual_servo_epipolar.core.laws import equations
from visual_servo_epipolar.report.style import FIGURE_SETTINGS, INK, robot_body, robot_nose

BLUE, RED, GREEN, ORANGE, GREY = '#0072B2', '#D55E00', '#009E73', '#E69F00', '#8C8C8C'
DEGREES = 180.0 / math.pi


@dataclass(frozen=True)
class Way:
    """One integrated first step: poses, d_hat [m], times [s]."""

    poses: list[Pose]
    estimates: list[float]
    times: np.ndarray

    def values(self, take: Callable[[Pose], float]) -> np.ndarray:
        """Return what ``take`` finds at each pose, shape (N,)."""
        return np.array([take(pose) for pose in self.poses])


@dataclass(frozen=True, kw_only=True)
class Law:
    """The first step: gains; the sign as printed or true; e_au held, or let go; limits."""

    k1: float = 0.05
    k2: float = 0.5
    exponent: float = 5.0 / 9.0
    printed: bool = False
    held: float = 0.0
    max_linear: float = math.inf


def bearing(value: float) -> float:
    """Return the bearing [deg] of an abscissa at f = 1."""
    return math.degrees(math.atan(value))


def e_current(pose: Pose) -> float:
    """Return e_au at f = 1."""
    return Bearings.from_pose(pose).epipole_current


def e_desired(pose: Pose) -> float:
    """Return e_du at f = 1."""
    return Bearings.from_pose(pose).epipole_desired


def distance(pose: Pose) -> float:
    """Return d [m]."""
    return pose.distance


def first_step(
    pose: Pose, law: Law, *, ratio: float = 1.0, dt: float = 2e-3, steps: int = 30_000
) -> Way:
    """Drive until e_du is zero, with the twist of ``law`` held for ``dt`` [s]."""
    poses, estimates = [pose], [ratio * pose.distance]
    while len(poses) < steps and 1e-3 < abs(e_desired(pose)) < 50.0 and pose.distance < 1e3:
        bearings = Bearings.from_pose(pose)
        a, e = bearings.epipole_current, bearings.epipole_desired
        gains = {'k1': law.k1, 'k2': law.k2, 'exponent': law.exponent}
        nu = equations.auxiliary_controls(a, e, e_target=law.held, **gains)
        sigma = equations.printed_sigma(a, e) if law.printed else bearings.sigma
        twist = equations.linearizing_control(a, e, sigma=sigma, distance=estimates[-1], nu=nu)
        twist = saturate(twist, max_linear=law.max_linear, max_angular=math.inf)
        rate = equations.distance_rate(twist.linear, a, sigma=bearings.sigma)
        estimates.append(max(estimates[-1] + dt * rate, 0.1))
        pose = integrate(pose, twist, dt)
        poses.append(pose)
    return Way(poses, estimates, dt * np.arange(len(poses)))


def start(alpha: float, chi: float, *, far: float = 1.0) -> Pose:
    """Return the pose behind the goal with these bearings of the epipoles [rad]."""
    psi = -0.5 * math.pi - chi
    return Pose(far * math.cos(psi), far * math.sin(psi), psi + alpha + math.pi)


def page(title: str, height: float = 3.5) -> tuple[Figure, np.ndarray]:
    """Return a figure of two panels, as wide as a page."""
    figure = Figure(figsize=(7.2, height), layout='constrained')
    FigureCanvasAgg(figure)
    figure.suptitle(title, fontsize=10.0, x=0.02, ha='left')
    return figure, figure.subplots(1, 2)


def name(axes: Axes, x: str, y: str, title: str) -> None:
    """Name axes, with their units."""
    axes.set(xlabel=x, ylabel=y)
    axes.set_title(title, fontsize=9.0)


def plain_ticks(axes: Axes) -> None:
    """Write 0.2, not 2 x 10^-1, at the ticks that were set, and nothing between them."""
    for side in (axes.xaxis, axes.yaxis):
        side.set_major_formatter(FormatStrFormatter('%g'))
        side.set_minor_formatter(NullFormatter())


def draw_robot(axes: Axes, pose: Pose, colour: str) -> None:
    """Draw the robot at ``pose``."""
    axes.fill(*robot_body(pose).T, facecolor='none', edgecolor=colour, lw=1.0)
    axes.fill(*robot_nose(pose).T, facecolor=colour, edgecolor=colour, lw=1.0)


def signs() -> Figure:
    """Draw where the printed sign is right, and where it leads."""
    figure, (plane, ways) = page('Sign: sign($e_{au}e_{du}$) as printed, against sigma', 4.0)
    axis = np.linspace(-4.0, 4.0, 161) + 1e-6
    heading = 5.0

    def agrees(x: float, y: float) -> bool:
        bearings = Bearings.from_pose(Pose.from_start(x, y, heading))
        printed = equations.printed_sigma(bearings.epipole_current, bearings.epipole_desired)
        return printed == bearings.sigma

    right = np.array([[agrees(x, y) for x in axis] for y in axis])
    plane.contourf(axis, axis, right, levels=[-0.5, 0.5, 1.5], colors=['#F3C6AE', '#CFE8DF'])
    draw_robot(plane, DESIRED_POSE, INK)
    plane.text(0.0, -3.4, 'goal ahead of the robot', ha='center', fontsize=8.0)
    name(plane, 'x [m]', 'y [m]', f'heading error {heading:g} deg: green right, red wrong')
    plane.set_aspect('equal')
    pose = Pose.from_start(0.8, -3.0, -5.0)
    target = equations.displaced_epipole(e_desired(pose), ratio=0.4, low=0.14, high=0.35)
    bearings = Bearings.from_pose(pose)
    turned = replace(
        pose, theta=pose.theta + math.atan(target) - math.atan(bearings.epipole_current)
    )
    for begin, law, colour, text in (
        (pose, Law(printed=True), RED, 'as printed'),
        (pose, Law(), ORANGE, 'true sigma'),
        (turned, Law(k1=0.8, held=target), BLUE, 'true sigma, discordant turn'),
    ):
        way = first_step(begin, law)
        x, y = way.values(lambda p: p.x), way.values(lambda p: p.y)
        ways.plot(x, y, color=colour, label=text)
        ways.plot(x[-1], y[-1], 'o', color=colour, ms=4.0)
    draw_robot(ways, pose, INK)
    draw_robot(ways, DESIRED_POSE, GREY)
    ways.set(xlim=(-2.0, 2.6), ylim=(-9.0, 1.0))
    ways.legend(loc='lower right')
    name(ways, 'x [m]', 'y [m]', 'step 1 from one start')
    return figure


def singularity() -> Figure:
    """Draw step 1 in the plane of the bearings, and the bound that keeps e_au from zero."""
    figure, (plane, time) = page('Step 1 never reaches its singularity, whatever the gains', 4.0)
    for ratio, colour in ((1.0, BLUE), (4.0, RED)):
        for side in (-1.0, 1.0):
            for alpha in (15.0, 35.0, 55.0):
                begin = start(alpha / DEGREES, 30.0 * side / DEGREES)
                way = first_step(begin, Law(k1=0.1, k2=0.5), ratio=ratio)
                label = f'd_hat_0 / d_0 = {ratio:g}' if (side, alpha) == (1.0, 15.0) else None
                plane.plot(
                    np.unwrap(way.values(lambda p: bearing(e_current(p))), period=180.0),
                    way.values(lambda p: bearing(e_desired(p))),
                    color=colour,
                    label=label,
                )
    plane.axvline(0.0, color=INK, lw=2.0)
    plane.plot([0.0, 90.0], [-90.0, 0.0], color=GREY, ls='--')
    plane.text(68.0, -32.0, '90 deg of\nheading error', fontsize=7.5, color=GREY)
    plane.set(xlim=(-3.0, 92.0), ylim=(-48.0, 33.0))
    plane.legend(loc='lower left', bbox_to_anchor=(0.04, 0.0))
    name(
        plane,
        'bearing of e_au [deg]',
        'bearing of e_du [deg]',
        'concordant above, discordant below',
    )
    begin, k1, ratio = start(0.5, 0.5), 0.3, 2.0
    for k2, colour in ((3.0, GREEN), (0.5, BLUE), (0.12, RED)):
        way = first_step(begin, Law(k1=k1, k2=k2), ratio=ratio)
        sine = np.abs(np.sin(np.arctan(way.values(e_current))))
        time.semilogy(way.times, sine, color=colour, label=f'k2 = {k2:g} 1/s')
        time.plot(way.times[-1], sine[-1], 'o', color=colour, ms=4.0)
    times = np.linspace(0.0, 14.0, 50)
    least = [theory.least_sine(math.tan(0.5), t, k1=k1, ratio=ratio) for t in times]
    time.semilogy(times, least, color=INK, ls='--', label='bound, any k2')
    time.set(xlim=(0.0, 14.0), ylim=(3e-3, 1.0))
    time.legend()
    name(
        time, 'time [s]', '|sin alpha|, alpha the bearing of e_au', f'concordant, k1 = {k1:g} 1/s'
    )
    return figure


def excursion() -> Figure:
    """Draw how far the robot backs away: by beta/gamma and by k2."""
    figure, (exponent_axes, gain_axes) = page('How far step 1 backs away (concordant epipoles)')
    begin = start(0.6, 0.5)
    exponents = [1 / 9, 1 / 5, 1 / 3, 5 / 9, 7 / 9, 9 / 11]
    rows = []
    for exponent in exponents:
        way = first_step(begin, Law(k1=0.1, k2=1.0, exponent=exponent), ratio=1.5)
        least, e = float(np.abs(way.values(e_current)).min()), e_desired(begin)
        rows.append(
            (
                way.values(distance).max(),
                theory.largest_growth(e, least),
                theory.printed_growth(e, least, exponent=exponent),
            )
        )
    for values, colour, style, text in zip(
        np.array(rows).T,
        (BLUE, GREEN, RED),
        ('o-', 's--', 'x:'),
        ('run', 'bound exp(f |chi_0| / |e_au,min|)', 'Delta as printed'),
        strict=True,
    ):
        exponent_axes.semilogy(exponents, values, style, color=colour, label=text, ms=4.0)
    exponent_axes.legend()
    name(exponent_axes, 'beta / gamma', 'largest d / d_0', 'k1 = 0.1 1/s, k2 = 1 1/s')
    gains = np.geomspace(0.15, 5.0, 9)
    for k1, colour in ((0.0, GREEN), (0.1, BLUE), (0.3, RED)):
        growth = [
            first_step(begin, Law(k1=k1, k2=k2), ratio=1.5).values(distance).max() for k2 in gains
        ]
        gain_axes.loglog(gains, growth, 'o-', color=colour, ms=3.0, label=f'k1 = {k1:g} 1/s')
    gain_axes.set(xticks=(0.2, 0.5, 1.0, 2.0, 5.0), yticks=(2, 5, 10, 20))
    plain_ticks(gain_axes)
    gain_axes.legend()
    name(gain_axes, 'k2 [1/s]', 'largest d / d_0', 'a small k2 sends it away, not a large one')
    return figure


def sampled() -> Figure:
    """Draw what a period does around e_du = 0, and the rate with a guessed focal length."""
    figure, (landing, guess) = page('Sampling at 11 Hz, and a focal length guessed too short')
    begin, exponent, dt = start(0.5, -0.4, far=3.0), 5.0 / 9.0, 1.0 / 11.0
    gentle = 0.002 ** (1.0 - exponent) / dt
    for factor, colour in ((20.0, RED), (1.0, BLUE)):
        law = Law(k1=0.05, k2=factor * gentle, exponent=exponent, max_linear=0.4)
        way = first_step(begin, law, dt=dt, steps=200)
        chi = np.degrees(np.arctan(way.values(e_desired)))
        text = f'k2 = {law.k2:.2g}: {"jumps past zero" if factor > 1.0 else "lands"}'
        landing.plot(way.times, chi, color=colour, label=text)
    landing.axhspan(-0.002 * DEGREES, 0.002 * DEGREES, color=GREY, alpha=0.4, lw=0.0)
    landing.set(xlim=(3.5, 8.0), ylim=(-1.5, 1.0))
    landing.legend(loc='lower right')
    name(landing, 'time [s]', 'bearing of e_du [deg]', 'at most 0.4 m/s, d_hat = d')
    abscissae = np.geomspace(0.03, 10.0, 80)
    for part, colour in ((1 / 6, RED), (0.5, BLUE), (1.0, GREEN)):
        rates = [
            -theory.closed_loop_rates(a, 0.0, (-a, 0.0), ratio=1.0, guess=part)[0] / a
            for a in abscissae
        ]
        guess.loglog(abscissae, rates, color=colour, label=f'f_hat = {part:.2g} f')
        guess.plot(math.sqrt(part), 1.0, 'o', color=colour, ms=4.0)
    guess.set(xticks=(0.1, 0.5, 1.0, 5.0), yticks=(0.2, 0.5, 1, 2, 5))
    plain_ticks(guess)
    guess.axhline(1.0, color=INK, ls='--')
    guess.text(0.032, 0.72, 'the paper: at least k1', fontsize=7.5)
    guess.legend()
    name(guess, '|e_au| / f', 'rate of e_au / k1', 'after e_du = 0 (eq. 26)')
    return figure


FIGURES: dict[str, Callable[[], Figure]] = {
    'theory_signs.png': signs,
    'theory_singularity.png': singularity,
    'theory_excursion.png': excursion,
    'theory_sampled.png': sampled,
}


def main(folder: Path) -> None:
    """Draw all figures into ``folder``."""
    for file, draw in FIGURES.items():
        with rc_context(FIGURE_SETTINGS):
            draw().savefig(folder / file, dpi=130, metadata={'Software': None})
        print(folder / file)


if __name__ == '__main__':
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
