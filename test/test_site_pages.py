# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Site and words of the documentation."""

import subprocess
import sys
from pathlib import Path

import pytest

from docs import site_pages
from docs.count_words import Page, pages, read
from docs.images import draw_diagrams, draw_measured

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


def test_every_page_is_in_the_navigation_and_has_a_picture(made: dict[str, str]) -> None:
    text = (ROOT / 'mkdocs.yml').read_text()
    pages = {path.name: path.read_text() for path in (ROOT / 'docs').glob('*.md')} | made
    assert [name for name in sorted(pages) if f': {name}\n' not in text] == []
    assert [name for name, page in pages.items() if '![' not in page] == []


def test_pictures_are_those_of_their_scripts() -> None:
    for name, drawing in (draw_diagrams.DRAWINGS | draw_measured.drawings()).items():
        path = ROOT / 'docs' / 'images' / f'{name}.svg'
        assert path.read_text() == drawing, 'the scripts of docs/images draw it anew'


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


MOST_WORDS = 20_000
MOST_MEAN = 18.0
LONGEST = 40
PAGES = pages()


def test_all_pages_have_at_most_so_many_words() -> None:
    assert sum(page.words for page in PAGES.values()) <= MOST_WORDS


@pytest.mark.parametrize(('name', 'page'), PAGES.items(), ids=PAGES)
def test_sentences_of_a_page_are_short(name: str, page: Page) -> None:
    assert page.mean <= MOST_MEAN
    longest = max(page.sentences, key=lambda sentence: len(sentence.split()))
    assert max(page.lengths) <= LONGEST, longest


def test_a_page_is_counted_without_code_and_its_tables_have_no_sentences(tmp_path: Path) -> None:
    path = tmp_path / 'page.md'
    path.write_text(
        '# A title\n\nTwo words. Then [three more](link.md)\nby `Eq. 5`, see Eq. 5.\n\n'
        '| a | b |\n|---|---|\n| one | two words |\n\n```\nnot counted\n```\n\n'
        '- one item\n1. another\n'
    )
    page = read(path)
    assert page.lengths == [2, 9, 2, 1]
    assert page.words == 2 + 2 + 9 + 2 + 3 + 2 + 2
