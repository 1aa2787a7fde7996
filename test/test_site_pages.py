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
    assert 'Pipeline.process_batch' in (tmp_path / 'api.html').read_text()


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
    files = [*ROOT.glob('msg/*'), *ROOT.glob('srv/*'), *ROOT.glob('action/*')]
    assert [path for path in files if f'### {path.stem}' not in page] == []
    assert '| tare_frames | `10` | (1, 10000) | frames that a tare averages |' in page
    assert '| most_lost | `0.05` | (0.0, 1.0) |' in page  # a field of another class
    assert '### Options' not in page  # the class that others inherit
    assert '| `friction_low` | `0.6` | 1 | (0.01, 5) |' in page  # of the law of a grip


def test_results_are_the_golden_figures_of_today() -> None:
    assert (ROOT / 'docs' / 'results.md').read_text() == site_pages.results()


def test_figures_on_pages_are_golden_ones() -> None:
    assert site_pages.stale_figures() == []


MOST_WORDS = 20_000
MOST_MEAN = 17.0
LONGEST = 40
MOST_OF = {'README.md': 700, 'CHANGELOG.rst': 600}
PAGES = pages()


def test_all_pages_have_at_most_so_many_words() -> None:
    assert sum(page.words for page in PAGES.values()) <= MOST_WORDS
    assert [name for name, most in MOST_OF.items() if PAGES[name].words > most] == []


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
