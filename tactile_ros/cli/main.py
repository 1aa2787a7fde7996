"""Entry of the command line: parse, run one command, answer failures in one sentence."""

from __future__ import annotations

import argparse
import importlib
import sys

from tactile_ros import __version__
from tactile_ros.errors import TactileError

COMMANDS = (
    'list', 'doctor', 'demo', 'calibrate', 'enrol', 'record', 'replay', 'design', 'bench',
)  # fmt: skip
FAILED, WRONG_USE, INTERRUPTED = 1, 2, 130


def parser() -> argparse.ArgumentParser:
    """Arguments of all commands."""
    top = argparse.ArgumentParser(
        prog='tactile',
        description='Tactile sensors for robot hands: calibrate, run, replay and measure.',
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
        own.set_defaults(run=module.run)
    return top


def sentence(error: Exception) -> str:
    """What went wrong, without the number that the system gives it."""
    if isinstance(error, OSError) and error.strerror:
        named = [str(name) for name in (error.filename, error.filename2) if name]
        return ': '.join([*named, error.strerror])
    return str(error)


def main(arguments: list[str] | None = None) -> int:
    """Run one command.

    Returns
    -------
    int
        0 done, 1 failed, 2 wrong use, 130 interrupted.
    """
    options = parser().parse_args(arguments)
    try:
        return int(options.run(options) or 0)
    except (TactileError, OSError) as error:
        print(f'tactile {options.command}: {sentence(error)}', file=sys.stderr)
        return FAILED
    except ValueError as error:
        print(f'tactile {options.command}: {error}', file=sys.stderr)
        return WRONG_USE
    except KeyboardInterrupt:
        print(f'tactile {options.command}: interrupted', file=sys.stderr)
        return INTERRUPTED
