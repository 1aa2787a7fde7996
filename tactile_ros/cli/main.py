# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Entry of the command line: parse, run one command, answer failures in one sentence."""

from __future__ import annotations

import argparse
import importlib
import os
import re
import sys
from contextlib import ExitStack, redirect_stderr
from difflib import get_close_matches
from pathlib import Path
from typing import NoReturn

from tactile_ros import __version__
from tactile_ros.errors import TactileError, plain

COMMANDS = {  # with the first line of its module, which alone is imported to run it
    'list': 'Show every sensor: key, paper, transports, how to connect.',
    'doctor': 'Look at ports, permissions, buses and a sensor, or at a bag, and say what to do.',
    'run': 'Run the nodes of a sensor, or of a hand with its sensors, until Ctrl-C.',
    'demo': 'Run a real recording through the real graph, record, replay and report it.',
    'calibrate': "Fit a sensor's estimators to recordings with truth; write a calibration file.",
    'calibration': 'Show a calibration file: sensor, estimators, errors, how it was set.',
    'enrol': 'Learn a class from a few presses, live or from a recording, or forget one by name.',
    'record': 'Record what a replay needs of one sensor into a bag, until Ctrl-C.',
    'replay': 'Evaluate recordings against their truth, without ROS, and against the live run.',
    'compare': 'Compare calibrations, estimators or live runs on the same frames, with p-values.',
    'export': 'Write bags as csv, parquet, or a data set that robot policies learn from.',
    'report': 'Gather results of benches on one HTML page: aims held and missed, speed, error.',
    'view': 'Show taxels, contacts, forces and grip live in the browser, or in Foxglove.',
    'new': 'Begin a sensor of your own: one file that works at once with a simulated board.',
    'design': 'Choose geometry and materials of a sensor by what it must measure.',
    'bench': 'Compare with published figures and simple methods, then time; write json.',
}
FAILED, WRONG_USE, INTERRUPTED, UNHEARD = 1, 2, 130, 141
LONGEST = 2000  # letters of a sentence
SETTINGS = Path('tactile.toml')  # in the working folder
MOST_SETTINGS = 10_000  # bytes
SIMULATED = '--simulated'
SETTABLE = {  # options of commands that it sets where they are not given
    'run': {'sensor': 'sensor', 'port': 'port', 'calibration': 'calibration'},
    'view': {'sensor': 'sensor', 'port': 'board', 'calibration': 'calibration'},
    'doctor': {'sensor': 'sensor', 'port': 'port'},
    'demo': {'sensor': 'sensor'},
    'replay': {'calibration': 'calibration'},
}
OTHER = {  # where such is named, it sets none
    'view': ('recording', 'namespace'),
    'run': ('hand',),
    'doctor': ('bag',),
}
WRONG = re.compile(
    r"(?:unrecognized arguments:|invalid choice:|received) '?([\w-]+)|^(\S+) does not exist, and"
)
RIGHT = re.compile(r'(?:one of|choose from|none of|ships only) \(?([^;()]+)')


class Parser(argparse.ArgumentParser):
    """Arguments of a command, whose refusals guess at what was meant."""

    def error(self, message: str) -> NoReturn:
        """Refuse."""
        super().error(with_guess(message, [*self._option_string_actions]))


def with_guess(said: str, options: list[str] | None = None) -> str:
    """Add a guess to a sentence that says what is wrong and what could be, or `options` could."""
    wrong, right = WRONG.search(said), RIGHT.search(said)
    if wrong is None or 'did you mean' in said:
        return said
    could = re.findall(r'[\w-]+', right[1]) if right else options or []
    close = get_close_matches(wrong[1] or wrong[2], could, 1, 0.7)
    return said if not close or close[0] in wrong.groups() else f'{said}; did you mean {close[0]}?'


