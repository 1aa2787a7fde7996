# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The package itself, built with colcon into install/ and joined to the environment.

Python is taken from the source folder and the generated interfaces from install/, so that an
edited source needs no build; install/ links to the sources and works alone when it is sourced.
"""

import hashlib
import os
import shlex
import shutil
from pathlib import Path

from environment import SOURCED, clean_environment
from machine import python_headers, python_name
from progress import run, say

BUILT_FROM = ('package.xml', 'CMakeLists.txt', 'bootstrap/executable.in', 'msg', 'srv', 'action')
INSTALLED = ('tactile_ros', 'benchmarks', 'config', 'launch')
MADE = {'__pycache__', 'results'}  # by Python and by the benchmarks
STAMP = '.tactile_ros'


def state(root: Path) -> str:
    """What a build depends on: the text of the interfaces, but only the names of the sources."""
    digest = hashlib.sha256()
    for name in (*BUILT_FROM, *INSTALLED):
        for path in sorted([root / name, *(root / name).rglob('*')]):
            if path.is_file() and MADE.isdisjoint(path.parts):
                digest.update(str(path.relative_to(root)).encode() + b'\0')
                digest.update(path.read_bytes() if name in BUILT_FROM else b'')
    return digest.hexdigest()


def build(root: Path, venv: Path, log: Path) -> bool:
    """Build what is not built yet; True where something was."""
    stamp = root / 'install' / STAMP
    want = state(root)
    if stamp.exists() and stamp.read_text() == want:
        return False
    if not stamp.exists():  # never finished, or not made here
        remove(root)
    stamp.unlink(missing_ok=True)
    prune(root / 'install')
    say('Building the interfaces and installing the package')
    colcon(root, venv, log)
    join(root, venv)
    stamp.write_text(want)
    return True


def remove(root: Path) -> None:
    """Forget every build."""
    for name in ('build', 'install'):
        shutil.rmtree(root / name, ignore_errors=True)


def prune(folder: Path) -> None:
    """Remove the links to sources that are gone."""
    for path in folder.rglob('*'):
        if path.is_symlink() and not path.exists():
            path.unlink()


def colcon(root: Path, venv: Path, log: Path) -> None:
    """Build this one package with colcon, the environment as the underlay."""
    env = clean_environment()
    env.update(AMENT_PREFIX_PATH=str(venv), CMAKE_PREFIX_PATH=str(venv))
    env['PATH'] = os.pathsep.join((str(venv / 'bin'), env.get('PATH', '')))
    headers = [str(path) for path in python_headers(venv / 'headers')]
    env['CPATH'] = os.pathsep.join(filter(None, (*headers[1:], env.get('CPATH'))))
    run(
        [
            str(venv / 'bin' / 'python'), str(venv / 'bin' / 'colcon'),
            '--log-base', str(log.parent / 'colcon'), 'build', '--symlink-install',
            '--base-paths', str(root), '--build-base', str(root / 'build'),
            '--install-base', str(root / 'install'), '--event-handlers', 'console_direct+',
            '--cmake-args', '-G', 'Ninja', '-DBUILD_TESTING=OFF',
            '-DPYTHON_ONLY=ON',
            f'-DPython3_EXECUTABLE={venv / "bin" / "python"}',
            f'-DPython3_INCLUDE_DIR={headers[0]}',
        ],
        log=log,
        what='Building',
        env=env,
        pattern=r'\[(\d+/\d+)\]',
    )  # fmt: skip


def join(root: Path, venv: Path) -> None:
    """Let the environment's Python find the sources, the interfaces and their libraries."""
    packages = Path('lib') / python_name() / 'site-packages'
    prefix = root / 'install' / 'tactile_ros'
    (venv / packages / 'tactile_ros.pth').write_text(f'{root}\n{prefix / packages}\n')
    # The environment's lib/ is on its library path already.
    for library in (prefix / 'lib').glob('*.so'):
        link = venv / 'lib' / library.name
        link.unlink(missing_ok=True)
        link.symlink_to(library)
    prune(venv / 'lib')
    write_command(root, venv)


def write_command(root: Path, venv: Path) -> None:
    """Write bin/tactile: usable from any folder and any shell, also where a ROS is sourced."""
    program = root / 'install' / 'tactile_ros' / 'lib' / 'tactile_ros' / 'tactile'
    command = venv / 'bin' / 'tactile'
    command.write_text(
        '#!/bin/sh\n'
        '# A sourced ROS stays outside: this environment holds its own.\n'
        f'unset {" ".join(SOURCED)}\n'
        f'exec /bin/sh {shlex.quote(str(program))} "$@"\n'
    )
    command.chmod(0o755)
