# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Python as people write it: the page's example, what `load` finds, and bags on their tares."""

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import tactile_ros as tr
from benchmarks.replay import write_bag
from reference.help_examples import ROOT, blocks
from tactile_ros.errors import MissingPackageError, RecordingError
from tactile_ros.evaluation.recording_files import load_recording
from tactile_ros.notebook import BagRecording, Calibration
from tactile_ros.sensors import load_sensor

STEP_NS = 10_000_000


@pytest.fixture(scope='module')
def presses() -> tr.Recording:
    """Places at one edge of the pad, each with its tare row."""
    spatial = tr.sensor('reskin_board').recordings()['spatial']
    rows = np.flatnonzero(~spatial.tare & (spatial.truth['position'][:, 0] > 0.0115))
    return spatial.select(np.sort(np.r_[rows - 1, rows]))


@pytest.fixture(scope='module')
def board(presses: tr.Recording) -> Calibration:
    return tr.sensor('reskin_board').fit(presses, estimator='ridge')


@pytest.fixture(scope='module')
def bag(
    presses: tr.Recording, board: Calibration, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """A live run of two hundred frames, tared at the tenth."""
    part = presses.select(slice(0, 200))
    rows = np.arange(len(part))
    part = replace(part, stamp_ns=STEP_NS * (1 + rows), sequence=rows, stream=None, tare=None)
    path = tmp_path_factory.mktemp('bags') / 'pressed'
    write_bag(path, board, replace(part, truth={'position': part.truth['position']}))
    return path


def test_import_is_cheap_and_offers_what_it_names() -> None:
    code = (
        'import sys, tactile_ros as tr; assert "numpy" not in sys.modules;'
        'assert set(tr.__all__) < set(dir(tr)); print([getattr(tr, n) for n in tr.__all__]);'
        'from tactile_ros import *; from tactile_ros import messages; load, sensor, Recording'
    )
    subprocess.run([sys.executable, '-c', code], check=True, capture_output=True)
    assert 10 <= len(tr.__all__) <= 14
    assert (ROOT / 'tactile_ros' / 'py.typed').is_file()
    with pytest.raises(AttributeError, match='sensors_of'):
        _ = tr.sensors_of


def test_example_of_the_page_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = ROOT / 'docs' / 'python_api.md'
    text, live = (text for language, text in blocks(page) if language == 'python')
    assert text.count('\n') <= 20
    monkeypatch.chdir(tmp_path)
    exec(compile(text, page.name, 'exec'), made := {})
    sensor = made['sensor']
    with sensor.simulate(sensor.config(), sensor.connection()) as twin:
        monkeypatch.setattr(type(sensor), 'open', lambda *about: twin.device(about[-1]))
        exec(compile(live, page.name, 'exec'), made)
    *said, force = capsys.readouterr().out.splitlines()
    assert force.startswith('[')
    assert said[0] == said[-1] == 'Calibration(reskin_board, 5 x 3; force by ridge)'
    assert (tmp_path / 'normal_2.svg').read_text().count('Normal force') == 2


def test_report_prints_its_table_and_draws(
    board: Calibration, presses: tr.Recording, tmp_path: Path
) -> None:
    report = board.evaluate(presses, presses.select(slice(0, 100)))
    lines = str(report).splitlines()
    assert lines[0].startswith('recording')
    assert [line.split('  ')[0] for line in lines[2:4]] == ['recording 1', 'recording 2']
    assert repr(report).startswith('Result(recording 1, recording 2: Is something touching?')
    assert re.search(r'; 0 of \d+ frames lost\)$', repr(report))
    assert re.search(r'; \S+ mm mean error of place', repr(report))
    assert '\n' not in repr(report)
    for none in ((), ('x.npz',), (presses, {'a': presses})):
        for use in (board.evaluate, board.fit, tr.sensor('reskin_board').fit):
            with pytest.raises(ValueError, match='at least one Recording, none other; received'):
                use(*none)
    with pytest.raises(ValueError, match='received None'):
        tr.sensor(None)
    drawing = report.plot()
    assert 'Where on the pad it errs' in repr(drawing)
    assert drawing._repr_html_().startswith('<img alt="Drawing(')
    assert drawing.svg == drawing.save(tmp_path / 'a.svg').read_text()
    with pytest.raises(ValueError, match=r'must end in .svg or .png'):
        drawing.save(tmp_path / 'a.pdf')


def test_dataframe_has_a_row_for_each_error(
    board: Calibration, presses: tr.Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, 'pandas', SimpleNamespace(DataFrame=dict))
    report = board.evaluate(presses)
    found = report.to_dataframe()
    (place,) = report.datasets[0].answers[0].targets
    across = found['target'] == 'position_x'
    assert {len(column) for column in found.values()} == {2 * len(place.rows)}
    np.testing.assert_array_equal(found['error'][across], place.error[:, 0])
    np.testing.assert_allclose(found['sigma'][across] ** 2, place.variance[:, 0])
    assert dict.fromkeys(found['recording']) == {'recording 1': None}
    monkeypatch.setitem(sys.modules, 'pandas', None)
    with pytest.raises(MissingPackageError, match='needs pandas: pip install pandas'):
        report.to_dataframe()


def test_batch_of_a_bag_heeds_the_tares_of_its_run_or_says_that_it_does_not(
    bag: Path, board: Calibration, presses: tr.Recording
) -> None:
    recording = tr.load(bag)
    assert isinstance(recording, BagRecording)
    states = board.process_batch(recording)
    live = recording.run.contacts
    np.testing.assert_array_equal(live.rows, np.arange(200))
    np.testing.assert_allclose(states.position, live.states.position, rtol=0, atol=1e-12)
    untared = board.process_batch(recording.select(slice(None)))
    assert np.nanmax(np.abs(untared.position - states.position)) > 1e-6
    report = board.evaluate(recording)
    assert report.datasets[0].agreement.largest < 1e-9
    assert 'pressed: replay and live contacts differ by at most' in str(report)
    untold = replace(recording)
    assert untold.run is None  # a copy is a recording like any other
    object.__setattr__(untold, 'run', replace(recording.run, baselines=()))
    with pytest.warns(UserWarning, match='pressed has no tare of its run'):
        board.process_batch(untold)
    without = replace(presses, tare=None, truth={'position': presses.truth['position']})
    restless = tr.sensor('reskin_board').fit(without, estimator='grid_knn')
    with pytest.warns(UserWarning, match='tares of pressed are left out'):
        restless.process_batch(recording)


def test_load_decides_from_what_there_is(
    bag: Path, board: Calibration, presses: tr.Recording, tmp_path: Path
) -> None:
    board.save(tmp_path / 'board.npz')
    assert isinstance(tr.load(tmp_path / 'board.npz'), Calibration)
    assert repr(tr.load(tmp_path / 'board.npz')) == repr(board)
    own = Calibration.of(board)
    own.sensor = 'my_pad'
    own.save(tmp_path / 'own.npz')
    with pytest.raises(tr.TactileError, match=r"own.npz is of sensor 'my_pad'.*TACTILE_SENSORS"):
        tr.load(tmp_path / 'own.npz')
    (tmp_path / 'own.npz').unlink()
    places = {'position': 1e3 * presses.truth['position']}
    tr.save_recording(replace(presses, truth=places), tmp_path / 'mm.npz')
    with pytest.warns(UserWarning, match='mm: 620 true places are far outside of the taxels'):
        tr.load(tmp_path / 'mm.npz')
    with pytest.warns(UserWarning, match='^620 true places are far outside'):
        tr.sensor('reskin_board').fit(replace(presses, truth=places), estimator='grid_knn')
    (tmp_path / 'mm.npz').unlink()
    tr.save_recording(presses, tmp_path / 'presses.npz')
    with pytest.raises(tr.TactileError, match=r'board.npz is a file of another kind'):
        tr.save_recording(presses, tmp_path / 'board.npz')
    with pytest.raises(tr.TactileError, match=r'presses.npz is a file of another kind'):
        board.save(tmp_path / 'presses.npz')
    with pytest.raises(RecordingError, match=r'board.npz is a calibration, no recording'):
        load_recording(tmp_path / 'board.npz')
    tr.save_recording(presses, tmp_path / 'presses.npz')
    assert repr(tr.load(tmp_path / 'presses.npz')) == repr(presses)
    (tmp_path / 'bag').symlink_to(bag)
    (tmp_path / 'notes.txt').write_text('none of ours')
    assert list(tr.load(tmp_path)) == ['bag', 'presses']
    (tmp_path / 'broken').mkdir()
    (tmp_path / 'broken' / 'a.mcap').write_bytes(b'')
    with pytest.warns(UserWarning, match='left out: .*broken holds no frames'):
        assert list(tr.load(tmp_path)) == ['bag', 'presses']
    names = [f'{axis}_{i}' for i in range(5) for axis in ('Bx', 'By', 'Bz')]
    (tmp_path / 'a.csv').write_text(f'{",".join(names)}\n{",".join("0" * 15)}\n')
    assert len(tr.load(tmp_path / 'a.csv', sensor='reskin_board')) == 1


@pytest.mark.parametrize('name', ['missing.npz', 'missing', 'foreign.npz', 'empty', 'table.csv'])
def test_load_refuses_in_one_sentence(name: str, tmp_path: Path) -> None:
    np.savez(tmp_path / 'foreign.npz', a=np.zeros(3))
    (tmp_path / 'empty').mkdir()
    (tmp_path / 'table.csv').write_text('a,b\n1,2\n')
    with pytest.raises(tr.TactileError) as refused:
        tr.load(tmp_path / name)
    assert name in str(refused.value)
    assert '\n' not in str(refused.value)


def test_fit_takes_the_chips_of_a_recording_or_refuses_it(presses: tr.Recording) -> None:
    sensor = tr.sensor('reskin_board')
    with pytest.raises(RecordingError, match=r'nothing can be learned .* truth has nothing'):
        sensor.fit(replace(presses, truth={}))
    counts = replace(presses, values=1e6 * np.sign(presses.values))
    reached = f'{len(counts)} rows at or above `saturation` \\['
    with pytest.raises(RecordingError, match=rf'rows: truth has .*; left out: {reached}'):
        sensor.fit(counts)
    with pytest.raises(RecordingError, match=r'learned from 1 rows: .*\w$'):
        sensor.fit(presses.select(slice(0, 1)))
    with pytest.raises(ValueError, match='at least one Recording'):
        sensor.fit()
    shear = sensor.recordings()['shear'].select(slice(0, 400))
    assert sensor.fit(shear, estimator='ridge').layout.shape == (10, 3)


def test_what_is_looked_at_is_a_short_line(board: Calibration, presses: tr.Recording) -> None:
    state = board.process(presses.frame(1))
    shown = (tr.sensor('gradiometer'), board, presses, presses.frame(1), presses.layout, state)
    shown += (board.process_batch(presses), tr.sensor('gradiometer').pipeline())
    for thing in shown:
        assert '\n' not in repr(thing)
        assert len(repr(thing)) < 250
    assert isinstance(float(state.force[2]), float)
    assert len(state.as_dict()['position']) == 3


def test_pipelines_of_the_public_face_stay_what_they_are(
    board: Calibration, presses: tr.Recording, tmp_path: Path
) -> None:
    board.save(tmp_path / 'board.npz')
    plain = load_sensor('reskin_board').load(tmp_path / 'board.npz')
    assert type(plain).__name__ == 'Pipeline'
    assert plain.digest == board.digest
    both = (one.process_batch(presses).position for one in (plain, board))
    np.testing.assert_array_equal(*both)
