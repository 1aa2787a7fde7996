# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The launch files by launch_testing, where ROS brings it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip(
    'launch_testing',
    reason='launch_testing is not installed (it comes with ROS): launch files are tested on '
    'stand-ins alone, by test/launch/test_launch.py',
)

HERE = Path(__file__).parent
BUILT = HERE.parents[1] / 'install' / 'tactile_ros'


def test_what_the_launch_files_start_speaks_and_ends() -> None:
    built = [str(BUILT)] if BUILT.is_dir() else []
    found = os.pathsep.join([os.environ.get('AMENT_PREFIX_PATH', ''), *built]).strip(os.pathsep)
    words = [sys.executable, '-m', 'launch_testing.launch_test', str(HERE / 'launched.py')]
    done = subprocess.run(
        words, env={**os.environ, 'AMENT_PREFIX_PATH': found}, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
