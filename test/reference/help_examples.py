# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Commands of every --help and of the pages, as a reader would type them."""

import importlib
import re
from pathlib import Path

from tactile_ros.cli.main import COMMANDS

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', *(ROOT / 'docs').glob('*.md')])
FENCE = re.compile(r'^```(\w*)\n(.*?)^```$', re.DOTALL | re.MULTILINE)


def examples() -> list[str]:
    """Lines below 'example:'; each command has some."""
    found = []
    for name in COMMANDS:
        text = importlib.import_module(f'tactile_ros.cli.{name}').__doc__ or ''
        _, _, below = text.partition('example:\n')
        assert below.strip(), f'tactile {name} --help has no example'
        found += [line.strip() for line in below.splitlines() if line.strip()]
    return found


def blocks(page: Path) -> list[tuple[str, str]]:
    """Fenced blocks of a page: language and text."""
    return FENCE.findall(page.read_text())


def lines(page: Path) -> list[str]:
    """Commands of a page's blocks, continued lines joined, comments left out."""
    found = []
    for language, text in blocks(page):
        if language in ('', 'bash', 'sh', 'console'):
            joined = re.sub(r'\\\n\s*', '', text)
            found += [line.split(' # ')[0].strip() for line in joined.splitlines()]
    commands = [line.removeprefix('$ ').removeprefix('.venv/bin/') for line in found]
    return [line for line in commands if re.match(r'(tactile|ros2|make) ', line)]


def typed_on_pages() -> list[str]:
    """The lines of all pages that begin with `tactile`."""
    return [line for page in PAGES for line in lines(page) if line.startswith('tactile ')]
