# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""`tactile compare` as a user meets it."""

import json
from pathlib import Path

import pytest

from tactile_ros.cli.compare import last_names
from tactile_ros.cli.main import main

ON = ['--on', 'presses.npz']
pytestmark = pytest.mark.usefixtures('there')


def test_calibrations_are_compared(capsys: pytest.CaptureFixture[str]) -> None:
    found = []
    for seed in ((), ('--seed', '0')):
        assert main(['compare', 'a.npz', 'b.npz', *ON, '--json', *seed]) == 0
        found += json.loads(capsys.readouterr().out)
    row, again = found
    assert (row['compared'], row['figure']) == ('a.npz and b.npz', 'position mean (mm)')
    assert 0 < row['low'] < row['difference'] < row['high']
    assert row['p'] < 0.05
    assert row == again


@pytest.mark.parametrize('name', ['out/page.html', 'drawing.svg'])
def test_a_page_or_a_drawing_is_written(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name = str(tmp_path / name)
    files = [str(Path(one).resolve()) for one in ('a.npz', 'b.npz')]
    words = ['compare', *files, *ON, '-o', name]
    assert main(words) == 0
    assert 'permutation test that swaps both estimates' in capsys.readouterr().out
    assert ': b.npz against a.npz' in Path(name).read_text()
    Path(name).write_text('mine')
    assert main(words) == 1
    assert Path(name).read_text() == 'mine'
    assert main([*words, '--overwrite']) == 0
    assert main(words) == 0


def test_names_are_as_long_as_they_must_be() -> None:
    assert [*last_names(['o/a.npz', '/n/a.npz', 'x']).values()] == ['o/a.npz', 'n/a.npz', 'x']
    assert last_names(['a.npz', './a.npz']) == {'a.npz': 'a.npz', './a.npz': './a.npz'}


@pytest.mark.parametrize(
    ('words', 'code', 'why'),
    [
        (['a.npz', 'b.npz'], 2, 'name the recordings to compare on'),
        (['a.npz'], 2, 'two competitors or more'),
        (['a.npz', 'a.npz', *ON], 2, 'each once'),
        (['a.npz', './a.npz', *ON], 2, 'each once'),
        (['a.npz', 'presses.npz', *ON], 1, 'received none (a recording?)'),
        (['a.npz', 'mean', *ON], 2, 'mean is no file and no estimator of'),
        (['ridge', 'grid_knn', *ON], 2, 'add --sensor'),
        (['a.npz', 'gone.npz', *ON], 1, 'gone.npz does not exist'),
        (['a.npz', 'b.npz', '--on', 'nowhere'], 1, 'nowhere does not exist'),
        (['a.npz', 'b.npz', *ON, './presses.npz'], 2, 'each recording once'),
        (['a.npz', 'b.npz', *ON, '-o', 'a.pdf'], 2, 'must end in .html or .svg'),
        (['a.npz', 'b.npz', *ON, '--seed', '-1'], 2, '--seed must be 0 or more'),
    ],
)
def test_wrong_use_is_refused_in_a_sentence(
    words: list[str], code: int, why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['compare', *words]) == code
    said = capsys.readouterr().err
    assert why in said
    assert said.count('\n') == 1
