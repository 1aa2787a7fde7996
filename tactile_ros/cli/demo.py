"""Run a real recording through the real graph, record it, replay it, and report.

Three parts of real recordings, never seen by their calibrations, go as a board's own bytes through
a pseudo-terminal, the driver, sensor_node and contact_node into a bag; the bag is evaluated
without ROS. `--sensor` of another sensor runs its simulated twin instead, on a simple signal;
`grasp` runs simulated hands (needs MuJoCo).

example:
  tactile demo
  tactile demo --output out/other --seed 1
  tactile demo --sensor gradiometer
  tactile demo --sensor taxel_array --json
  tactile demo grasp
"""

from __future__ import annotations

import importlib.util
import shutil
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.cli import bench
from tactile_ros.cli.console import show, show_json
from tactile_ros.cli.record import wait, wait_for_frames
from tactile_ros.cli.replay import evaluate, print_result
from tactile_ros.errors import TactileError
from tactile_ros.evaluation.recording_files import load, save_recording
from tactile_ros.evaluation.replay import replay
from tactile_ros.evaluation.result import Dataset, Result, answer, environment
from tactile_ros.sensors import load_sensor
from tactile_ros.simulation.engine import Film, prefer_no_screen, why_not

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable

    from benchmarks.harness.rows import Row
    from tactile_ros.evaluation.recording_files import LoadedRecording
    from tactile_ros.pipeline import Pipeline
    from tactile_ros.sensors.registry import TwinLesson
    from tactile_ros.types import Recording

SHOWN_S = 60.0  # s, within which the new class must be seen
LEARNED_S = 30.0


def teach(lesson: TwinLesson, number: int, namespace: str, hear: Callable[[str], None]) -> None:
    """Enrol the new class once the truth says that it presses.

    Parameters
    ----------
    lesson : TwinLesson
        Of the twin that plays.
    number : int
        Of the new class in truth.
    namespace : str
        Of the sensor.
    hear : callable
        Takes what is said.

    Raises
    ------
    TactileError
        If it is not shown or not learned.
    """
    from tactile_ros.nodes.enrolment_server import Lesson, enrolling

    with enrolling(namespace) as client:
        client.wait_for_truth(lambda truth: bool(truth.label == number), SHOWN_S)
        hear(f'something unknown presses: enrolling it as {lesson.label!r}')
        learned = client.enrol(
            Lesson(lesson.label, lesson.presses, LEARNED_S), lambda _, said: hear(said)
        )
    if not learned.success:
        raise TactileError(learned.message)
    hear(learned.message)


def outcome(loaded: LoadedRecording, number: int) -> list[str]:
    """How windows of known classes and of the new one were named live, as sentences."""
    live, stamps = loaded.contacts, loaded.recording.stamp_ns
    if live is None or stamps is None or not loaded.changes:
        return []
    label = np.asarray(loaded.recording.truth['label'], np.int64)[live.rows]
    since = stamps[live.rows] > loaded.changes[0].after_ns
    # the last frame of a window is the one that says a place
    told = np.isfinite(live.states.position[:, 0]) & (live.states.in_contact == 1)
    known, new = told & (label >= 0) & (label != number), told & (label == number)
    name = loaded.changes[0].label
    return [
        _share('known heads before the lesson', live.states.label, label, known & ~since),
        _share(f'{name} before it', live.states.label, label, new & ~since),
        _share(f'{name} after it', live.states.label, label, new & since),
        _share('known heads after it', live.states.label, label, known & since),
    ]


def _share(what: str, said: np.ndarray, label: np.ndarray, rows: np.ndarray) -> str:
    """How many windows were named rightly."""
    right = int((said[rows] == label[rows]).sum())
    return f'{what}: {right} of {int(rows.sum())} windows named rightly'


PLAYED_S = 20.0
# rows, and readings in them, for a fit of seconds
MOST_ROWS, MOST_READINGS = 5000, 200_000
# Hz; at higher rates one process reads and estimates, by direct calls
RATE_OF_PROCESSES = 250.0
TWIN_NOTES = (
    'The signal is that of the twin, as the documentation of the sensor describes it, simpler '
    'than a real skin: figures show that the chain works, and what it does in that world alone.',
    'Learned from presses of another seed than those that are played; truth is what the signal '
    'says at the stamp of each frame.',
    'Latency runs from the acquisition to the recorder that heard the contacts.',
)


