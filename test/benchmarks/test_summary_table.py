from __future__ import annotations

import re
from pathlib import Path

from benchmarks.harness.package_page import HEADLINES, SUMMARY_COLUMNS, markdown
from benchmarks.harness.rows import BenchFile, BenchResult, Row

README = Path(__file__).parents[2] / 'README.md'


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip('|').split('|')]


def test_rows_are_found_by_their_beginnings_and_misses_are_marked() -> None:
    rows = [
        Row('place, held-out grid points, last pass: ridge', 'mm', 0.5, by_seed=(0.48, 0.5, 0.52)),
        Row('place, held-out grid points: ridge', 'mm', 0.37, paper=0.5, peer=0.6, aim=0.36),
    ]
    found = BenchFile(BenchResult('reskin', 'tactile bench reskin', [0], rows), {}, ())
    lines, missing = markdown([found])
    assert len(lines) == 4
    assert cells(lines[2]) == [
        'boards', 'place, unseen grid points', 'mm', '0.5', '0.6', '**0.37**', '',
        '≤ 0.36, missed', '',
    ]  # fmt: skip
    assert cells(lines[3])[5] == '**0.5** ± 0.02'
    assert len(missing) == len(HEADLINES) - 2


def test_the_table_of_the_readme_is_this_one() -> None:
    table = re.findall(r'^\| .* \|$', README.read_text().split('## Results')[1], re.MULTILINE)
    rows = [cells(line) for line in table]
    assert rows[0] == list(SUMMARY_COLUMNS)
    assert [(row[0], row[1]) for row in rows[2:]] == [(h.of, h.words) for h in HEADLINES]
    for row in rows[2:]:
        ours = float(row[5].split('**')[1].replace(',', '').replace('−', '-'))
        if aim := re.fullmatch(r'([≤≥]) ([\d.e−]+)(, missed)?', row[7]):
            limit = float(aim[2].replace('−', '-'))
            assert (ours <= limit if aim[1] == '≤' else ours >= limit) is not bool(aim[3]), row
