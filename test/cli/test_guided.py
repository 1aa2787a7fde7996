# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""`tactile calibrate --live` with a simulated sensor that presses itself, and its sources."""

import json
import re
import time
from pathlib import Path
from threading import Event
from urllib.request import urlopen

import numpy as np
import pytest

from tactile_ros.cli import guided
from tactile_ros.cli.guided import Folder, Judge, Scale, SimulatedPresses, Weights, read_plan
from tactile_ros.cli.main import main
from tactile_ros.devices.simulated_serial import SimulatedSerialPort
from tactile_ros.errors import RecordingError
from tactile_ros.evaluation.fleet import open_calibration
from tactile_ros.evaluation.guided import Phase, PressGuide, Target
from tactile_ros.evaluation.recording_files import load, load_recording
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.types import ContactStates, Layout, Recording

LAYOUT = Layout(np.zeros((2, 3)), ('output',), '1')
COMMAND = [
    'calibrate', '--live', '--sensor', 'reskin_board', '--page', '0', '--presses', '6', '--hold',
    '0.2', '--estimator', 'ridge', '-o', 'my.npz',
]  # fmt: skip


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.slow
def test_live_goes_on_after_an_interrupt_and_writes_everything(
    home: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    seen: list[dict[str, object]] = []
    write, log = Folder.write, guided.Session.log

    def interrupted(self: Folder, count: int, press: object) -> None:
        write(self, count, press)  # type: ignore[arg-type]
        if count == 2:
            raise KeyboardInterrupt

    def watched(self: guided.Session, text: str) -> None:
        if ': press' in text and not seen:
            with urlopen(f'{self.page.address}state.json') as answer:
                seen.append(json.load(answer)['guide'])
        log(self, text)

    monkeypatch.setattr(Folder, 'write', interrupted)
    assert main(COMMAND) == 130
    monkeypatch.setattr(Folder, 'write', write)
    monkeypatch.setattr(guided.Session, 'log', watched)
    assert main(COMMAND) == 0
    printed = capsys.readouterr()
    assert 'going on after 2 presses' in printed.err
    errors = r'error on places held out: place .* N \(RMS of [0-9]+ presses\)'
    assert re.search(errors, printed.err)
    assert 'held out in the table: frames' in printed.err
    assert 'force_xyz' in printed.out
    (told,) = seen
    assert 'uniform field at rest' in str(told['error'])
    assert [one[2] for one in told['targets']] == [1, 1, 0, 0, 0, 0]  # type: ignore[attr-defined]
    pipeline = open_calibration('my.npz')
    assert {'position', 'force'} <= pipeline.estimators.keys()
    presses = load_recording('my/presses.npz')
    (bag,) = load(next((home / 'my').glob('bag_*'))).recordings
    np.testing.assert_array_equal(bag.recording.values, presses.values)
    assert 'every fourth place, held out' in (home / 'my' / 'report.html').read_text()
    # another session does not take its place
    assert main([*COMMAND, '--hold', '0.3']) == 1
    assert 'a session with other options' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (['--live', '-o', 'a.npz'], 'calibrate needs a sensor'),
        (['--live', 'my.npz', 'b.npz', '-o', 'a.npz'], 'calibrate needs a sensor'),
        (['--live', '--sensor', 'reskin_board', '--port', 'x', '--truth', 'weights:0', '-o',
          'a.npz'],
         'weights must be grams'),
        (['--live', '--sensor', 'reskin_board', '--port', 'x', '--truth', 'lead', '-o', 'a.npz'],
         '--truth of --live must be prompts'),
        (['--live', '--sensor', 'reskin_board', '--port', 'x', '--plan', 'no.csv', '-o', 'a.npz'],
         'no.csv'),
        (['--live', '--sensor', 'reskin_board', '-o', 'a'], '-o must end in .npz'),
        (['--live', '--sensor', 'reskin_board', '--presses', '0', '-o', 'a.npz'], '--presses'),
        (['--live', '--sensor', 'reskin_board', '--hold', 'inf', '-o', 'a.npz'], '--hold'),
        (['--live', '--sensor', 'reskin_board', '--goal-mm', 'nan', '-o', 'a.npz'], '--goal-mm'),
        (['--live', '--sensor', 'reskin_board', '--page', '99999', '-o', 'a.npz'], '--page'),
        (['--live', '--sensor', 'reskin_board', '--plan', 'no.csv', '-o', 'a.npz'], 'need --port'),
        (['--live', '--sensor', 'reskin_board', '--truth', 'weights:5', '-o', 'a.npz'],
         '--truth, --plan and --pose need --port'),
    ],
)  # fmt: skip
def test_live_refuses_what_it_cannot_do(
    home: Path, capsys: pytest.CaptureFixture[str], words: list[str], said: str
) -> None:
    assert main(['calibrate', *words]) in (1, 2)
    assert said in capsys.readouterr().err
    assert not list(home.iterdir())


