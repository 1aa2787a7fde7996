# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Pages stay short: words in all, and lengths of sentences (`make words` prints them)."""

from pathlib import Path

import pytest

from docs.count_words import Page, pages, read

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