def say(began: float, sentence: str) -> None:
    """Tell how far it is."""
    print(f'[{time.perf_counter() - began:5.1f} s] {sentence}', file=sys.stderr, flush=True)


def run_twin(
    key: str, output: Path, seed: int, seconds: float = PLAYED_S, *, as_json: bool = False
) -> int:
    """Calibrate on simulated presses, run the graph on a twin, record, replay, report.

    Parameters
    ----------
    key : str
        Of the sensor.
    output : Path
        Folder, which has no bag yet.
    seed : int
        Of the twin; the calibration has the next one.
    seconds : float
        Length of the run (s), from the first frame on; longer where something is to be learned.
    as_json : bool
        Print the table as JSON, and all else to stderr.

    Returns
    -------
    int
        0.
    """
    began = time.perf_counter()
    say(began, f'calibrating {key} on simulated presses of seed {seed + 1}')
    path = output / 'calibrations' / f'{key}.npz'
    pipeline = fit_twin(key, seed + 1, path)
    say(began, f'twin of {key}, seed {seed}: {seconds:g} s through driver, nodes and recorder')
    play_twin(key, seed, path, output / 'bags' / key, seconds, lambda said: say(began, said))
    say(began, 'replaying the bag')
    loaded = load(output / 'bags' / key).recordings[0]
    summary = f'Presses of seed {seed} on a twin, in a simple signal; calibrated on others.'
    dataset = evaluate(loaded, [pipeline], summary, key)
    command = f'tactile demo --sensor {key} --seed {seed}'
    title = f'A simulated {key} through the real graph'
    from tactile_ros.cli.calibrate import sentences
    from tactile_ros.evaluation.report import write_report

    rate = f'The twin sends {demo_rate(key):g} frames a second.'
    learned = outcome(loaded, _new_class(key))
    notes = (*TWIN_NOTES, rate, *learned, *sentences(pipeline.report))
    result = Result(title, command, environment(), (dataset,), notes)
    said = sys.stderr if as_json else sys.stdout
    print_result(result, as_json=as_json)
    print(f'  {key}: {TWIN_NOTES[0]} {rate}', file=said)
    for sentence in learned:
        print(f'  {key}: {sentence}', file=said)

    write_report(output / 'report.html', result)
    say(began, 'done')
    for name, place in (
        ('bag', output / 'bags' / key),
        ('calibration', path),
        ('report', output / 'report.html'),
    ):
        print(f'{name:12} {place}', file=said)
    return 0


