# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Run a real recording through the real graph, record, replay and report it.

Three parts of real recordings, never seen by their calibrations, go as a board's own bytes through
a pseudo-terminal, the driver, sensor_node and contact_node into a bag; the bag is evaluated
without ROS. `--sensor` of another sensor simulates its board instead, on a simple signal;
`grasp` runs simulated hands (needs MuJoCo).

example:
  tactile demo
  tactile demo --seed 1 --output out/other
  tactile demo --sensor gradiometer
  tactile demo --sensor taxel_array --json
  tactile demo grasp
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from tactile_ros.cli import bench, interruptible
from tactile_ros.cli.calibrate import sentences
from tactile_ros.cli.console import SHARE, show, working
from tactile_ros.cli.record import wait, wait_for_frames
from tactile_ros.errors import TactileError
from tactile_ros.evaluation import fleet
from tactile_ros.evaluation.metrics import times_of
from tactile_ros.evaluation.recording_files import LoadedRecording, load, save_recording
from tactile_ros.evaluation.report import Dataset, Result, provenance, table, write_report
from tactile_ros.files import UNFINISHED
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import SensorSpec, load_sensor
from tactile_ros.types import Recording

Say = Callable[[str], None]

SENSOR = 'reskin_board'
HELD_PLACES, TOUCHES_PLAYED = 0.2, 300
COMPARED = ('ridge', 'grid_knn')
RESULTS = ('bags', 'calibrations', 'recordings', 'report.html')
MARK = '.tactile_demo'  # a file in every folder that a demo made
LOCAL = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
NICE = 10  # of fits beside the graph, which keeps time
NOTES = (
    'Recordings: eFlesh (arXiv 2506.09994, MIT licence), 5 or 10 MLX90393 chips.',
    'The recordings have no temperature: 25 degrees Celsius is sent, and ignored.',
    'Latency runs from the arrival of the bytes to the recorder that received the contacts.',
    'Parts that are played with recorded time carry stamps of that time and show no latency.',
)
PLAYED_S = 20.0
SHOWN_S, LEARNED_S = 60.0, 30.0  # s, within which a new class is seen, and learned
MOST_ROWS, MOST_READINGS = 5000, 200_000  # of a twin's presses, for a fit of seconds
RATE_OF_PROCESSES = 250.0  # Hz; at higher rates one process reads and estimates, by direct calls
TWIN_NOTES = (
    'The signal is that of the twin, as the documentation of the sensor describes it, simpler '
    'than a real skin: figures show that the chain works, and what it does in that world alone.',
    'Learned from presses of another seed than those that are played; truth is what the signal '
    'says at the stamp of each frame.',
    'Latency runs from the acquisition to the recorder that received the contacts.',
)


