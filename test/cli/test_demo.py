# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""`tactile demo`: parts that share no group, its folder, and twins through the real graph."""

import re
import shutil
import sys
import time
from concurrent.futures import Future
from contextlib import suppress
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from tactile_ros.cli import demo
from tactile_ros.cli.main import main
from tactile_ros.errors import TactileError
from tactile_ros.evaluation.recording_files import load
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import SensorSpec, load_sensor


def test_parts_share_no_group() -> None:
    place, normal, shear = demo.parts(seed=0)
    for part, key in ((place, 'position'), (normal, 'session'), (shear, 'repetition')):
        seen = {str(x) for x in part.train.truth[key][~part.train.tare]}
        played = {str(x) for x in part.played.truth[key][~part.played.tare]}
        assert played
        assert not seen & played, part.name
        assert part.played.tare[0]


def test_time_left_is_that_of_fits_like_those_that_are_made() -> None:
    made, open_ = Future(), Future()
    made.set_result(Path())
    now = time.monotonic()
    assert demo.time_left([open_], [open_], now, now) == 0.0
    assert demo.time_left([made, open_], [open_], now - 10.0, now) == pytest.approx(10.0, abs=2.0)


def test_results_replace_only_what_a_demo_made(tmp_path: Path) -> None:
    for name in ('bags', 'mine'):
        (tmp_path / name).mkdir()
        (tmp_path / name / 'file').write_text('x')
    before = sorted(tmp_path.rglob('*'))
    with (
        pytest.raises(TactileError, match='holds files and no demo made it'),
        demo.results(tmp_path, overwrite=False),
    ):
        pytest.fail('taken')
    assert sorted(tmp_path.rglob('*')) == before
    for number in ('1', '2'):  # what stops half way changes nothing
        with suppress(ZeroDivisionError), demo.results(tmp_path, overwrite=True) as made:
            (made / 'bags').mkdir()
            1 / 0  # noqa: B018
        with demo.results(tmp_path, overwrite=number == '1') as made:
            (made / 'bags').mkdir()
            (made / 'bags' / 'file').write_text(number)
            (made / 'report.html').write_text(number)
        assert (tmp_path / 'bags' / 'file').read_text() == number
        assert (tmp_path / 'report.html').read_text() == number
        names = {path.name for path in tmp_path.iterdir()}
        assert names == {'bags', 'mine', 'report.html', demo.MARK}


def test_demo_leaves_no_folder_where_it_cannot_begin(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = ['--output', str(tmp_path / 'out')]
    assert main(['demo', '--sensor', 'none', *out]) == 2
    assert 'sensor must be one of' in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, 'mujoco', None)
    assert main(['demo', 'grasp', *out]) == 1
    assert 'simulated hands need MuJoCo: pip install mujoco' in capsys.readouterr().err
    assert not (tmp_path / 'out').exists()


def apart(said: str) -> float:
    """Largest difference of replay and live contacts."""
    (found,) = re.findall(r'replay and live contacts differ by at most (\S+)', said)
    return float(found)


@pytest.mark.ros
def test_a_twin_goes_through_the_real_graph(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(demo, 'MOST_ROWS', 300)
    monkeypatch.setattr(demo, 'run_twin', partial(demo.run_twin, seconds=4.0))
    monkeypatch.chdir(tmp_path)
    assert main(['demo', '--sensor', 'taxel_array']) == 0
    said, made = capsys.readouterr().out, Path('out') / 'demo' / 'taxel_array'
    assert 'what it does in that world alone' in said
    assert apart(said) < 1e-9  # objects are placed: a descent passes rounding on
    loaded = load(made / 'bags' / 'taxel_array').recordings[0]
    assert loaded.name == 'taxel_array'
    truth, live = loaded.recording.truth, loaded.contacts
    assert np.count_nonzero(truth['in_contact'] == 1) > 10  # of 4 s in which presses fill 2.3
    assert set(np.unique(truth['session'])) <= {-1, 0}
    assert np.isfinite(truth['force'][:, 2]).mean() > 0.9
    assert set(np.unique(truth['label'])) == {-1, 0, 1}
    held = (truth['label'] >= 0)[live.rows]
    assert (live.states.label == truth['label'][live.rows])[held].mean() > 0.9
    assert '<svg' in (made / 'report.html').read_text()


@pytest.mark.ros
def test_a_new_head_is_taught_while_the_twin_of_a_skin_plays(
    tmp_path: Path, taught_skin: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def of_presses(spec: SensorSpec, _: int, path: Path) -> Pipeline:
        """Heads by presses alone: their templates take longer than all the rest."""
        path.parent.mkdir()
        shutil.copyfile(taught_skin, path)
        return spec.load(path)

    monkeypatch.setattr(demo, 'fit_twin', of_presses)
    heard: list[str] = []
    spec = load_sensor('multipole_skin')
    result, shown = demo.run_twin(spec, tmp_path, 0, heard.append, 11.0)
    assert any("enrolling it as 'bar_20x6'" in line for line in heard)
    # frames that waited are estimated together, as many as waited
    assert apart('\n'.join(result.sentences)) < 1e-12
    assert re.search('bar_20x6 after it: [1-9].* windows named rightly', '\n'.join(shown))
    loaded = load(tmp_path / 'bags' / 'multipole_skin').recordings[0]
    (change,) = loaded.changes
    assert change.label == 'bar_20x6'
    live, stamps = loaded.contacts, loaded.recording.stamp_ns
    since = stamps[live.rows] > change.after_ns
    truth, named = loaded.recording.truth['label'][live.rows], live.states.label
    new = len(spec.config().objects)
    assert not (named[~since] == new).any()
    assert (named[since & (truth == new)] == new).sum() >= 2
