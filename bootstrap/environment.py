# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The virtual environment: real ROS 2 from wheels, every version and hash from a lock file."""

import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from machine import SetupError, python_headers, python_name
from progress import run, say

LOCKS = Path(__file__).parent / 'locks'
MARK = 'tactile_ros.json'  # in the environment: what it was made from; empty while it is made

# What a sourced ROS leaves in a shell: it would win over the environment's own ROS.
SOURCED = (
    'AMENT_PREFIX_PATH', 'COLCON_PREFIX_PATH', 'CMAKE_PREFIX_PATH', 'PYTHONPATH',
    'LD_LIBRARY_PATH', 'ROS_DISTRO', 'ROS_VERSION', 'ROS_PYTHON_VERSION', 'ROS_PACKAGE_PATH',
    'RMW_IMPLEMENTATION', 'ROS_ETC_DIR', '_ROS_WHEELS_BOOTSTRAP_COMPLETE', 'VIRTUAL_ENV',
    'PYTHONHOME',
)  # fmt: skip


def clean_environment() -> dict[str, str]:
    """The caller's environment without a sourced ROS."""
    kept = {name: value for name, value in os.environ.items() if name not in SOURCED}
    return {**kept, 'PIP_USER': '0', 'PIP_DISABLE_PIP_VERSION_CHECK': '1'}


def digest(*locks: str) -> str:
    """Say in one number what lock files hold."""
    text = b''.join((LOCKS / f'{name}.txt').read_bytes() for name in locks)
    return hashlib.sha256(text).hexdigest()


def made_from(venv: Path) -> dict[str, str]:
    """What an environment was made from; empty where there is none or it was never finished."""
    if not venv.exists():
        return {}
    if not (venv / MARK).exists():
        raise SetupError(f'{venv} was not made by this set-up: move it away and run make again.')
    text = (venv / MARK).read_text()
    return json.loads(text) if text else {}


def make_environment(venv: Path, locks: list[str], distro: str, log: Path) -> bool:
    """Make the environment, or take it as it is; True where it was made."""
    want, have = {
        'distro': distro,
        'python': f'{python_name()} at {os.path.realpath(sys.executable)}',
        'place': str(venv),
        'requirements': digest(*locks),
    }, made_from(venv)  # fmt: skip
    if have == want:
        return False
    if venv.exists():
        say(why_again(venv, want, have))
        shutil.rmtree(venv)
    try:
        fill_environment(venv, locks, log)
    except BaseException:
        shutil.rmtree(venv, ignore_errors=True)
        raise
    (venv / MARK).write_text(json.dumps(want, indent=1))
    return True


def why_again(venv: Path, want: dict[str, str], have: dict[str, str]) -> str:
    """Say why an environment is made again."""
    if not have:
        return f'{venv.name} was left half made: it is made again.'
    changes = [
        f'the {name} changes from {have.get(name)} to {want[name]}'
        for name in ('distro', 'python', 'place')
        if want[name] != have.get(name)
    ] or ['the requirements change']
    return f'{" and ".join(changes)}: {venv.name} and install are built again.'.capitalize()


def fill_environment(venv: Path, locks: list[str], log: Path) -> None:
    """Make the folder, install what the locks name, and mend the wheels' include paths."""
    say(f'Making {venv.name} with {python_name()}')
    venv.mkdir()
    (venv / MARK).touch()
    run([sys.executable, '-m', 'venv', str(venv)], log=log, what='venv', env=clean_environment())
    for name in locks:
        install(venv, name, log)
    mend_include_paths(venv)


def install(venv: Path, name: str, log: Path) -> None:
    """Install one lock file: nothing but what it names, by hash."""
    lock = LOCKS / f'{name}.txt'
    total = len(re.findall(r'^[a-z0-9]', lock.read_text(), re.M | re.I))
    say(f'Installing {total} packages: {name}')
    # Compiled when first imported: most modules of most packages never are.
    command = [str(venv / 'bin' / 'python'), '-m', 'pip', 'install', '--no-deps', '--no-compile']
    command += ['--no-build-isolation', '--require-hashes', '--progress-bar', 'off']
    run(
        [*command, '-r', str(lock)],
        log=log,
        what=f'Installing {name}',
        env=clean_environment(),
        pattern=r'Collecting ([\w.-]+)|Installing (collected packages)',
        total=total,
    )


def add_tests(venv: Path, log: Path) -> bool:
    """Add what tests and benchmarks need, once; True where that was to do."""
    stamp = venv / 'tactile_ros.test'
    if stamp.exists() and stamp.read_text() == digest('test'):
        return False
    install(venv, 'test', log)
    stamp.write_text(digest('test'))
    return True


def mend_include_paths(venv: Path) -> None:
    """The wheels' CMake targets name the include folders of the machine that built them."""
    python = str(venv / 'bin' / 'python')
    code = 'import numpy; print(numpy.get_include())'
    numpy = subprocess.run([python, '-c', code], check=True, stdout=subprocess.PIPE, text=True)
    headers = ';'.join(map(str, python_headers(venv / 'headers')))
    for file in (venv / 'share').rglob('*.cmake'):
        text = file.read_text()
        if (new := mended(text, headers, numpy.stdout.strip())) != text:
            file.write_text(new)


def mended(text: str, headers: str, numpy: str) -> str:
    """Put this machine's include folders in the place of the maker's."""
    text = re.sub(r'/opt/python/[^;"/]*/[^;"]*/numpy/_?core/include', numpy, text)
    return re.sub(r'/opt/python/[^;"/]*/include/python3\.\d+', headers, text)
