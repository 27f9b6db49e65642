"""Console output: progress while a run lasts, and a summary of it."""

from collections.abc import Iterable, Mapping
from pathlib import Path
import sys
import time
from typing import Any, TextIO, TYPE_CHECKING

from visual_servo_epipolar.core.stamps import NANOSECONDS

if TYPE_CHECKING:
    from visual_servo_epipolar.core.servo.run_log import Sample

REFRESH_S = 0.1


class Progress:
    """Progress line, rewritten on a terminal; nothing anywhere else."""

    def __init__(self, stream: TextIO | None = None) -> None:
        stream = sys.stderr if stream is None else stream  # that of now, not of the import
        self._stream, self._shown = stream, -REFRESH_S
        self._live = stream.isatty()

    def __call__(self, sample: 'Sample') -> None:
        """Show one step."""
        now = time.monotonic()
        if not self._live or now - self._shown < REFRESH_S:
            return
        self._shown = now
        self.say(
            f'{sample.stamp_ns / NANOSECONDS:6.1f} s  {sample.phase.value:<18}'
            f'{sample.features:4d} features  {sample.twist.linear:+.2f} m/s  '
            f'{sample.twist.angular:+.2f} rad/s'
        )

    def say(self, text: str) -> None:
        """Show ``text`` as the line."""
        if self._live:
            self._stream.write(f'\r{text}\x1b[K')
            self._stream.flush()

    def close(self) -> None:
        """Clear the line."""
        self.say('')


def summary(result: Mapping[str, Any]) -> str:
    """Return the result of a run as text, phase by phase."""
    from visual_servo_epipolar.core.laws.registry import phase_words  # noqa: PLC0415 numpy, late

    (x, y, heading), ratio = result['start'], result['max_distance_ratio']
    far = 'all' if ratio is None else f'{100.0 * ratio:.0f} %'
    head = f'{result["outcome"]} after {result["duration_s"]:.1f} s'
    if result['outcome'] != 'arrived':
        head += f': {result["reason"]}'
    lines = [f'start x {x:g} m, y {y:g} m, heading {heading:+g} deg, law {result["law"]}', head]
    lines += [
        f'  {phase["start_s"]:6.1f} - {phase["end_s"]:6.1f} s  {phase["name"]:<18} '
        f'{phase_words(phase["name"])}'
        for phase in result['phases']
    ]
    lines += [
        f'error against ground truth: {1e3 * result["position_error_m"]:.2f} mm '
        f'(lateral {1e3 * result["lateral_error_m"]:+.2f}, '
        f'longitudinal {1e3 * result["longitudinal_error_m"]:+.2f}), '
        f'heading {result["heading_error_deg"]:+.3f} deg',
        f'path {result["path_length_m"]:.2f} m, at most {far} of the start distance '
        f'away, {result["min_visible_features"]} features or more, '
        f'{result["max_linear_speed"]:.2f} m/s, {result["max_angular_speed"]:.2f} rad/s',
    ]
    return '\n'.join(lines)


def written_to(folder: Path | str, names: Iterable[str]) -> str:
    """Return what a command wrote into ``folder`` as text."""
    return f'written to {folder}: {", ".join(sorted(names))}'
