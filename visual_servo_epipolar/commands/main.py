"""The command ``visual_servo``: picks the subcommand, turns errors into exit codes."""

import argparse
from collections.abc import Sequence
import sys
from typing import NoReturn

from visual_servo_epipolar import __version__
from visual_servo_epipolar.commands import bench, demo, gains, inspect, reproduce, simulate
from visual_servo_epipolar.commands.replay import command as replay
from visual_servo_epipolar.commands.report import command as report
from visual_servo_epipolar.commands.sweep import command as sweep
from visual_servo_epipolar.core.errors import InputError, VisualServoError

SUCCESS, FAILURE, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
COMMANDS = (demo, simulate, sweep, inspect, replay, report, reproduce, bench, gains)


class Parser(argparse.ArgumentParser):
    """A parser that says what is wrong in one line."""

    def error(self, message: str) -> NoReturn:
        """Exit with code 2."""
        self.exit(BAD_INPUT, f'{self.prog}: {message}; see {self.prog} --help\n')


def parser() -> Parser:
    """Return the parser of the whole command line."""
    top = Parser(
        prog='visual_servo',
        description='Drive a unicycle robot to the pose of a photograph by epipolar geometry.',
    )
    top.add_argument('--version', action='version', version=f'%(prog)s {__version__}')
    kinds = top.add_subparsers(dest='command', required=True, metavar='COMMAND')
    for module in COMMANDS:
        module.add_to(kinds)
    return top


def main(args: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    options = parser().parse_args(args)
    try:
        return int(options.run(options))
    except (VisualServoError, OSError) as error:
        print(f'visual_servo {options.command}: {" ".join(str(error).split())}', file=sys.stderr)
        return BAD_INPUT if isinstance(error, (InputError, OSError)) else FAILURE
    except KeyboardInterrupt:
        print(f'visual_servo {options.command}: interrupted', file=sys.stderr)
        return INTERRUPTED


if __name__ == '__main__':
    sys.exit(main())
