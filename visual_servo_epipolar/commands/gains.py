"""Gains derived from circumstances: as a table, as YAML to paste, and as JSON."""

import argparse
from dataclasses import asdict, Field, fields
import math
import sys
from typing import Any

from visual_servo_epipolar.commands.outputs import publish
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.laws.circumstances import Circumstances
from visual_servo_epipolar.core.laws.derived_gains import enough
from visual_servo_epipolar.core.laws.gains import (
    derive,
    Gains,
    longest_convergence,
    longest_matching,
)
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.settings import range_of


def run(options: argparse.Namespace) -> int:
    """Derive, write, print; return 0. InputError where no gain is legal."""
    try:
        circumstances = Circumstances(
            **{item.name: getattr(options, item.name) for item in fields(Circumstances)}
        )
        gains = derive(circumstances)
        given = {} if options.phase_timeout is None else {'phase_timeout': options.phase_timeout}
        timeout = ServoSettings(**given).phase_timeout
    except ValueError as error:
        raise InputError(str(error)) from None
    warnings = slow_phases(circumstances, gains, timeout)
    for warning in warnings:
        print(f'visual_servo gains: warning: {warning}', file=sys.stderr)
    text = f'{in_words(circumstances, gains)}\n\n{as_yaml(circumstances, gains, timeout)}'
    more = {'phase_timeout_s': timeout, 'warnings': warnings}
    publish(document(circumstances, gains) | more, text, options.json)
    return 0


def durations(circumstances: Circumstances, gains: Gains) -> dict[str, float]:
    """Return the longest time of each phase that drives by derived gains [s]."""
    return {
        Phase.ZEROING_EPIPOLES.value: longest_convergence(circumstances, gains),
        Phase.MATCHING_FEATURES.value: longest_matching(circumstances, gains),
    }


def slow_phases(circumstances: Circumstances, gains: Gains, timeout: float) -> list[str]:
    """Return a line on each phase that may last longer than ``timeout`` [s]."""
    transients = {Phase.ZEROING_EPIPOLES.value: gains.transient}
    return [
        f'{name} may take {duration:.0f} s, and fails after phase_timeout, {timeout:g} s; '
        + _remedy(duration, driving=duration - transients.get(name, 0.0))
        for name, duration in durations(circumstances, gains).items()
        if duration > timeout
    ]


def _remedy(duration: float, *, driving: float) -> str:
    """Return what to do about ``duration`` [s], of which ``driving`` is spent at full speed."""
    largest = range_of(ServoSettings.__dataclass_fields__['phase_timeout']).high or math.inf
    others = '--max-linear' if driving > 0.5 * duration else '--nearest, or lower --latency'
    if enough(duration) > largest:
        return f'phase_timeout may be {largest:g} s at most: raise {others}'
    return f'raise phase_timeout to {enough(duration):g}, or raise {others}'


def document(circumstances: Circumstances, gains: Gains) -> dict[str, Any]:
    """Return gains and circumstances as the JSON document of the command line; SI but degrees."""
    return {
        'k1': gains.k1,
        'k1_alone': gains.k1_alone,
        'k2': gains.k2,
        'beta': gains.beta,
        'gamma': gains.gamma,
        'exponent': gains.exponent,
        'k_t': gains.k_t,
        'closing_rate': gains.rate,
        't_max_s': gains.transient,
        'longest_landing_s': longest_convergence(circumstances, gains),
        'longest_matching_s': longest_matching(circumstances, gains),
        'floor_deg': math.degrees(gains.floor),
        'circumstances': asdict(circumstances),
    }


def in_words(circumstances: Circumstances, gains: Gains) -> str:
    """Return the gains as a table of text."""
    landing = longest_convergence(circumstances, gains)
    matching = longest_matching(circumstances, gains)
    rows = [
        ('k1', f'{gains.k1:.4g}', '1/s', 'eq. (12), on the current epipole'),
        ('k1 alone', f'{gains.k1_alone:.4g}', '1/s', 'once e_du is zero, or where e_au is held'),
        ('k2', f'{gains.k2:.4g}', '', 'eq. (12), on the desired epipole'),
        ('beta/gamma', f'{gains.beta}/{gains.gamma}', '', 'exponent of eq. (12)'),
        ('k_t', f'{gains.k_t:.4g}', 'm/s', 'eq. (21), D at unit focal length'),
        ('rate', f'{gains.rate:.4g}', '1/s', 'at which k_t closes in, near the goal'),
        ('t_max', f'{gains.transient:.4g}', 's', 'until e_du is zero, at any speed'),
        ('', f'{landing:.4g}', 's', 'the same within the limits of speed'),
        ('step 2', f'{matching:.4g}', 's', 'at most, within them too'),
        ('floor', f'{math.degrees(gains.floor):.4g}', 'deg', 'that |atan e_au| keeps until then'),
    ]
    return '\n'.join(f'{name:<11}{value:>9} {unit:<4} {text}' for name, value, unit, text in rows)


def as_yaml(circumstances: Circumstances, gains: Gains, timeout: float) -> str:
    """Return the gains as a file for --rig, in the order and the ranges of the settings."""
    values = {
        'k1': gains.k1,
        'k2': gains.k2,
        'exponent': gains.exponent,
        'initial_distance': circumstances.farthest,
        'k_t': gains.k_t,
        'approach_rate': gains.rate,
        'turn_gain': min(gains.k1_alone, ServoSettings.turn_gain),
        'latch_engage': circumstances.landing,
        'max_linear': circumstances.max_linear,
        'max_angular': circumstances.max_angular,
    }
    values |= _timeouts(max(durations(circumstances, gains).values()), timeout)
    lines = [
        _line(item, values[item.name]) for item in fields(ServoSettings) if item.name in values
    ]
    return '\n'.join(['/**:', '  ros__parameters:', *lines])


def _timeouts(longest: float, timeout: float) -> dict[str, float]:
    """Return the timeouts of the servo [s] that are not its defaults; phases last ``longest``."""
    phase = enough(longest) if longest > timeout else timeout
    values = {'phase_timeout': phase, 'run_timeout': max(2.0 * phase, ServoSettings.run_timeout)}
    return {name: value for name, value in values.items() if value != getattr(ServoSettings, name)}


def _line(item: 'Field[Any]', value: float) -> str:
    """Return one parameter; a gain beyond its range is cut to it, with a comment."""
    largest = range_of(item).high
    if largest is not None and value > largest:
        return f'    {item.name}: {float(largest)!r}  # derived: {value:.6g}, beyond the range'
    return f'    {item.name}: {float(f"{value:.6g}")!r}'
