# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Write the lock files: one version of everything, with hashes, for CPython 3.10 to 3.14 on Linux.

Run by `make lock` only, when a requirement changes; it needs uv, which set-up itself does not.
Versions stay what they are as long as they can; a lock file that is removed is resolved anew.
"""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

LOCKS = Path(__file__).parent / 'locks'
SCOPE = (
    "python_full_version < '3.15'", "platform_python_implementation == 'CPython'",
    "sys_platform == 'linux'",
)  # fmt: skip
OLDEST = (
    '--resolution=lowest-direct', '--only-binary=:all:', '--python-platform=x86_64-manylinux_2_28',
)  # fmt: skip
PROJECT = f"""[project]
name = 'lock'
version = '0'
requires-python = '>=3.10'
[tool.uv]
environments = ["{' and '.join(SCOPE)}"]
"""


def resolve(names: list[str], constraints: str, *options: str) -> dict[str, str]:
    """Resolve the named .in files together: requirement line -> the whole entry with hashes."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, 'pyproject.toml').write_text(PROJECT)
        Path(folder, 'constraints.txt').write_text(constraints)
        command = [sys.executable, '-m', 'uv', 'pip', 'compile', '--quiet', *options]
        command += ['--python-version', '3.10', '--generate-hashes', '--no-header']
        command += ['--no-annotate', '-c', 'constraints.txt', '--allow-unsafe']
        command += [str(LOCKS / f'{name}.in') for name in names]
        output = Path(folder, 'lock.txt')  # uv prefers the versions that stand there
        stored = (LOCKS / f'{name}.txt' for name in names)
        output.write_text('\n'.join(path.read_text() for path in stored if path.exists()))
        subprocess.run([*command, '-o', str(output)], cwd=folder, check=True)
        text = output.read_text().strip()
    entries = re.split(r'\n(?=\S)', text)
    return {simplify(entry).split(' \\')[0]: simplify(entry) for entry in entries}


def simplify(entry: str) -> str:
    """Leave out of the markers what holds for every supported machine."""
    line, _, hashes = entry.partition(' \\\n')
    requirement, _, marker = line.partition(' ; ')
    kept = [part for part in marker.split(' and ') if part and part not in SCOPE]
    line = f'{requirement} ; {" and ".join(kept)}' if kept else requirement
    return f'{line} \\\n{hashes}'


def write(name: str, entries: dict[str, str]) -> None:
    """Write one lock file."""
    lines = [f'# Written by `make lock` from {name}.in; do not edit.', *entries.values(), '']
    (LOCKS / f'{name}.txt').write_text('\n'.join(lines))


def main() -> None:
    """Resolve layer upon layer, each held to the versions of those below."""
    core = resolve(['tools', 'core'], '', '--universal')
    tools = resolve(['tools'], '\n'.join(core), '--universal')
    write('tools', tools)
    write('core', {line: entry for line, entry in core.items() if line not in tools})
    for name in ('kilted', 'jazzy', 'test'):
        layer = resolve(['tools', 'core', name], '\n'.join(core), '--universal')
        write(name, {line: entry for line, entry in layer.items() if line not in core})
    write('oldest', resolve(['oldest'], '', *OLDEST))


if __name__ == '__main__':
    main()