def fit_twin(key: str, seed: int, path: Path) -> Pipeline:
    """Calibration from simulated presses, as it is read back from its file."""
    spec = load_sensor(key)
    config = spec.config(**spec.demo)
    if spec.lesson is not None:
        spec.pipeline(config).fit(spec.lesson.calibration(config, seed)).save(path)
        return spec.load(path)
    train = spec.presses(config, seed)
    most = min(MOST_ROWS, MOST_READINGS // train.values[0].size)
    every = slice(None, None, -(-len(train) // most))
    spec.pipeline(config).fit(train.select(every)).save(path)
    return spec.load(path)


def demo_rate(key: str) -> float:
    """Frames a second (Hz) that the twin of a sensor sends in its demo."""
    spec = load_sensor(key)
    return spec.layout(spec.config(**spec.demo)).rate_hz


def _new_class(key: str) -> int:
    """Number of a class that the calibration of a demo does not know."""
    spec = load_sensor(key)
    return len(getattr(spec.config(**spec.demo), 'objects', ()))


def _as_parameter(value: object) -> object:
    """A field of a config as ROS parameters hold it."""
    return np.ravel(value).tolist() if isinstance(value, np.ndarray) else value


def play_twin(
    key: str, seed: int, calibration: Path, bag: Path, seconds: float, hear: Callable[[str], None]
) -> None:
    """Run the graph on the twin and record it; teach it what its scene has to be learned."""
    from tactile_ros.nodes.graph import Setting, sensing
    from tactile_ros.nodes.processes import Running

    spec = load_sensor(key)
    fast = demo_rate(key) > RATE_OF_PROCESSES
    setting = Setting(
        sensor=key, source='simulated', seed=seed, calibration=str(calibration), bag=str(bag),
        namespace=key, stack=fast,
    )  # fmt: skip
    values = {name: _as_parameter(value) for name, value in spec.demo.items()}
    if spec.lesson is not None:
        values['scene'] = 'lesson'
    graph = sensing(setting).with_parameters('sensor_node', values) if values else sensing(setting)
    with Running(graph, {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}) as running:
        wait_for_frames(running, bag)
        if spec.lesson is not None:
            teach(spec.lesson, _new_class(key), key, hear)
        wait(running, bag, seconds)
        for name in running.lines:
            if not running.is_alive(name):
                msg = f'{name} ended too early; it said: {" | ".join(running.lines[name][-3:])}'
                raise TactileError(msg)
        # the source first, so that what is on its way arrives
        running.stop(['stack' if fast else 'sensor_node'])


def films() -> dict[str, Film]:
    """What is filmed, and from where."""
    return {
        'balloon': Film(4.0, (0.0, 0.06, 0.0), 0.32, azimuth=60.0, elevation=-40.0, speed_up=3.0),
        'allegro': Film(10.0, (0.07, 0.02, 0.05), 0.36, azimuth=310.0, elevation=-25.0),
        'loads': Film(12.0, (0.0, 0.0, 0.01), 0.22, azimuth=115.0, elevation=-15.0),
    }


def run_grasps(output: Path, seed: int, as_json: bool = False) -> int:
    """Run the scenes, print their figures, write plots and films.

    Parameters
    ----------
    output : Path
        Folder of the plots and films.
    seed : int
        Of poses, loads and noise.
    as_json : bool
        Print the table as JSON; all else goes to standard error.

    Returns
    -------
    int
        0.

    Raises
    ------
    TactileError
        If MuJoCo is missing, or the scenes are not installed.
    """
    began = time.perf_counter()
    scenes = bench.load('worlds.grasp_scenes', NEEDED_BY)
    tables = bench.load('harness.rows', NEEDED_BY)
    prefer_no_screen()
    sentence = why_not()
    made = {} if sentence else films()
    print('calibrating fingertips, then a minute or two of scenes', file=sys.stderr, flush=True)
    found = scenes.run('quick', seed, made)
    rows, told, drawn = _faults()
    rows, told, drawn = found.rows + rows, found.notes + told, {**found.drawings, **drawn}
    command = f'tactile demo grasp --seed {seed}'
    result = tables.BenchResult('grasp', command, [seed], rows, told, drawn)
    cells, aside = [row.cells() for row in result.rows], sys.stdout
    if as_json:
        show_json(tables.COLUMNS, cells)
        aside = sys.stderr
    else:
        show(tables.COLUMNS, cells, title=f'grasp: {command}')
    for note in result.notes:
        print(f'  {note}', file=aside)
    output.mkdir(parents=True, exist_ok=True)
    for path in result.draw(output):
        print(f'  drawn: {path}', file=aside)
    for name, film in made.items():
        print(f'  filmed: {film.save(output / f"grasp_{name}.gif")}', file=aside)
    if sentence:
        print(f'  no films: {sentence}', file=aside)
    print(f'  {time.perf_counter() - began:.0f} s', file=aside)
    return 0


def _faults() -> tuple[list[Row], list[str], dict[str, str]]:
    """Scene 4: faults of a grasp through the graph of nodes, where there is ROS."""
    if importlib.util.find_spec('rclpy') is None:
        return [], ['Faults during a grasp are left out: they need ROS 2.'], {}
    print('faults during a grasp through the nodes', file=sys.stderr, flush=True)
    module = bench.load('worlds.grip_faults', NEEDED_BY)
    rows, told, drawn = module.fault_rows('quick')
    return list(rows), list(told), dict(drawn)


NEEDED_BY = '`tactile demo grasp`'
SENSOR = 'reskin_board'
HELD_PLACES = 0.2
TOUCHES_PLAYED = 300
OWN_FOLDERS = ('bags', 'calibrations', 'recordings')
COMPARED = ('ridge', 'grid_knn')


@dataclass(frozen=True)
class Part:
    """A recording to learn from and another one to play.

    Attributes
    ----------
    name, summary : str
        Namespace and file name; what is held out, in a sentence.
    train : Recording
        For the calibration.
    played : Recording
        For the graph; none of its groups is in `train`.
    speed_up : float
        Recorded time over played time.
    in_time : bool
        Stamps keep recorded time, since force is estimated with memory.
    """

    name: str
    summary: str
    train: Recording
    played: Recording
    speed_up: float
    in_time: bool


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `tactile demo`."""
    parser.add_argument(
        'what', nargs='?', default='sensor', choices=('sensor', 'grasp'), help='what is shown'
    )
    parser.add_argument('--output', type=Path, default=Path('out') / 'demo', help='folder')
    parser.add_argument('--seed', type=int, default=0, help='which places are held out')
    parser.add_argument('--json', action='store_true', help='print the table as JSON')
    parser.add_argument(
        '--sensor', default=SENSOR, help=f'{SENSOR} plays recordings, any other one its twin'
    )


def parts(seed: int) -> list[Part]:
    """The three parts: places held out, a run held out, the last cycles held out."""
    shipped = load_sensor(SENSOR).recordings()
    train, played = split_places(shipped['spatial'], seed)
    return [
        Part(
            'place',
            'Touches at grid points that the calibration has never seen, in any touch; the depth '
            'of the probe varies.',
            train, played, 60.0, in_time=False,
        ),
        Part(
            'normal',
            'The first six presses of a run, calibrated on the other run alone.',
            shipped['normal_1'], split_cycles(shipped['normal_2'], 6)[0], 15.0, in_time=True,
        ),
        Part(
            'shear',
            'The last two of ten shear cycles, calibrated on the first eight.',
            *split_cycles(shipped['shear'], 8), 15.0, in_time=True,
        ),
    ]  # fmt: skip


def split_places(recording: Recording, seed: int) -> tuple[Recording, Recording]:
    """Touches at a random fifth of the places to play, those at all others to learn from."""
    tare = np.zeros(len(recording), bool) if recording.tare is None else recording.tare
    touch = np.flatnonzero(~tare)
    plane = np.round(1e3 * recording.truth['position'][touch, :2].astype(float))
    _, place = np.unique(plane, axis=0, return_inverse=True)
    place = np.ravel(place)
    rng = np.random.default_rng(seed)
    held = rng.permutation(place.max() + 1)[: int(HELD_PLACES * (place.max() + 1))]
    test = np.isin(place, held)
    chosen = np.sort(rng.permutation(np.flatnonzero(test))[:TOUCHES_PLAYED])
    return with_tares(recording, touch[~test]), with_tares(recording, touch[chosen])


def with_tares(recording: Recording, touch: np.ndarray) -> Recording:
    """Touches with the tare row that comes right before each."""
    return recording.select(np.sort(np.concatenate([touch - 1, touch])))


def split_cycles(recording: Recording, first: int) -> tuple[Recording, Recording]:
    """The first cycles, and the others."""
    late = recording.truth['repetition'].astype(np.int64) >= first
    return recording.select(~late), recording.select(late)


def run(options: argparse.Namespace) -> int:
    """Calibrate, play, record, replay, report."""
    if options.what == 'grasp':
        return run_grasps(options.output.resolve(), options.seed, options.json)
    spec = load_sensor(options.sensor)
    output = options.output.resolve()
    clear(output)
    if spec.key != SENSOR:
        return run_twin(spec.key, output, options.seed, as_json=options.json)
    began = time.perf_counter()
    chosen = parts(options.seed)
    _say(began, 'calibrating on parts of real recordings (places, a run, cycles)')
    fitted = calibrate(chosen, output)
    datasets = []
    for part in chosen:
        _say(began, f'{part.name}: {len(part.played)} rows through the graph, {part.speed_up:g}x')
        said = play(part, output)
        _say(began, f'{part.name}: {said}')
        pipelines = [load_sensor(SENSOR).load(path) for path in fitted[part.name]]
        datasets.append(judge(part, output, pipelines))
    command = f'tactile demo --seed {options.seed}'
    result = Result(
        'A real recording through the real graph', command, environment(), tuple(datasets), NOTES
    )
    print_result(result, as_json=options.json)
    from tactile_ros.evaluation.report import write_report

    write_report(output / 'report.html', result)
    _say(began, 'done')
    for name, path in _outcome(output, chosen):
        print(f'{name:12} {path}', file=sys.stderr if options.json else sys.stdout)
    return 0


NOTES = (
    'Recordings: eFlesh (arXiv 2506.09994, MIT licence), 5 or 10 MLX90393 chips.',
    'The recordings have no temperature: 25 degrees Celsius is sent, and ignored.',
    'Latency runs from the arrival of the bytes to the recorder that heard the contacts.',
    'Parts that are played with recorded time carry stamps of that time and show no latency.',
)


def clear(output: Path) -> None:
    """Remove what an earlier demo left in its folder, and nothing else."""
    output.mkdir(parents=True, exist_ok=True)
    for name in OWN_FOLDERS:
        if (output / name).exists():
            shutil.rmtree(output / name)
    (output / 'report.html').unlink(missing_ok=True)


def _say(began: float, sentence: str) -> None:
    print(f'[{time.perf_counter() - began:5.1f} s] {sentence}', file=sys.stderr, flush=True)


def calibrate(chosen: list[Part], output: Path) -> dict[str, list[Path]]:
    """Best estimators and each choosable one for every part, in two processes; their files."""
    names = [None, *COMPARED]
    jobs = [(part, name, output) for name in names for part in chosen]
    files: dict[str, list[Path]] = {part.name: [] for part in chosen}
    with workers() as pool:
        for (part, *_), path in zip(jobs, pool.map(fit_one, jobs), strict=True):
            files[part.name].append(path)
    return {name: _different(paths) for name, paths in files.items()}


def workers() -> ProcessPoolExecutor:
    """Two processes that a killed demo takes along."""
    from tactile_ros.nodes.processes import end_with_parent

    # Not what Python 3.14 takes by itself, a server of forks: its children outlive a killed demo,
    # and each would run this command again.
    return ProcessPoolExecutor(2, get_context('fork'), initializer=end_with_parent)


def fit_one(job: tuple[Part, str | None, Path]) -> Path:
    """Fit and save one pipeline."""
    part, name, output = job
    spec = load_sensor(SENSOR)
    config = replace(spec.config(), positions=part.train.layout.positions)  # type: ignore[type-var]
    path = output / 'calibrations' / f'{part.name}{"" if name is None else "_" + name}.npz'
    spec.pipeline(config, estimator=name).fit(part.train).save(path)
    return path


def _different(paths: list[Path]) -> list[Path]:
    """The best first, and of the others those that are not the same estimator again."""
    spec = load_sensor(SENSOR)
    best = set(spec.load(paths[0]).estimators.values())
    return [paths[0], *(p for p in paths[1:] if set(spec.load(p).estimators.values()) != best)]


def play(part: Part, output: Path) -> str:
    """Run the graph on one part and record its bag; what the player said at the end."""
    from tactile_ros.nodes.graph import Setting, sensing
    from tactile_ros.nodes.processes import Running

    recording = output / 'recordings' / f'{part.name}.npz'
    recording.parent.mkdir(exist_ok=True)
    save_recording(part.played, recording)
    setting = Setting(
        sensor=SENSOR, source='recorded', port=str(output / f'{part.name}.port'),
        recording=str(recording), calibration=str(output / 'calibrations' / f'{part.name}.npz'),
        bag=str(output / 'bags' / part.name), speed_up=part.speed_up, namespace=part.name,
    )  # fmt: skip
    positions = part.played.layout.positions.ravel().tolist()
    extra = {'positions': positions, 'clock_rate': part.speed_up if part.in_time else 1.0}
    graph = sensing(setting).with_parameters('sensor_node', extra)
    with Running(graph, {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}) as running:
        line = running.wait_for_line('player', 'played', timeout=60.0)
    return str(line[line.index('played') :])


def judge(part: Part, output: Path, pipelines: list[Pipeline]) -> Dataset:
    """Replay the bag with every pipeline, and with automatic rest detection alone."""
    loaded = load(output / 'bags' / part.name).recordings[0]
    dataset = evaluate(loaded, pipelines, part.summary, part.name)
    name = f'{dataset.answers[0].name}, rest found alone'
    note = 'one tare at the start, then the baseline follows by itself'
    alone = answer(name, loaded, replay(untared(loaded), pipelines[0]), note)
    latency = np.zeros(0) if part.in_time else dataset.latency_s
    first, *others = dataset.answers
    return replace(dataset, answers=(first, alone, *others), latency_s=latency)


def untared(loaded: LoadedRecording) -> LoadedRecording:
    """The same frames with the first tare only, after the baseline of the calibration."""
    return replace(loaded, baselines=loaded.baselines[:2], contacts=None, calibrations=())


def _outcome(output: Path, chosen: list[Part]) -> list[tuple[str, Path]]:
    """What lies where."""
    bags = [('bag', output / 'bags' / part.name) for part in chosen]
    files = [('calibration', output / 'calibrations' / f'{part.name}.npz') for part in chosen]
    return [*bags, *files, ('report', output / 'report.html')]
