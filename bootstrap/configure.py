# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Set up everything: `make` runs this with the system's own Python before anything else.

The environment .venv first, then the package in install/. Each is stamped when it is finished with
what it was made from: whatever carries no stamp, or another one, is made again.
"""

import sys

if not (3, 10) <= sys.version_info < (3, 15):
    sys.exit(
        'Python {}.{} is not supported: install one of 3.10 to 3.14 and '
        'run make PYTHON=python3.12, for example.'.format(*sys.version_info)
    )

import argparse
import fcntl
import os
import signal
from pathlib import Path

import environment
import workspace
from machine import SetupError, check_machine
from progress import say

ROOT = Path(__file__).resolve().parent.parent
LOG = ROOT / 'log' / 'setup.log'


def main() -> None:
    """Read the command line, set up, and say failures in one sentence."""
    parser = argparse.ArgumentParser(description='Set up .venv and install for `make`.')
    parser.add_argument('--distro', default='kilted', help='ROS 2 distribution: kilted or jazzy')
    parser.add_argument('--tests', action='store_true', help='add what tests and benchmarks need')
    parser.add_argument('--oldest', action='store_true', help='the oldest wheels, without ROS')
    arguments = parser.parse_args()
    if arguments.oldest and sys.version_info[:2] != (3, 10):
        sys.exit('The oldest wheels are for Python 3.10: make OLDEST=/path/to/python3.10.')
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    try:
        check_machine()
        wait_for_turn()
        if arguments.oldest:  # what `make test-oldest` runs in
            environment.make_environment(ROOT / '.venv-oldest', ['oldest'], 'none', LOG)
        else:
            set_up(arguments.distro, tests=arguments.tests)
    except SetupError as err:
        sys.exit(f'Set-up stopped. {err}')
    except KeyboardInterrupt:
        sys.exit('Set-up was interrupted; the next make goes on from here.')


def wait_for_turn() -> None:
    """One set-up at a time: the folder itself is the lock, held until this process ends."""
    folder = os.open(ROOT, os.O_RDONLY)
    try:
        fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        say('Another set-up runs in this folder: waiting for it to end.')
        fcntl.flock(folder, fcntl.LOCK_EX)


def set_up(distro: str, *, tests: bool) -> None:
    """Make what `make demo` and `make test` run in."""
    if distro not in ('kilted', 'jazzy'):
        raise SetupError(f'DISTRO must be kilted or jazzy; received {distro}.')
    if os.environ.get('AMENT_PREFIX_PATH'):
        name = os.environ.get('ROS_DISTRO', 'in this shell')
        say(f'The sourced ROS 2 ({name}) is left out: make uses its own, {distro}, in .venv.')
    venv = ROOT / '.venv'
    made = environment.make_environment(venv, ['tools', 'core', distro], distro, LOG)
    if made:
        workspace.remove(ROOT)
    made |= tests and environment.add_tests(venv, LOG)
    made |= workspace.build(ROOT, venv, LOG)
    if made:
        say('Set-up is complete; the next start skips it.')


if __name__ == '__main__':
    main()