def test_plan_names_places_and_loads(tmp_path: Path) -> None:
    file = tmp_path / 'plan.csv'
    file.write_text('x,y,load\n0.001,0.002,\n-0.001,0,1.5\n')
    first, second = read_plan(file)
    np.testing.assert_array_equal(first.position, [0.001, 0.002, 0.0])
    assert np.isnan(first.load)
    assert second.load == 1.5
    file.write_text('\ufeffx,y\n1,2\n', 'utf-8')  # as tables write it
    assert len(read_plan(file)) == 1
    for text in (
        'x,y,load\n1,2,-1\n', 'a,b\n1,2\n', 'x,y\n1,two\n', 'x,y\n', 'x,y\n1,inf\n', '\x00\xff'
    ):  # fmt: skip
        file.write_text(text, 'latin-1')
        with pytest.raises(ValueError, match='plan'):
            read_plan(file)


def test_folder_of_something_else_is_refused(tmp_path: Path) -> None:
    (tmp_path / 'mine.txt').write_text('mine')
    for overwrite in (False, True):
        with pytest.raises(RecordingError, match='something else'):
            Folder(tmp_path).begin({}, LAYOUT, overwrite=overwrite)
    assert [path.name for path in tmp_path.iterdir()] == ['mine.txt']


def test_folder_of_wrong_files_is_refused(tmp_path: Path) -> None:
    stated = {'targets': [[0, 0, 0, None]]}
    for text in ('{{{', '[' * 200_000, '\xff'):
        (tmp_path / 'session.json').write_text(text, 'latin-1')
        with pytest.raises(RecordingError, match='no session'):
            Folder(tmp_path).begin(stated, LAYOUT, overwrite=False)
    (tmp_path / 'session.json').write_text(json.dumps(stated))
    other = Layout(LAYOUT.positions[:1], ('output',), '1')
    for layout, truth in (
        (other, {'repetition': np.zeros(2)}), (LAYOUT, {}), (LAYOUT, {'repetition': np.ones(2)}),
        (LAYOUT, {'repetition': np.full(2, np.nan)}),
    ):  # fmt: skip
        press = Recording.from_arrays(layout, np.zeros((2, *layout.shape)), truth=truth)
        Folder(tmp_path).write(1, press)
        with pytest.raises(RecordingError, match='no press of this session'):
            Folder(tmp_path).begin(stated, LAYOUT, overwrite=False)


@pytest.mark.parametrize(
    ('line', 'load'),
    [(b'S,+  102.0 g\r\n', 1.0003), (b'-0.5kg\n', -4.9033), (b'2.5 N\n', 2.5), (b'204\n', 2.0)],
)
def test_scale_reads_lines_and_falls_silent(
    monkeypatch: pytest.MonkeyPatch, line: bytes, load: float
) -> None:
    monkeypatch.setattr(guided, 'SCALE_S', 0.1)
    with SimulatedSerialPort() as port, Scale(port.port) as scale:
        end, read = time.monotonic() + 120, np.nan
        while np.isnan(read) and time.monotonic() < end:
            port.send(line)
            read = scale.now()[0][2]
        assert read == pytest.approx(load, abs=1e-3)
        while np.isfinite(scale.now()[0][2]) and time.monotonic() < end:
            pass
        assert np.isnan(scale.now()[0]).all()


