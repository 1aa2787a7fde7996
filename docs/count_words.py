# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Words and sentences of the pages, without code blocks; tables have words, but no sentences."""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
CODE = re.compile(r'^```.*?^```$|<!--.*?-->', re.DOTALL | re.MULTILINE)
TARGET = re.compile(r'!?\[([^\]]*)\]\([^)]*\)')  # of a link or picture; its text stays
TAG = re.compile(r'<[^>\n]+>')
WORD = re.compile(r'\S*[^\W_]\S*')
BLOCK = re.compile(r'(?:[-*+]|\d+\.)\s+')  # begins an item
ABBREVIATED = re.compile(r'\b(Eqs?|Figs?|Sec|Tab|al|vs|e\.g|i\.e|approx)\.(?=\s)')
END = re.compile(r'(?<=[.!?])[)\'"*_]*\s+(?=[^a-z\s])')


@dataclass(frozen=True)
class Page:
    """Number of words of a page, and its sentences."""

    words: int
    sentences: tuple[str, ...]

    @property
    def lengths(self) -> list[int]:
        """Number of words of each sentence."""
        return [len(WORD.findall(sentence)) for sentence in self.sentences]

    @property
    def mean(self) -> float:
        """Mean number of words of a sentence."""
        return sum(self.lengths) / max(len(self.lengths), 1)


def prose(text: str) -> list[str]:
    """Paragraphs and items of a text without headings and tables, each in one line."""
    blocks = ['']
    for line in map(str.strip, text.splitlines()):
        underlined = len(line) > 2 and not line.strip('=-~^')
        if underlined or not line or line[0] in '#|':
            if underlined:
                blocks[-1] = ''  # the line before is a heading
            blocks.append('')
            continue
        if BLOCK.match(line):
            blocks.append('')
        blocks[-1] += f' {BLOCK.sub("", line, count=1) if BLOCK.match(line) else line}'
    return [block.strip() for block in blocks if WORD.search(block)]


def read(path: Path) -> Page:
    """Words and sentences of a page in Markdown or reStructuredText."""
    text = TAG.sub(' ', TARGET.sub(r'\1', CODE.sub('\n', path.read_text(encoding='utf-8'))))
    blocks = [ABBREVIATED.sub(r'\1', block) for block in prose(text)]
    sentences = [part for block in blocks for part in END.split(block) if WORD.search(part)]
    return Page(len(WORD.findall(text)), tuple(sentences))


def pages() -> dict[str, Page]:
    """All pages but the glossary and the tables of results, by their paths in the repository."""
    paths = [ROOT / name for name in ('README.md', 'CHANGELOG.rst', 'CONTRIBUTING.md')]
    paths += sorted((ROOT / 'docs').rglob('*.md'))
    read_by_name = {path.relative_to(ROOT).as_posix(): read(path) for path in paths}
    left_out = ('docs/glossary.md', 'docs/results.md')
    return {name: page for name, page in read_by_name.items() if name not in left_out}


if __name__ == '__main__':
    found = pages()
    rows = [f'{"page":34}{"words":>7}{"mean":>7}{"longest":>9}']
    for name, page in found.items():
        rows.append(f'{name:34}{page.words:7}{page.mean:7.1f}{max(page.lengths, default=0):9}')
    rows.append(f'{"total":34}{sum(page.words for page in found.values()):7}')
    sys.stdout.write('\n'.join(rows) + '\n')
