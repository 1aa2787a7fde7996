# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The whole package on one page: aims, escaped labels, drawings, a real browser."""

import functools
import json
import re
import sys
from collections.abc import Callable
from html import unescape
from pathlib import Path
from types import SimpleNamespace as Framed

import numpy as np
import pytest

from benchmarks.harness.package_page import (
    HEADLINES,
    SUMMARY_COLUMNS,
    Method,
    contests,
    front,
    headline,
    markdown,
    pareto,
    render_package,
)
from benchmarks.harness.rows import BenchFile, BenchResult, Row, gather, read_bench
from tactile_ros.cli.main import main
from tactile_ros.errors import MissingPackageError, TactileError
from tactile_ros.evaluation import figures
from tactile_ros.evaluation.figures import Plot, standalone, write_figures

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
        'position, unseen grid points', '**0.37**', 'mm', '0.6', '0.5', '≤ 0.36, missed',
        '`tactile bench reskin`',
    ]  # fmt: skip
    assert cells(lines[3])[1] == '**0.5** ± 0.02'
    assert len(missing) == len(HEADLINES) - 2


def test_readme_shows_rows_of_the_summary() -> None:
    section = README.read_text().split('## Results\n')[1].split('\n## ')[0]
    table = re.findall(r'^\| .* \|$', section, re.MULTILINE)
    rows = [cells(line) for line in table]
    assert rows[0] == list(SUMMARY_COLUMNS)
    shown = [(row[0], row[-1]) for row in rows[2:]]
    assert shown == [(words, f'`tactile bench {bench}`') for bench, _, words in HEADLINES]
    for row in rows[2:]:
        ours = float(row[1].split('**')[1].replace(',', '').replace('−', '-'))
        if aim := re.fullmatch(r'([≤≥]) ([\d.e−]+)(, missed)?', row[5]):
            limit = float(aim[2].replace('−', '-'))
            assert (ours <= limit if aim[1] == '≤' else ours >= limit) is not bool(aim[3]), row


HOSTILE = '<script>alert(1)</script> & "quotes" \'too\''
COMPARED = 'place, unseen points'


def rows() -> list[Row]:
    """Held and missed aims, three methods of one contest, figures without an aim."""
    return [
        Row('place: ridge', 'mm', 0.4, paper=0.5, peer=0.6, aim=0.5, us_single=60, us_batch=3,
            by_seed=(0.35, 0.4, 0.45), compared=COMPARED, method='ridge'),
        Row('  kNN', 'mm', 0.7, us_single=20, compared=COMPARED, method='kNN'),
        Row(f'  {HOSTILE}', 'mm', 0.9, us_single=90, compared=COMPARED, method=HOSTILE),
        Row('frames used', '%', 99.88, 'high', aim=99.9),
        Row('cells right', '%', 91.0, 'high', paper=95.0, aim=97.0),
        Row('nothing was measured', '1', None, aim=1.0),
    ]  # fmt: skip


