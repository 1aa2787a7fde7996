"""Entry of the command line: parse, run one command, answer failures in one sentence."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from difflib import get_close_matches

from tactile_ros import __version__
from tactile_ros.errors import TactileError, plain

COMMANDS = {  # with the first line of its module, which alone is imported to run it
    'list': 'Show every sensor: key, paper, transports, how to connect.',
    'doctor': 'Look at ports, permissions, buses and a sensor, or at a bag, and say what to do.',
    'run': 'Run the nodes of a sensor, or of a hand with its sensors, until Ctrl-C.',
    'demo': 'Run a real recording through the real graph, record, replay and report it.',
    'calibrate': "Fit a sensor's estimators to recordings with truth; write a calibration file.",
    'enrol': 'Learn a class from a few presses, live or from a recording, or forget one by name.',
    'record': 'Record what a replay needs of one sensor into a bag, until Ctrl-C.',
    'replay': 'Evaluate recordings against their truth, without ROS, and against the live run.',
    'compare': 'Compare calibrations, estimators or live runs on the same frames, with p-values.',
    'report': 'Gather what benches found into one HTML page: aims held, missed, speed, error.',
    'view': 'Show taxels, contacts, forces and grip live in the browser, or in Foxglove.',
    'new': 'Begin a sensor of your own: one file that works at once with a simulated board.',
    'design': 'Trade geometry and materials of a sensor for what it shall measure, by physics.',
    'bench': 'Compare with published figures and with peers, then time; write json.',
}
FAILED, WRONG_USE, INTERRUPTED, UNHEARD = 1, 2, 130, 141


def parser(only: str | None = None) -> argparse.ArgumentParser:
    """Arguments of all commands, or of one; the others are named."""
    top = argparse.ArgumentParser(
        prog='tactile',
        description='Tactile sensors for robot hands: calibrate, run, replay, show and measure.',
        epilog='exit codes: 0 done; 1 failed, or something is wrong or left out; 2 wrong use; '
        '130 interrupted; 141 nobody reads the output any more. Tables go to stdout, with --json '
        'as JSON; progress and failures go to stderr.',
    )
    top.add_argument('--version', action='version', version=f'tactile_ros {__version__}')
    commands = top.add_subparsers(dest='command', required=True, metavar='COMMAND')
    for name, summary in COMMANDS.items():
        own = commands.add_parser(
            name, help=summary, formatter_class=argparse.RawDescriptionHelpFormatter
        )
        if only not in (None, name):
            continue
        module = importlib.import_module(f'tactile_ros.cli.{name}')
        own.description = module.__doc__
        module.add_arguments(own)
        own.set_defaults(run=module.run, refuse=own.error)
    return top


def complete(top: argparse.ArgumentParser) -> None:
    """Answer a shell that asks what could follow, where argcomplete is installed, and end."""
    if '_ARGCOMPLETE' in os.environ:
        from argcomplete import autocomplete

        autocomplete(top)


def sentence(error: Exception) -> str:
    """Error in words, without the number that the system gives it, harmless to a terminal."""
    if isinstance(error, OSError) and error.strerror:
        named = [str(name) for name in (error.filename, error.filename2) if name]
        return plain(': '.join([*named, error.strerror]))
    return plain(str(error))


def main(arguments: list[str] | None = None) -> int:
    """Run one command.

    Returns
    -------
    int
        0 done, 1 failed, 2 wrong use, 130 interrupted, 141 nobody reads what it prints.
    """
    if sys.stdout is None:
        print('tactile: standard output is closed', file=sys.stderr)
        return FAILED
    given = sys.argv[1:] if arguments is None else arguments
    first = given[0] if given else ''
    top = parser(None if '_ARGCOMPLETE' in os.environ else first)
    complete(top)
    if first and first[0] != '-' and first not in COMMANDS:
        close = get_close_matches(first, COMMANDS, 1)
        meant = f'did you mean {close[0]}?' if close else f'there are {", ".join(COMMANDS)}'
        top.error(f'{plain(first)} is no command; {meant}')
    options, unknown = top.parse_known_args(given)
    if unknown:  # argparse would show the usage of `tactile`, which has no options
        options.refuse(f'unrecognized arguments: {" ".join(unknown)}')
    try:
        code = int(options.run(options) or 0)
        sys.stdout.flush()
    except BrokenPipeError:
        # or Python tries again at its end, and complains
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return UNHEARD
    except (TactileError, OSError) as error:
        print(f'tactile {options.command}: {sentence(error)}', file=sys.stderr)
        return FAILED
    except ValueError as error:
        print(f'tactile {options.command}: {sentence(error)}', file=sys.stderr)
        return WRONG_USE
    except KeyboardInterrupt:
        print('tactile: interrupted', file=sys.stderr)
        return INTERRUPTED
    return code
