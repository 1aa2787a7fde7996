# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""What a machine must have before set-up starts; what it lacks is said in one sentence."""

import importlib.util
import os
import platform
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path


class SetupError(Exception):
    """Set-up cannot go on; the message says what to do about it."""


def check_platform() -> None:
    """ROS 2 comes as wheels for CPython on Linux and x86_64 alone."""
    machine = f'{platform.system()} {platform.machine()}'
    if machine != 'Linux x86_64':
        raise SetupError(
            f'The wheels of ROS 2 are for Linux x86_64 and this is {machine}: '
            'source an installed ROS 2 and build this package with colcon build.'
        )
    if platform.python_implementation() != 'CPython':
        raise SetupError(
            f'{platform.python_implementation()} is not supported: '
            'install CPython 3.10 to 3.14 and run make PYTHON=python3.12, for example.'
        )


def check_venv() -> None:
    """Debian and Ubuntu ship the venv module without the part that installs pip."""
    if any(importlib.util.find_spec(name) is None for name in ('venv', 'ensurepip')):
        raise SetupError(
            f'{python_name()} has no venv module: install it '
            f'(on Debian and Ubuntu: apt install {python_name()}-venv) and run make again.'
        )


def check_compiler() -> None:
    """The messages are compiled, as C and as C++."""
    compilers = (('C', 'CC', ('cc', 'gcc', 'clang')), ('C++', 'CXX', ('c++', 'g++', 'clang++')))
    for language, variable, names in compilers:
        given = os.environ.get(variable, '').split()[:1]
        if not any(shutil.which(name) for name in given or names):
            chosen = f' ({variable}={given[0]})' if given else ''
            raise SetupError(
                f'No {language} compiler was found{chosen}: install one '
                '(on Debian and Ubuntu: apt install g++) and run make again.'
            )


def check_machine() -> None:
    """Refuse a machine on which the wheels or the build cannot work."""
    check_platform()
    check_venv()
    check_compiler()


def python_name() -> str:
    """Name this Python as its packages are named."""
    return f'python{sys.version_info.major}.{sys.version_info.minor}'


def python_headers(folder: Path) -> list[Path]:
    """Find the include folders of this Python.

    Debian and Ubuntu keep Python.h in a package of its own; where it is not installed, the package
    is fetched into `folder` and unpacked there, which needs no rights.
    """
    include = Path(sysconfig.get_path('include'))
    if (include / 'Python.h').exists():
        return [include]
    unpacked, name = folder / 'usr' / 'include', python_name()
    header = unpacked / name / 'Python.h'
    if not header.exists():
        fetch_package(f'lib{name}-dev', folder)
    if not header.exists():
        raise SetupError(
            f'The headers of {name} (Python.h) are missing: install them '
            f'(on Debian and Ubuntu: apt install {name}-dev) and run make again.'
        )
    return [unpacked / name, unpacked]


def fetch_package(name: str, folder: Path) -> None:
    """Unpack a Debian package without installing it; whether it worked shows in the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    if shutil.which('apt-get') and shutil.which('dpkg-deb'):
        script = f'apt-get download {name} && dpkg-deb -x *.deb . && rm *.deb'
        subprocess.run(['sh', '-c', script], cwd=folder, check=False, capture_output=True)