def test_scale_in_other_units_is_not_read() -> None:
    for line in (b'5.5 lb', b'55 oz', b'12 mg'):
        assert guided.READING.search(line) is None
    found = guided.READING.search(b'ST,GS,+  102.0 g net')
    assert found is not None
    assert found.groups() == (b'+', b'102.0', b'g')


def test_weights_are_laid_on_in_turn() -> None:
    assert Weights('50,100').loads == pytest.approx((0.4903, 0.9807), abs=1e-4)
    for text in ('', 'a', '50,-1', 'nan'):
        with pytest.raises(ValueError, match='weights must be grams'):
            Weights(text)


@pytest.mark.parametrize('key', ['gradiometer', 'magnet_pad', 'five_wire_skin', 'taxel_array'])
def test_simulated_presses_follow_the_guide(key: str) -> None:
    spec = load_sensor(key)
    recording = spec.presses(spec.config(), 0, noise=0.0)
    presses = SimulatedPresses(recording)
    assert len(presses.targets) >= 6
    rest = presses.signal(0.0)
    presses.follow(Phase.PRESS, 1)
    end = time.monotonic() + 120
    while presses._row < presses.peaks[1] and time.monotonic() < end:
        presses.signal(0.0)
    assert np.abs(presses.signal(0.0) - rest).max() > 0
    force, _ = presses.now()
    np.testing.assert_array_equal(force, recording.truth['force'][presses.peaks[1]])
    presses.follow(Phase.RELEASE, 1)
    np.testing.assert_array_equal(presses.signal(0.0), rest)


def test_judge_says_at_once_why_it_finds_nothing() -> None:
    def fails() -> Pipeline:
        msg = 'no truth'
        raise ValueError(msg)

    board, truth = Layout(np.eye(3)[:2], ('output',), '1', rate_hz=100.0), np.zeros((2, 3))
    press = Recording.from_arrays(board, np.zeros((2, 2, 1)), truth={'position': truth})
    targets = [Target(np.zeros(3)), Target(np.full(3, 1e-3))]
    judge = Judge(fails)
    judge.begin(PressGuide(board, targets, presses=[(0, press), (1, press)]))
    end = time.monotonic() + 60
    while judge.busy and time.monotonic() < end:
        pass
    assert (judge.failure, judge.found, judge.of) == ('no truth', None, 2)


def test_judge_gives_up_what_more_presses_have_made_old() -> None:
    board, made = Layout(np.eye(3)[:2], ('output',), '1', rate_hz=100.0), []
    begun, released = Event(), Event()

    class Fit:
        def fit(self, _: Recording) -> 'Fit':
            begun.set()
            released.wait(60)
            return self

        def process_batch(self, recording: Recording) -> ContactStates:
            return ContactStates.assemble(len(recording), 2, {})

    def make() -> Fit:
        made.append(Fit())
        return made[-1]

    press = Recording.from_arrays(
        board, np.zeros((2, 2, 1)), truth={'repetition': np.zeros(2)}, tare=np.array([True, False])
    )
    targets = [Target(np.full(3, 1e-3 * i)) for i in range(6)]
    guide = PressGuide(board, targets, presses=[(i, press) for i in range(5)])
    judge = Judge(make)
    judge.begin(guide)
    assert begun.wait(60)
    guide.presses.append((5, press))
    judge.least = 6
    released.set()
    judge._thread.join(60)
    assert (len(made), judge.of, judge.failure) == (1, 5, 'more presses came meanwhile')
    judge.begin(guide)
    judge._thread.join(60)
    assert (len(made), judge.of, judge.failure) == (5, 6, '')
    assert judge.first is made[1]  # it did not learn the first quarter of the places