@pytest.fixture
def results(tmp_path: Path) -> Path:
    """A folder with two results and a drawing."""
    folder = tmp_path / 'results'
    plot = Plot((0, 1), (0, 1), 'x', 'y', description=f'A map {HOSTILE}')
    plot.line(np.array([0.0, 1.0]), np.array([0.0, 1.0]), 'line c0')
    drawn = {'error_map': standalone(plot)}
    pad = BenchResult('magnet_pad', 'tactile bench magnet_pad', [1, 2], rows(), [HOSTILE], drawn)
    other = BenchResult('made_up', f'tactile bench {HOSTILE}', [0], rows()[4:])
    for result in (pad, other):
        result.write(folder)
        result.draw(folder)
    return folder


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('{"rows": [', 'is no result of a bench'),
        ('[]', 'rows must be list; received NoneType'),
        ('{"rows": [{"better": "low", "ours": "3"}]}', 'ours must be a number or null'),
        ('{"rows": [{"better": "low", "ours": NaN}]}', 'ours must be a number or null'),
        ('{"rows": [], "bench": 3}', 'bench must be str; received int'),
        ('[' * 100_000, 'is no result of a bench'),
    ],
)
def test_what_is_no_result_is_named_and_left_out(
    text: str, words: str, results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (results / 'bad.json').write_text(text)
    found, (problem,) = gather([results])
    assert len(found) == 2
    assert words in problem
    page = results / 'new' / 'page.html'
    assert main(['report', str(results), '-o', str(page), '--json']) == 1
    said = capsys.readouterr()
    assert 'left out: ' in said.err
    assert words in unescape(page.read_text())
    other, pad = json.loads(said.out)
    assert (pad['figures'], pad['aims'], pad['held'], pad['missed']) == (6, 3, 1, 2)
    assert other['what is missed'] == 'cells right'


REPLAYED = {
    'schema': 1, 'command': 'tactile replay a.mcap', 'environment': {'python': '3.11'},
    'recordings': [{'recording': 'a.mcap', 'sensor': 'thumb', 'answers': [
        {
            'estimator': 'ridge', 'calibration': f'{name}.npz', 'us_single': 50.0,
            'us_batch': None, 'targets': {
                'position': {'unit': 'm', 'mean': 4e-4, 'rms': 5e-4},
                'force_z': {'unit': 'N', 'mean': 0.1, 'rms': error},
            },
        } for name, error in (('one', 0.2), ('two', 0.3))
    ]}],
    'all': None, 'failed': {'b.mcap': f'b.mcap is no bag {HOSTILE}'},
}  # fmt: skip


def test_a_saved_replay_stands_beside_the_benches(results: Path) -> None:
    (results / 'mine.json').write_text(json.dumps(REPLAYED))
    found = read_bench(results / 'mine.json')
    what = ['a.mcap: position', 'a.mcap: force z']
    named = [f'{one}, ridge, one.npz' for one in what]
    assert [row.what for row in found.result.rows][:2] == named
    assert [row.ours for row in found.result.rows] == [0.4, 0.2, 0.4, 0.3]
    assert [contest.title for contest in contests(found.result.rows)] == what
    text = render_package(gather([results])[0], [], 'tactile report')
    assert '<h2>replay mine</h2>' in text
    assert f'left out: {REPLAYED["failed"]["b.mcap"]}' in unescape(text)
    assert '<script' not in text


@pytest.mark.parametrize(
    'broken', [{'recordings': 3}, {'recordings': [{'answers': 1}]}, {'failed': []}, {'command': 4}]
)
def test_a_broken_replay_is_named(broken: dict[str, object], results: Path) -> None:
    (results / 'mine.json').write_text(json.dumps({**REPLAYED, **broken}))
    found, problems = gather([results])
    assert len(found) + len(problems) == 3
    assert render_package(found, problems, 'tactile report')


def test_without_results_there_is_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['report', str(tmp_path / 'none')]) == 1
    (said,) = capsys.readouterr().err.splitlines()
    assert 'none does not exist; `tactile bench all` makes results' in said
    assert main(['report', str(tmp_path)]) == 1
    assert f'{tmp_path} holds no result of a bench' in capsys.readouterr().err


def test_results_are_read_back_and_their_page_is_escaped_and_fetches_nothing(
    results: Path,
) -> None:
    files, _ = gather([results])
    found = next(file for file in files if file.result.bench == 'magnet_pad')
    assert (found.result.rows, found.result.seed) == (rows(), [1, 2])
    (picture,) = found.pictures
    assert (picture.name, picture.description) == ('error map', f'A map {HOSTILE}')
    assert picture.size == (360, 270)
    text = render_package(files, [HOSTILE], f'tactile report {HOSTILE}')
    assert not re.findall('<(?:script|link|iframe|object)', text, re.IGNORECASE)
    fetched = re.findall(r'\s(?:src|href|on\w+)="?([^"\s>]*)', text)
    assert all(v.startswith(('#bench-', 'data:image/svg+xml;base64,')) for v in fetched)
    assert len(fetched) == 3
    assert 'nan' not in re.sub(r'base64,[^"]*', '', text)


def test_missed_aims_are_marked_and_held_ones_too(results: Path) -> None:
    files, _ = gather([results])
    text = render_package(files, [], 'tactile report')
    assert text.count('✗ missed') == 3
    assert '99.88 %' in text
    assert text.count('✓ held') == 1
    assert '0.4 ± 0.05' in text
    assert text.index('[2] Magnet pad') < text.index('made up')
    values = [(value, unit) for value, unit, _ in headline(files)]
    assert values == [('1', 'of 4'), ('3', ''), ('1', 'of 3'), ('1', 'of 1')]


