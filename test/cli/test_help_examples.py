# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Every command of --help and of the pages runs on small real input, or says why it is not."""

import json
import shlex
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import count, pairwise
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from benchmarks.harness.rows import BenchResult, Row
from benchmarks.replay import write_bag
from reference import enrolled_skin
from reference.help_examples import ROOT, examples, lines, typed_on_pages
from tactile_ros.cli import calibrate, compare, view
from tactile_ros.cli.main import main
from tactile_ros.evaluation.bag import BagWriter, all_types
from tactile_ros.evaluation.recording_files import Loaded
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.types import STATE_FIELDS, Recording

STEP_NS = 10_000_000
START_NS = 1_700_000_000_000_000_000
MOST_ROWS = 1200
SHOWN = 20  # frames, after which whoever looks presses Ctrl-C
# beginnings of commands that test_docs.py has parsers take, but that are not run here
PARSED_ALONE = {
    'tactile calibrate --live': 'guides a hand for minutes; test_guided.py',
    'tactile calibrate gradiometer my_bag': 'needs a bag of its own; that of reskin_board is run',
    'tactile calibrate magnet_pad my_bag': 'the same',
    'tactile calibrate reskin_board log.csv': 'tables are read in test_recording_files.py',
    'tactile calibrate multipole_skin my_bag': 'the same',
    'tactile bench': 'measures for minutes to hours: `make bench` runs it',
    'tactile demo grasp': 'simulates for minutes; its scenes are run in test/simulation',
    'tactile demo': 'starts the ROS graph; `make demo`, and cut short in test_demo.py',
    'tactile run': 'runs nodes until Ctrl-C: test_run.py',
    'tactile record': 'needs running nodes: test_run.py, test/nodes/test_stack.py',
    'tactile enrol mug --presses': 'needs running nodes: test/nodes/test_enrolment_server.py',
    'tactile enrol mug --namespace': 'needs running nodes: test/nodes/test_enrolment_server.py',
    'tactile enrol mug --forget': 'needs running nodes: test/nodes/test_enrolment_server.py',
    'tactile view --namespace': 'needs running nodes: test/nodes/test_viewer_node.py',
    'tactile doctor --sensor magnet_pad --set': 'asks real buses; test_doctor.py a simulated one',
    'tactile doctor --sensor pinch_pad': 'is made on its page; test_adding_a_sensor.py',
    'tactile replay bags/* --calibration a.npz --scheduler': 'needs Dask; test_fleet.py has it',
    'tactile replay /data': 'needs a Dask cluster; test/evaluation/test_fleet.py starts one',
}  # fmt: skip
# needs running nodes: test/nodes/test_viewer_node.py; typed in their order: test_first_hour.py
TYPED_ELSEWHERE = {'tactile view', *lines(ROOT / 'docs' / 'first_hour.md')} - {
    line for line in examples() if line != 'tactile view'
}
LINES = [*dict.fromkeys([*examples(), *typed_on_pages()])]
ALONE = [line for line in LINES if line.startswith(tuple(PARSED_ALONE)) or line in TYPED_ELSEWHERE]
WRITTEN = ('-o', '--save', '--report', '--mcap', '--png', '--repair')
WRITTEN += ('--csv', '--parquet', '--lerobot')


def in_time(recording: Recording) -> Recording:
    """The same as a stream of 100 Hz, with the truth that a message holds."""
    rows = np.arange(len(recording))
    truth = {name: value for name, value in recording.truth.items() if name in STATE_FIELDS}
    stamp_ns = START_NS + STEP_NS * rows
    return replace(recording, stamp_ns=stamp_ns, sequence=rows, stream=None, truth=truth)


def write_bags(folder: Path, recording: Recording, pipeline: Pipeline) -> None:
    """Bags of live runs, as a recorder hears them."""
    shown = 'out/demo/reskin_board/bags/place'
    names = shown, 'bags/place', 'bags/one', 'bags/two', 'my_bag', 'another_bag'
    for number, name in enumerate(names):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        part = recording.select(slice(160 * number, 160 * number + 160))
        write_bag(folder / name, pipeline, in_time(part))
    add_load_cell(folder / 'my_bag')
    (presses,) = (folder / 'my_bag').glob('*.mcap')
    shutil.copyfile(presses, folder / 'my_presses.mcap')


