"""The command ``visual_servo``: picks the subcommand, turns errors into exit codes."""

import argparse
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from importlib import import_module
import os
import signal
import sys
from threading import Timer
from typing import Any, NoReturn

from visual_servo_epipolar import __version__
from visual_servo_epipolar.commands.options import COMMANDS
from visual_servo_epipolar.commands.outputs import check_outputs
from visual_servo_epipolar.core.errors import InputError, VisualServoError
from visual_servo_epipolar.files import PACKAGE
from visual_servo_epipolar.nodes.startup.missing import remedy
from visual_servo_epipolar.processes import printing

FAILURE, BAD_INPUT, SIGNALLED = 1, 2, 128  # exit codes; the last one and the number of a signal
REPEAT_S = 0.05  # after a signal was dropped: the destructor that it came in has ended by then
# Tools that no robot needs: each is a module with add_options(parser), imported when it is called.
EVALUATION: dict[str, tuple[str, str]] = {
    'reproduce': ("reproduce the paper's figures and statements", 'reproduction.command'),
    'bench': ('measure accuracy and speed, beside other methods', 'benchmarks.command'),
    'faults': ('inject faults, and judge whether the robot stays safe', 'faults.command'),
}


class Parser(argparse.ArgumentParser):
    """A parser that says what is wrong in one line, by the name of the subcommand."""

    commands: Mapping[str, argparse.ArgumentParser]

    def error(self, message: str) -> NoReturn:
        """Exit with code 2."""
        self.exit(BAD_INPUT, f'{self.prog}: {message}; see {self.prog} --help\n')

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse all of ``args``; words that are no options are an error of the subcommand."""
        options, unknown = self.parse_known_args(args, namespace)
        if unknown:
            self.commands[options.command].error(f'unrecognized arguments: {" ".join(unknown)}')
        return options


def parser(words: Collection[str] = ()) -> Parser:
    """Return the parser of the command line; tools get their options if ``words`` name them."""
    top = Parser(
        prog='visual_servo',
        description='Drive a robot back to where a photograph was taken, by epipolar geometry.',
    )
    top.add_argument('--version', action='version', version=f'%(prog)s {__version__}')
    kinds = top.add_subparsers(dest='command', required=True, metavar='COMMAND')
    for name, (text, _) in {**COMMANDS, **EVALUATION}.items():
        kinds.add_parser(name, help=text, description=f'{text[:1].upper()}{text[1:]}.')
    for name, (_, add_options) in COMMANDS.items():
        add_options(kinds.choices[name])
        kinds.choices[name].set_defaults(run=_call)
    for name in EVALUATION.keys() & set(words):
        module = import_module(f'{PACKAGE}.evaluation.{EVALUATION[name][1]}')
        module.add_options(kinds.choices[name])
    top.commands = kinds.choices
    return top


def _call(options: argparse.Namespace) -> int:
    """Run a command of this folder; only now is what it needs loaded."""
    return int(import_module(f'{PACKAGE}.commands.{options.command}').run(options))


def main(args: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code; silently where its output is not read."""
    words = sys.argv[1:] if args is None else args
    return printing('visual_servo', lambda: _run(parser(words).parse_args(words)))


class Terminated(KeyboardInterrupt):
    """SIGTERM came: all ends as after Ctrl-C, with its own exit code."""


INTERRUPTS = {signal.SIGINT: KeyboardInterrupt, signal.SIGTERM: Terminated}


@contextmanager
def terminable() -> Iterator[None]:
    """
    Raise Terminated in the block at the first SIGTERM, KeyboardInterrupt at SIGINT.

    SIGTERMs that follow change nothing: timeout(1) sends two, and the second one must not cut off
    the tidying up. Python drops an exception of a destructor: it is raised again. rclpy makes a
    RuntimeError of one that comes while it fills a message: the block ends by the interrupt.
    """
    before, report = {it: signal.getsignal(it) for it in INTERRUPTS}, sys.unraisablehook
    came: list[signal.Signals] = []
    again: list[Timer] = []

    def interrupt(number: int, _: object) -> NoReturn:
        came.append(signal.Signals(number))
        if number == signal.SIGTERM:
            signal.signal(number, signal.SIG_IGN)
        raise INTERRUPTS[came[-1]]

    def repeat(dropped: 'sys.UnraisableHookArgs') -> None:
        if not issubclass(dropped.exc_type, KeyboardInterrupt):
            report(dropped)
            return
        signal.signal(came[-1], interrupt)
        again.append(Timer(REPEAT_S, os.kill, (os.getpid(), came[-1])))
        again[-1].start()

    for number, handler in before.items():
        if handler is not signal.SIG_IGN:  # as of a command that a shell has in the background
            signal.signal(number, interrupt)
    sys.unraisablehook = repeat
    try:
        yield
        if came:
            raise INTERRUPTS[came[-1]]
    except (RuntimeError, SystemError) as error:
        if came:
            raise INTERRUPTS[came[-1]] from error
        raise
    finally:
        for timer in again:
            timer.cancel()
        sys.unraisablehook = report
        for number, handler in before.items():
            signal.signal(number, handler)


def _run(options: argparse.Namespace) -> int:
    name = f'visual_servo {options.command}'
    try:
        with terminable():
            check_outputs(options)
            return int(options.run(options))
    except BrokenPipeError:
        raise
    except (VisualServoError, OSError) as error:
        code = BAD_INPUT if isinstance(error, (InputError, OSError)) else FAILURE
        return _complain(name, error, code)
    except ImportError as error:
        return _complain(name, remedy(error), BAD_INPUT)
    except KeyboardInterrupt as error:
        number = signal.SIGTERM if isinstance(error, Terminated) else signal.SIGINT
        return _complain(name, 'interrupted', SIGNALLED + number)


def _complain(name: str, reason: object, code: int) -> int:
    with suppress(BrokenPipeError):
        print(f'{name}: {" ".join(str(reason).split())}', file=sys.stderr)
    return code


if __name__ == '__main__':
    sys.exit(main())