def test_the_front_holds_whoever_nobody_beats_in_both() -> None:
    methods = [Method('slow', 9, 1, 0), Method('bad', 10, 2, 0), Method('fast', 1, 3, 0)]
    assert [m.name for m in front(methods)] == ['fast', 'slow']
    (contest,) = contests(rows())
    assert [m.name for m in contest.methods] == ['ridge', 'kNN', HOSTILE]
    figure = pareto(contest)
    assert figure.title == COMPARED
    assert 'ridge errs least (0.4 mm) at 60 µs; kNN is fastest (20 µs)' in figure.caption
    assert 'deviation over seeds' in figure.caption
    assert 'nan' not in standalone(*figure.plots)
    assert contests([*rows()[:1], *rows()[3:]]) == []


def test_the_highest_share_is_best_and_an_exact_method_is_drawn_too() -> None:
    shares = [
        Row('cells', '%', right, 'high', us_single=us, by_seed=(right - 1, right + 1),
            compared='cells', method=name)
        for name, right, us in (('slow', 97.0, 120.0), ('fast', 90.0, 60.0), ('bad', 80.0, 90.0))
    ]  # fmt: skip
    (contest,) = contests(shares)
    assert [m.name for m in front(contest.methods, contest.high)] == ['fast', 'slow']
    caption = 'slow is best (97 %) at 120 µs; fast is fastest (60 µs) and reaches 90 %. Up'
    assert caption in pareto(contest).caption
    assert 'nan' not in standalone(*pareto(contest).plots)
    exact = [
        Row('x', 'uT', 1e-3**i if i < 3 else 0.0, us_single=10.0**i, compared='c', method=f'm{i}')
        for i in range(4)
    ]
    figure = pareto(contests(exact)[0])
    assert 'm3 errs least (0 µT)' in figure.caption
    assert 'class="rule"' in standalone(*figure.plots)
    assert 'inf' not in standalone(*figure.plots)


def test_without_resvg_or_fonts_pictures_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = pytest.importorskip('resvg_py')
    blank = functools.partial(module.svg_to_bytes, skip_system_fonts=True)
    monkeypatch.setattr(module, 'svg_to_bytes', blank)
    with pytest.raises(MissingPackageError, match='pictures need a font'):
        figures.check_png()
    monkeypatch.setitem(sys.modules, 'resvg_py', None)
    with pytest.raises(MissingPackageError, match='pip install resvg-py'):
        list(write_figures(tmp_path, [pareto(contests(rows())[0])]))


@pytest.mark.parametrize('inside', ['<image href="/etc/x.png"/>', '<rect'])
def test_drawings_that_are_none_or_hold_other_files_are_refused(
    tmp_path: Path, inside: str
) -> None:
    pytest.importorskip('resvg_py')
    svg = f'<svg xmlns="http://www.w3.org/2000/svg" width="9" height="9">{inside}</svg>'
    with pytest.raises(TactileError, match=r'x\.png'):
        figures.write_png(tmp_path / 'x.png', svg)


@pytest.mark.parametrize('width', [390, 1200])
def test_a_browser_shows_the_page(
    results: Path, framed: Callable[[str, int], Framed], width: int
) -> None:
    files, _ = gather([results])
    seen = framed(render_package(files, [], 'tactile report'), width)
    assert seen.wide == seen.window == width
    assert seen.images == 1
    assert width < 1200 or seen.cut == 0
    assert seen.complaints == ''


def test_pictures_have_two_pixels_for_each_of_the_drawing(tmp_path: Path) -> None:
    pytest.importorskip('resvg_py')
    (picture,) = write_figures(tmp_path / 'png', [pareto(contests(rows())[0])])
    head = picture.read_bytes()[:24]
    assert picture.name == 'place_unseen_points.png'
    assert head[:8] == b'\x89PNG\r\n\x1a\n'
    assert (int.from_bytes(head[16:20], 'big'), int.from_bytes(head[20:], 'big')) == (1024, 836)