def add_load_cell(bag: Path) -> None:
    """A probe whose load cell tells the force of every frame, in a bag that has none."""
    store = all_types()
    names = (f'geometry_msgs/msg/{name}' for name in ('WrenchStamped', 'Wrench', 'Vector3'))
    stamped, wrench, vector = (store.types[name] for name in names)
    told = bag.rename(bag.with_name('without_load_cell'))
    with AnyReader([told], default_typestore=store) as reader, BagWriter(bag) as writer:
        for number, (topic, log_ns, data) in enumerate(reader.messages()):
            writer.write(topic.topic, topic.msgtype, log_ns, bytes(data))
            if topic.topic == '/frame':
                frame = store.deserialize_cdr(data, topic.msgtype)
                push = vector(x=0.0, y=0.0, z=1.0 + number % 2)
                twist = vector(x=0.0, y=0.0, z=0.0)
                said = stamped(header=frame.header, wrench=wrench(force=push, torque=twist))
                cell = bytes(store.serialize_cdr(said, said.__msgtype__))
                writer.write('/probe/wrench', said.__msgtype__, log_ns + 1, cell)


@pytest.fixture(scope='module')
def place(tmp_path_factory: pytest.TempPathFactory, taught_skin: Path) -> Path:
    """A folder with all that the examples name."""
    folder = tmp_path_factory.mktemp('examples')
    spec = load_sensor('reskin_board')
    spatial = spec.recordings()['spatial']
    pipeline = spec.pipeline(estimator='ridge').fit(spatial.select(slice(0, 800)))
    (folder / 'out/demo/reskin_board/calibrations').mkdir(parents=True)
    shown = 'out/demo/reskin_board/calibrations/place'
    for name in ('place', shown, 'a', 'b', 'out/mine', 'out/other', 'out/place'):
        pipeline.save(folder / f'{name}.npz')
    write_bags(folder, spatial.select(slice(800, None)), pipeline)
    skin = enrolled_skin.SPEC.load(taught_skin)
    skin.save(folder / 'skin.npz')
    write_bag(folder / 'out/my_bag', skin, in_time(enrolled_skin.new_head(3)))
    (folder / 'my_board.yaml').write_text('rate_hz: 100.0\n')
    (folder / 'my_pad.yaml').write_text('shear_modulus: 4.0e4\n')
    rows = [
        Row(method, 'mm', error, aim=0.5, us_single=us, compared='place', method=method)
        for method, error, us in (('ridge', 0.4, 60.0), ('kNN', 0.7, 20.0))
    ]
    for name in ('reskin', 'devices'):
        BenchResult(name, f'tactile bench {name}', [0], rows).write(folder / 'benchmarks/results')
    return folder


@pytest.fixture
def port() -> Iterator[str]:
    """Where a simulated board sends its bytes."""
    spec = load_sensor('reskin_board')
    with spec.simulate(spec.config(), spec.connection(), None, 0) as twin:
        yield twin.port


@pytest.fixture(autouse=True)
def somebody_looks_for_a_moment(monkeypatch: pytest.MonkeyPatch) -> None:
    """A live view ends by Ctrl-C; its twin is not learned from, which takes seconds."""
    monkeypatch.setattr(view, 'fitted', lambda spec, config, _: spec.pipeline(config))
    for viewer in (view.Viewer, view.PageServer):
        monkeypatch.setattr(viewer, 'show', stops(viewer.show))


def stops(show: Callable[..., None]) -> Callable[..., None]:
    """The same until some frames were shown."""
    seen = count(1)

    def stop(*what: object) -> None:
        show(*what)
        if next(seen) >= SHOWN:
            raise KeyboardInterrupt

    return stop


