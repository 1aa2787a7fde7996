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

import shutil
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.cli.grasp_demo import run_grasps
from tactile_ros.cli.replay import evaluate, print_result
from tactile_ros.cli.twin_demo import run_twin
from tactile_ros.evaluation.benchmark import environment
from tactile_ros.evaluation.recording_files import load, save_recording
from tactile_ros.evaluation.replay import replay
from tactile_ros.evaluation.result import Dataset, Result, answer
from tactile_ros.sensors import load_sensor

if TYPE_CHECKING:
    import argparse

    from tactile_ros.evaluation.recording_files import LoadedRecording
    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import Recording

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