@dataclass(frozen=True)
class Part:
    """A recording to learn from and another one to play, no group of which is in the first.

    `speed_up` is recorded over played time; with `in_time` stamps keep recorded time, since force
    is estimated with memory.
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
    parser.add_argument('--output', type=Path, help='folder (out/demo/SENSOR or out/demo/grasp)')
    parser.add_argument(
        '--overwrite', action='store_true', help='replace results in a folder no demo made'
    )
    parser.add_argument('--seed', type=int, default=0, help='which places are held out')
    parser.add_argument('--json', action='store_true', help='print the table as JSON')
    parser.add_argument(
        '--sensor', default=SENSOR, help=f'{SENSOR} plays recordings, others are simulated'
    )


def run(options: argparse.Namespace) -> int:
    """Calibrate, play, record, replay, report."""
    spec = load_sensor(options.sensor)
    name = options.what if options.what == 'grasp' else spec.key
    output = (options.output or Path('out') / 'demo' / name).resolve()
    say = partial(_say, time.perf_counter())
    with results(output, overwrite=options.overwrite) as made:
        if options.what == 'grasp':
            grasps = bench.load('worlds.grasp_scenes', '`tactile demo grasp`')
            return int(grasps.run_grasps(output, options.seed, options.json))
        if spec.key == SENSOR:
            chosen = parts(options.seed)
            datasets, fitted = measure(chosen, made, say), made / 'calibrations'
            best = {one.name: spec.load(fitted / f'{one.name}.npz') for one in chosen}
            title = 'A real recording through the real graph'
            command = f'tactile demo --seed {options.seed}'
            result = Result(title, command, provenance(best, best), datasets, NOTES)
            shown = result.sentences
        else:
            result, shown = run_twin(spec, made, options.seed, say)
        show(*table(result), as_json=options.json, notes=shown)
        write_report(made / 'report.html', result)
    say('done')
    names = [one.name for one in result.datasets]
    places = [('bag', output / 'bags' / name) for name in names]
    places += [('calibration', output / 'calibrations' / f'{name}.npz') for name in names]
    for kind, path in (*places, ('report', output / 'report.html')):
        print(f'{kind:12} {path}', file=sys.stderr if options.json else sys.stdout)
    return 0


def _say(began: float, sentence: str) -> None:
    print(f'[{time.perf_counter() - began:5.1f} s] {sentence}', file=sys.stderr, flush=True)


@contextmanager
def results(output: Path, *, overwrite: bool) -> Iterator[Path]:
    """Folder for results, which replace those of an earlier demo in `output` at the end.

    Raises TactileError if `output` holds files and no demo made it, unless they may be replaced.
    """
    foreign = output.is_dir() and any(output.iterdir()) and not (output / MARK).is_file()
    if foreign and not overwrite:
        msg = f'{output} holds files and no demo made it; name another --output, or --overwrite'
        raise TactileError(msg)
    fresh = not output.exists()
    output.mkdir(parents=True, exist_ok=True)
    with ExitStack() as held:
        if fresh:
            held.callback(_remove_empty, output)
        folder = held.enter_context(tempfile.TemporaryDirectory(dir=output, prefix='.new_'))
        UNFINISHED.add(folder)
        held.callback(UNFINISHED.discard, folder)
        yield Path(folder)
        UNFINISHED.discard(folder)  # what is moved from here on is not removed by an interrupt
        (output / MARK).touch()
        for made in [Path(folder) / name for name in RESULTS]:
            if made.exists():
                if (output / made.name).exists():
                    (output / made.name).rename(Path(folder) / f'earlier_{made.name}')
                made.rename(output / made.name)


def _remove_empty(folder: Path) -> None:
    if not any(folder.iterdir()):
        folder.rmdir()


def parts(seed: int) -> list[Part]:
    """The three parts: places held out, a run held out, the last cycles held out."""
    shipped = load_sensor(SENSOR).recordings()
    return [
        Part(
            'place',
            'Touches at grid points that the calibration has never seen, in any touch; the depth '
            'of the probe varies.',
            *split_places(shipped['spatial'], seed), 60.0, in_time=False,
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
    """Touches at all places but a random fifth to learn from, those at these to play."""
    tare = np.zeros(len(recording), bool) if recording.tare is None else recording.tare
    touch = np.flatnonzero(~tare)
    plane = np.round(1e3 * recording.truth['position'][touch, :2].astype(float))
    place = np.ravel(np.unique(plane, axis=0, return_inverse=True)[1])
    rng = np.random.default_rng(seed)
    held = rng.permutation(place.max() + 1)[: int(HELD_PLACES * (place.max() + 1))]
    test = np.isin(place, held)
    chosen = np.sort(rng.permutation(np.flatnonzero(test))[:TOUCHES_PLAYED])
    # with the tare row that comes right before each
    rows = (np.sort(np.concatenate([one - 1, one])) for one in (touch[~test], touch[chosen]))
    train, played = map(recording.select, rows)
    return train, played


def split_cycles(recording: Recording, first: int) -> tuple[Recording, Recording]:
    """The first cycles, and the others."""
    late = recording.truth['repetition'].astype(np.int64) >= first
    return recording.select(~late), recording.select(late)


def measure(chosen: list[Part], output: Path, say: Say) -> tuple[Dataset, ...]:
    """Fit every part, in two processes, and play each as soon as its calibration is there.

    Parts whose latency is shown are played last, when all fits are made.
    """
    say('calibrating on parts of real recordings: runs and cycles take seconds, places longer')
    order = sorted(chosen, key=lambda part: not part.in_time)
    pool = workers()
    try:
        fits: dict[str, list[Future[Path]]] = {part.name: [] for part in order}
        for name in (None, *COMPARED):
            for part in order:
                fits[part.name].append(pool.submit(fit_one, part, name, output))
        began, every = time.monotonic(), [fit for each in fits.values() for fit in each]
        for part in order:
            wanted, since = fits[part.name][:1] if part.in_time else every, time.monotonic()
            left = partial(time_left, every, wanted, began, since)
            with working(f'fitting {part.name}', expected=left):
                for fit in wanted:
                    fit.result()
            seconds = np.nan_to_num(np.ptp(times_of(part.played))) / part.speed_up
            about = f', about {seconds:.0f} s' if part.in_time else ''
            rows = f'{len(part.played)} rows through the graph, {part.speed_up:g}x'
            say(f'{part.name}: {rows}{about}')
            say(f'{part.name}: {play(part, output)}')
    finally:
        pool.shutdown(cancel_futures=True)
    say('replaying the bags')
    return tuple(
        judge(part, output, [load_sensor(SENSOR).load(fit.result()) for fit in fits[part.name]])
        for part in chosen
    )


def time_left(
    every: Sequence[Future[Path]], wanted: Sequence[Future[Path]], began: float, since: float
) -> float:
    """Time that waiting for wanted fits takes in all (s), by those that are made; 0: unknown."""
    now, made = time.monotonic(), sum(fit.done() for fit in every)
    left = sum(not fit.done() for fit in wanted)
    return now - since + left * (now - began) / made if made else 0.0


def workers() -> ProcessPoolExecutor:
    """Two processes that a killed demo takes along."""
    from tactile_ros.nodes.processes import end_with_parent

    def begin() -> None:
        end_with_parent()
        os.nice(NICE)

    # Not what Python 3.14 takes by itself, a server of forks: its children outlive a killed demo,
    # and each would run this command again.
    return ProcessPoolExecutor(2, get_context('fork'), initializer=begin)


def fit_one(part: Part, name: str | None, output: Path) -> Path:
    """Fit and save one pipeline."""
    spec = load_sensor(SENSOR)
    config = replace(spec.config(), positions=part.train.layout.positions)  # type: ignore[type-var]
    path = output / 'calibrations' / f'{part.name}{"" if name is None else "_" + name}.npz'
    spec.pipeline(config, estimator=name).fit(part.train).save(path)
    return path


def play(part: Part, output: Path) -> str:
    """Run the graph on one part and record its bag; what the player said at the end."""
    from tactile_ros.nodes.graph import SensorSetup, sensing
    from tactile_ros.nodes.processes import Running

    recording = output / 'recordings' / f'{part.name}.npz'
    recording.parent.mkdir(exist_ok=True)
    save_recording(part.played, recording)
    setting = SensorSetup(
        sensor=SENSOR, source='recorded', port=str(output / f'{part.name}.port'),
        recording=str(recording), calibration=str(output / 'calibrations' / f'{part.name}.npz'),
        bag=str(output / 'bags' / part.name), speed_up=part.speed_up, namespace=part.name,
    )  # fmt: skip
    positions = part.played.layout.positions.ravel().tolist()
    extra = {'positions': positions, 'clock_rate': part.speed_up if part.in_time else 1.0}
    graph = sensing(setting).with_parameters('sensor_node', extra)
    with interruptible(), Running(graph, LOCAL) as running:
        line = running.wait_for_line('player', 'played', timeout=60.0)
    return str(line[line.index('played') :])


def judge(part: Part, output: Path, pipelines: list[Pipeline]) -> Dataset:
    """Replay the bag with the best pipeline, others than it, and with the first tare alone."""
    best, *others = pipelines
    same = set(best.estimators.values())
    others = [other for other in others if set(other.estimators.values()) != same]
    loaded = load(output / 'bags' / part.name).recordings[0]
    dataset = _evaluated(loaded, [best, *others], part.summary, part.name)
    return replace(dataset, latency_s=np.zeros(0)) if part.in_time else dataset


def _evaluated(
    loaded: LoadedRecording, pipelines: Sequence[Pipeline], summary: str, name: str
) -> Dataset:
    """Answers of every pipeline, of which the first one made the live run."""
    named = {str(i): one for i, one in enumerate(pipelines)}
    found = fleet.evaluate(loaded, named, untared=True)
    first, *others = found.answers
    others = [replace(one, agreement=None, problems=()) for one in others]
    return replace(
        found, name=name, summary=summary, agreement=first.agreement, answers=(first, *others)
    )


def run_twin(
    spec: SensorSpec, output: Path, seed: int, say: Say, seconds: float = PLAYED_S
) -> tuple[Result, list[str]]:
    """Calibrate on simulated presses of the next seed, run the graph on a twin, replay.

    Returns the result, and sentences that are shown below its table.
    """
    key = spec.key
    say(f'calibrating {key} on simulated presses of seed {seed + 1}')
    pipeline = fit_twin(spec, seed + 1, output / 'calibrations' / f'{key}.npz')
    say(f'twin of {key}, seed {seed}: {seconds:g} s through driver, nodes and recorder')
    play_twin(spec, seed, output, seconds, say)
    say('replaying the bag')
    loaded = load(output / 'bags' / key).recordings[0]
    summary = f'Presses of seed {seed} on a twin, in a simple signal; calibrated on others.'
    dataset = _evaluated(loaded, [pipeline], summary, key)
    rate = f'The twin sends {pipeline.layout.rate_hz:g} frames a second.'
    learned = outcome(loaded, _new_class(spec))
    notes = (*TWIN_NOTES, rate, *learned, *sentences(pipeline.report))
    title = f'A simulated {key} through the real graph'
    command = f'tactile demo --sensor {key} --seed {seed}'
    result = Result(title, command, provenance([key], {key: pipeline}), (dataset,), notes)
    shown = [f'{key}: {sentence}' for sentence in (f'{TWIN_NOTES[0]} {rate}', *learned)]
    return result, [*result.sentences, *shown]


def fit_twin(spec: SensorSpec, seed: int, path: Path) -> Pipeline:
    """Calibration from simulated presses, as it is read back from its file."""
    config = spec.config(**spec.demo)
    if spec.new_class is not None:
        train = spec.new_class.calibration(config, seed)
    else:
        train = spec.presses(config, seed)
        most = min(MOST_ROWS, MOST_READINGS // train.values[0].size)
        train = train.select(slice(None, None, -(-len(train) // most)))

    def part() -> None:
        spec.pipeline(config).fit(train.select(slice(0, -(-len(train) // SHARE))))

    with working(f'fitting {spec.key}', part=part):
        spec.pipeline(config).fit(train).save(path)
    return spec.load(path)


def _new_class(spec: SensorSpec) -> int:
    """Number of a class that the calibration of a demo does not know."""
    return len(getattr(spec.config(**spec.demo), 'objects', ()))


def play_twin(spec: SensorSpec, seed: int, output: Path, seconds: float, say: Say) -> None:
    """Run the graph on the twin and record it; teach it what its scene has to be learned."""
    from tactile_ros.nodes.graph import SensorSetup, sensing
    from tactile_ros.nodes.processes import Running

    key, bag = spec.key, output / 'bags' / spec.key
    fast = spec.layout(spec.config(**spec.demo)).rate_hz > RATE_OF_PROCESSES
    setting = SensorSetup(
        sensor=key, source='simulated', seed=seed, bag=str(bag), namespace=key, stack=fast,
        calibration=str(output / 'calibrations' / f'{key}.npz'),
    )  # fmt: skip
    values: dict[str, object] = {
        name: np.ravel(value).tolist() if isinstance(value, np.ndarray) else value
        for name, value in spec.demo.items()
    }
    if spec.new_class is not None:
        values['scene'] = 'new_class'
    graph = sensing(setting).with_parameters('sensor_node', values)
    with interruptible(), Running(graph, LOCAL) as running:
        wait_for_frames(running, bag)
        if spec.new_class is not None:
            teach(spec, say)
        wait(running, bag, seconds)
        for name in running.lines:
            if not running.is_alive(name):
                msg = f'{name} ended too early; it said: {" | ".join(running.lines[name][-3:])}'
                raise TactileError(msg)
        # the source first, so that what is on its way arrives
        running.stop(['stack' if fast else 'sensor_node'])


def teach(spec: SensorSpec, say: Say) -> None:
    """Enrol the class of a twin's scene once the truth says that it presses.

    Raises TactileError if it is not shown or not learned.
    """
    from tactile_ros.nodes.enrolment_server import EnrolmentClient, EnrolRequest

    assert spec.new_class is not None
    label, number = spec.new_class.label, _new_class(spec)
    with EnrolmentClient(spec.key) as client:
        client.wait_for_truth(lambda truth: bool(truth.label == number), SHOWN_S)
        say(f'something unknown presses: enrolling it as {label!r}')
        request = EnrolRequest(label, spec.new_class.presses, LEARNED_S)
        learned = client.enrol(request, lambda _, said: say(said))
    if not learned.success:
        raise TactileError(learned.message)
    say(learned.message)


def outcome(loaded: LoadedRecording, number: int) -> list[str]:
    """Sentences on how windows of known classes and of the new one were named live."""
    live, stamps = loaded.contacts, loaded.recording.stamp_ns
    if live is None or stamps is None or not loaded.changes:
        return []
    label = np.asarray(loaded.recording.truth['label'], np.int64)[live.rows]
    since = stamps[live.rows] > loaded.changes[0].last_ns
    # the last frame of a window has the place, or the name where no place is estimated
    named = np.isfinite(live.states.position[:, 0]) | (live.states.label >= 0)
    named &= live.states.in_contact == 1
    old, new = named & (label >= 0) & (label != number), named & (label == number)
    name, right = loaded.changes[0].label, live.states.label == label
    return [
        f'{what}: {(right & rows).sum()} of {rows.sum()} windows named rightly'
        for what, rows in (
            ('known heads before enrolment', old & ~since), (f'{name} before it', new & ~since),
            (f'{name} after it', new & since), ('known heads after it', old & since),
        )
    ]  # fmt: skip