@pytest.fixture(autouse=True)
def few_rows_are_learned(monkeypatch: pytest.MonkeyPatch) -> None:
    """A shipped recording is as long as `MOST_ROWS`."""
    whole = calibrate.find

    def first(*what: object) -> Loaded:
        found, part = whole(*what), slice(0, MOST_ROWS)
        some = (replace(one, recording=one.recording.select(part)) for one in found.recordings)
        return replace(found, recordings=tuple(some))

    for command in (calibrate, compare):
        monkeypatch.setattr(command, 'find', first)


def typed(line: str, port: str) -> list[str]:
    """Words as a shell gives them; the board's port is the twin's, and nothing takes long."""
    words = []
    for word in shlex.split(line)[1:]:
        found = sorted(map(str, Path().glob(word))) if '*' in word else [word]
        assert found, f'nothing is {word}'
        words += [port if name == '/dev/ttyACM0' else name for name in found]
    if words[0] == 'doctor' and '--sensor' in words:
        words += ['--seconds', '1.5']
    if words[0] == 'replay':
        words += ['--jobs', '1']  # no processes, which take seconds to start
    if words[0] == 'view' and '--mcap' not in words:
        words += ['--port', '0', '--no-open']  # that of the viewer may be in use
        words = [word for word in words if word != '--loop']  # which waits for a page
    return words


def written(name: str) -> dict[Path, int]:
    """Files that a word of an option stands for, and when each was written (ns)."""
    return {path: path.stat().st_mtime_ns for path in Path().glob(f'{name}*')}


def code_of(words: list[str]) -> int:
    """Exit code of the command."""
    try:
        return main(words)
    except SystemExit as stop:  # of --help
        return int(stop.code or 0)


@pytest.mark.parametrize('line', [line for line in LINES if line not in ALONE])
def test_an_example_runs(
    line: str, place: Path, port: str, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    if '--foxglove' in line or '--mcap' in line:
        pytest.importorskip('foxglove')
    if '--parquet' in line or '--lerobot' in line:
        pytest.importorskip('pyarrow', reason='pyarrow is not installed: pip install pyarrow')
    if '--png' in line:
        pytest.importorskip('resvg_py')
    monkeypatch.chdir(place)
    words = typed(line, port)
    before = {name: written(name) for option, name in pairwise(words) if option in WRITTEN}
    nothing_is_connected = int(line == 'tactile doctor')  # on most machines that run this
    code = code_of(words)
    printed = capsys.readouterr()
    assert code <= nothing_is_connected, printed.err
    if code:
        assert 'nothing is connected' in printed.out
    assert 'left out' not in printed.err
    if '--json' in words:
        assert json.loads(printed.out)
    for name, files in before.items():
        assert written(name).items() - files.items(), f'{name} was not written'


def test_what_is_parsed_alone_is_an_example() -> None:
    assert all(any(line.startswith(begin) for line in LINES) for begin in PARSED_ALONE)


def test_a_load_cell_alone_tells_force_and_no_rest(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(place)
    cell = ['--truth', '/probe/wrench']
    learn = ['calibrate', 'reskin_board', 'my_bag', '-o', 'out/force.npz', '--estimator', 'ridge']
    assert main([*learn, *cell]) == 0
    printed = capsys.readouterr()
    assert 'force' in printed.out
    assert 'it cannot be tared' in printed.err
    judge = ['replay', 'my_bag', '--calibration', 'out/force.npz', '--jobs', '1', *cell]
    assert main(judge) == 0
    assert 'are left out: this calibration was fitted without rest' in capsys.readouterr().out
    # with the rests that another topic tells it can
    assert main([*learn, *cell, '--truth', 'truth/contacts']) == 0
    assert 'it cannot be tared' not in capsys.readouterr().err
    assert main([*judge, '--tolerance', '0.004', '--delay', '0.001']) == 0
    told = capsys.readouterr().out
    assert 'normal RMSE (N)' in told
    assert '/probe/wrench: within 4 ms, 1 ms late' in told