def parser(only: str | None = None) -> argparse.ArgumentParser:
    """Arguments of all commands, or of one; the others are named."""
    top = Parser(
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
        own.add_argument('--quiet', action='store_true', help='no progress and no notes')
        module.add_arguments(own)
        own.set_defaults(run=module.run, refuse=own.error)
    return top


def complete(top: argparse.ArgumentParser) -> None:
    """Answer a shell that asks what could follow, where argcomplete is installed, and end."""
    if '_ARGCOMPLETE' in os.environ:
        from argcomplete import autocomplete

        from tactile_ros.sensors import list_sensors

        for own in top._subparsers._group_actions[0].choices.values():  # type: ignore[union-attr]
            for action in (one for one in own._actions if one.dest == 'sensor'):
                action.completer = lambda **_: list_sensors()
        autocomplete(top)


def settings() -> dict[str, str]:
    """Sensor, port and calibration that a file in the working folder sets.

    Raises ValueError if it sets anything else, or is no plain TOML.
    """
    if not SETTINGS.is_file():
        return {}
    try:
        import tomllib
    except ImportError:
        print(f'note: {SETTINGS} is read by Python 3.11 or later alone', file=sys.stderr)
        return {}
    try:
        with SETTINGS.open('rb') as file:
            found = tomllib.loads(file.read(MOST_SETTINGS).decode())
    except (ValueError, RecursionError) as error:
        raise ValueError(f'{SETTINGS} must be plain TOML: {error}') from error
    known = SETTABLE['run']
    for name, value in found.items():
        if name not in known or not (isinstance(value, str) and value):
            given = repr(name) if isinstance(value, dict | list) else f'{name!r} = {value!r}'
            msg = f'{SETTINGS} must set texts, one of {", ".join(known)}; received {given[:80]}'
            raise ValueError(msg)
    return found


def refuse_missing_sensors() -> None:
    """Raise ValueError where TACTILE_SENSORS names a folder of sensors that is not there."""
    for folder in filter(None, os.environ.get('TACTILE_SENSORS', '').split(os.pathsep)):
        if not Path(folder).is_dir():
            raise ValueError(f'TACTILE_SENSORS must name folders of sensors; {folder} is none')


def with_settings(given: list[str]) -> list[str]:
    """Words of a command with the options that the file sets before them.

    It sets what belongs to one sensor: where that is named, the words stay as they are.
    """
    options = {f'--{option}': name for name, option in SETTABLE.get(given[0], {}).items()}
    words = [word.partition('=')[0] for word in given[1:] if len(word) > 3]  # perhaps shortened
    named = {option for option in options for word in words if option.startswith(word)}
    found = settings() if options and '--sensor' not in named else {}
    added = [
        f'{option}={found[name]}'
        for option, name in options.items()
        if name in found and option not in named and not (name == 'port' and SIMULATED in given)
    ]
    return [given[0], *added, *given[1:]]


def parse(top: argparse.ArgumentParser, given: list[str]) -> argparse.Namespace:
    """Options of a command, as they are given or set by the file; wrong ones end the program."""
    try:
        words = with_settings(given) if given else given
    except ValueError as error:
        top.error(plain(str(error)))
    options, unknown = top.parse_known_args(words)
    if any(getattr(options, name) for name in OTHER.get(options.command, ())):
        words = given
        options, unknown = top.parse_known_args(words)
    if unknown:  # argparse would show the usage of `tactile`, which has no options
        options.refuse(f'unrecognized arguments: {" ".join(unknown)}')
    added = words[1 : len(words) - len(given) + 1]
    if added and not options.quiet:
        print(plain(f'set by {SETTINGS}: {" ".join(added)}'), file=sys.stderr)
    return options


def sentence(error: Exception) -> str:
    """Error in words, without the number that the system gives it, harmless to a terminal."""
    said = with_guess(str(error))
    if isinstance(error, OSError) and error.strerror:
        named = [str(name) for name in (error.filename, error.filename2) if name]
        said = ': '.join([*named, error.strerror])
    return plain(said if len(said) <= LONGEST else f'{said[:LONGEST]}... ({len(said):,} letters)')


def main(arguments: list[str] | None = None) -> int:
    """Run one command: 0 done, 1 failed, 2 wrong use, 130 interrupted, 141 nobody reads."""
    if sys.stdout is None:
        print('tactile: standard output is closed', file=sys.stderr)
        return FAILED
    given = sys.argv[1:] if arguments is None else arguments
    first = given[0] if given else ''
    top = parser(None if '_ARGCOMPLETE' in os.environ else first)
    complete(top)
    if first and first not in (*COMMANDS, '-h', '--help', '--version'):
        close = get_close_matches(first, COMMANDS, 1)
        meant = f'did you mean {close[0]}?' if close else f'there are {", ".join(COMMANDS)}'
        top.error(f'{plain(first)} is no command; {meant}')
    options = parse(top, given)
    try:
        with ExitStack() as held:
            if options.quiet:
                held.enter_context(redirect_stderr(held.enter_context(Path(os.devnull).open('w'))))
            if options.command != 'new':  # which makes the first one
                refuse_missing_sensors()
            code = int(options.run(options) or 0)
        sys.stdout.flush()
    except BrokenPipeError:
        # or Python tries again at its end, and complains
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return UNHEARD
    except (TactileError, OSError, ValueError) as error:
        print(f'tactile {options.command}: {sentence(error)}', file=sys.stderr)
        return FAILED if isinstance(error, (TactileError, OSError)) else WRONG_USE
    except KeyboardInterrupt:
        print('tactile: interrupted', file=sys.stderr)
        return INTERRUPTED
    return code
