# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Site of the documentation: built strictly, with pages made from interfaces and docstrings."""

import subprocess
import sys
from pathlib import Path

import pytest

from docs import site_pages

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope='module')
def made() -> dict[str, str]:
    return site_pages.made_pages()


def test_site_is_built_without_a_broken_link(tmp_path: Path) -> None:
    pytest.importorskip('mkdocs', reason='the site is built where the test packages are')
    command = [sys.executable, '-m', 'mkdocs', 'build', '--quiet', '--strict', '-d', str(tmp_path)]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    api = (tmp_path / 'api.html').read_text()
    assert 'Pipeline.process_batch' in api


def test_every_page_is_in_the_navigation(made: dict[str, str]) -> None:
    text = (ROOT / 'mkdocs.yml').read_text()
    names = {path.name for path in (ROOT / 'docs').glob('*.md')} | set(made)
    assert [name for name in sorted(names) if f': {name}\n' not in text] == []


def test_reference_has_every_interface_and_parameter(made: dict[str, str]) -> None:
    page = made['ros_reference.md']
    for folder in ('msg', 'srv', 'action'):
        for path in (ROOT / folder).iterdir():
            assert f'### {path.stem}' in page
    assert '| tare_frames | `10` | (1, 10000) | frames that a tare averages |' in page
    assert '| `pixel_gap`' in page or '| `gap`' in page
    assert '| `friction_low` | `0.6` | 1 | (0.01, 5) |' in page  # of the law of a grip
    assert '| `bus_clock` | `400000` |' in page  # of the connection


def test_results_are_the_golden_figures_of_today() -> None:
    page = (ROOT / 'docs' / 'results.md').read_text()
    assert page == site_pages.results(), 'python docs/site_pages.py writes it anew'
    for bench in ('reskin', 'gradiometer', 'grasp'):
        assert f'## {bench}' in page
    assert '| held |' in page
    assert '| **missed** |' in page
