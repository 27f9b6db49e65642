"""The command ``visual_servo``: picks the subcommand, turns errors into exit codes."""

import argparse
from collections.abc import Mapping, Sequence
from contextlib import suppress
import re
import sys
from typing import Any, NoReturn

from visual_servo_epipolar import __version__
from visual_servo_epipolar.commands import bench, faults, reproduce, simulate
from visual_servo_epipolar.commands.demo import command as demo
from visual_servo_epipolar.commands.ending import (
    INTERRUPTED,
    reader_left,
    terminable,
    TERMINATED,
    Terminated,
    unread,
)
from visual_servo_epipolar.commands.files.output import check_json, check_out
from visual_servo_epipolar.commands.gains import command as gains
from visual_servo_epipolar.commands.inspect import command as inspect
from visual_servo_epipolar.commands.replay import command as replay
from visual_servo_epipolar.commands.report import command as report
from visual_servo_epipolar.commands.sweep import command as sweep
from visual_servo_epipolar.core.errors import InputError, VisualServoError
from visual_servo_epipolar.nodes.startup.missing import remedy

SUCCESS, FAILURE, BAD_INPUT, UNREAD = 0, 1, 2, 141
COMMANDS = (demo, simulate, sweep, inspect, replay, report, reproduce, bench, faults, gains)


class Parser(argparse.ArgumentParser):
    """A parser that says what is wrong in one line, by the name of the subcommand."""

    commands: Mapping[str, argparse.ArgumentParser]

    def error(self, message: str) -> NoReturn:
        """Exit with code 2."""
        self.exit(BAD_INPUT, f'{self.prog}: {message}; see {self.prog} --help\n')

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse all of ``args``; what nobody knows is an error of the subcommand."""
        options, unknown = self.parse_known_args(args, namespace)
        if unknown:
            self.commands[options.command].error(f'unrecognized arguments: {" ".join(unknown)}')
        return options


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
    top.commands = kinds.choices
    for command in top.commands.values():
        command.description = _plain(command.description or '')
    return top


def main(args: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code; without a word where nobody reads it."""
    try:
        code = _run(parser().parse_args(args))
        return UNREAD if unread() else code
    except SystemExit as end:  # --help, or bad usage
        raise SystemExit(UNREAD if unread() else end.code) from None
    except OSError as error:
        if reader_left(error):
            return UNREAD
        return _complain('visual_servo', f'output cannot be written: {error.strerror}', BAD_INPUT)


def _run(options: argparse.Namespace) -> int:
    who = f'visual_servo {options.command}'
    try:
        with terminable():
            check_json(options.json if 'json' in options else None)
            check_out(options.out if 'out' in options else None)
            return int(options.run(options))
    except (VisualServoError, OSError) as error:
        if isinstance(error, OSError) and reader_left(error):
            return UNREAD
        code = BAD_INPUT if isinstance(error, (InputError, OSError)) else FAILURE
        return _complain(who, error, code)
    except ImportError as error:
        return _complain(who, remedy(error), BAD_INPUT)
    except KeyboardInterrupt as error:
        return _complain(
            who, 'interrupted', TERMINATED if isinstance(error, Terminated) else INTERRUPTED
        )


def _complain(who: str, reason: object, code: int) -> int:
    with suppress(BrokenPipeError):
        print(f'{who}: {" ".join(str(reason).split())}', file=sys.stderr)
    return code


def _plain(docstring: str) -> str:
    """Return the docstring of a command as text for its users."""
    text = re.sub(r'^\s*``visual_servo \w+``: ', '', docstring).replace('``', '')
    return text[:1].upper() + text[1:]


if __name__ == '__main__':
    sys.exit(main())
