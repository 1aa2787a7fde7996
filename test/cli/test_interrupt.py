# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Ctrl-C ends every command at any moment: code 130, one line, no child, nothing half written."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize(
    ('words', 'after_s'),
    [
        ('list', 0.12), ('doctor --sensor reskin_board --simulated', 0.4), ('record -o bag', 0.5),
        ('demo --output demo', 0.9), ('calibrate reskin_board normal_1 -o c.npz', 0.8),
    ],
)  # fmt: skip
def test_interrupt_ends_a_command_in_one_line(words: str, after_s: float, tmp_path: Path) -> None:
    script = tmp_path / 'tactile'
    text = (ROOT / 'bootstrap' / 'executable.in').read_text()
    text = text.replace('@Python3_EXECUTABLE@', sys.executable).replace('@module@', 'cli')
    script.write_text(text)
    with subprocess.Popen(
        ['/bin/sh', str(script), *words.split()],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        cwd=tmp_path, env={**os.environ, 'PYTHONPATH': str(ROOT)},
    ) as process:  # fmt: skip
        try:
            process.wait(after_s)  # the moment is the case
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGINT)
        _, said = process.communicate(timeout=120)
    assert process.returncode == 130
    assert 'Traceback' not in said
    assert said.splitlines()[-1] == 'tactile: interrupted'
    assert not list(tmp_path.rglob('*.part'))
    with pytest.raises(ProcessLookupError):  # no process of its group is left
        os.killpg(process.pid, 0)


def test_interrupt_amid_the_imports_says_so() -> None:
    lines = (
        'import os, sys, types; from tactile_ros import cli; cli._started.append(os.getpid())',
        "sys.modules['tactile_ros.files'] = types.ModuleType('begun')",
        'cli._end()',
    )
    words = [sys.executable, '-c', '\n'.join(lines)]
    done = subprocess.run(words, capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (130, b'tactile: interrupted\n')
