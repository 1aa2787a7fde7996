"""Entry of the command line: parse, run one command, answer failures in one sentence."""

from __future__ import annotations

import argparse
import importlib
import os
import sys

from tactile_ros import __version__
from tactile_ros.errors import TactileError, plain

COMMANDS = (
    'list', 'doctor', 'demo', 'calibrate', 'enrol', 'record', 'replay', 'report', 'view',
    'design', 'bench',
)  # fmt: skip
FAILED, WRONG_USE, INTERRUPTED, UNHEARD = 1, 2, 130, 141


def parser() -> argparse.ArgumentParser:
    """Arguments of all commands."""
    top = argparse.ArgumentParser(
        prog='tactile',
        description='Tactile sensors for robot hands: calibrate, run, replay, show and measure.',
        epilog='exit codes: 0 done; 1 failed, or something is wrong or left out; 2 wrong use; '
        '130 interrupted; 141 nobody reads the output any more. Tables go to stdout, with --json '
        'as JSON; progress and failures go to stderr.',
    )
    top.add_argument('--version', action='version', version=f'tactile_ros {__version__}')
    commands = top.add_subparsers(dest='command', required=True, metavar='COMMAND')
    for name in COMMANDS:
        module = importlib.import_module(f'tactile_ros.cli.{name}')
        own = commands.add_parser(
            name,
            help=(module.__doc__ or '').split('\n')[0],
            description=module.__doc__,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
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
    top = parser()
    complete(top)
    options, unknown = top.parse_known_args(arguments)
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
