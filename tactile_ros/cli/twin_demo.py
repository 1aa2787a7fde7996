"""A simulated sensor through its real driver and the real graph, recorded, replayed, reported."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.cli.record import wait, wait_for_frames
from tactile_ros.cli.replay import evaluate, print_result
from tactile_ros.cli.twin_lesson import outcome, teach
from tactile_ros.errors import TactileError
from tactile_ros.evaluation.benchmark import environment
from tactile_ros.evaluation.recording_files import load
from tactile_ros.evaluation.result import Result
from tactile_ros.sensors import load_sensor

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from tactile_ros.pipeline import Pipeline

PLAYED_S = 20.0
# rows, and readings in them, for a fit of seconds
MOST_ROWS, MOST_READINGS = 5000, 200_000
# Hz; at higher rates one process reads and estimates, by direct calls
RATE_OF_PROCESSES = 250.0
NOTES = (
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
    pipeline = fit(key, seed + 1, path)
    say(began, f'twin of {key}, seed {seed}: {seconds:g} s through driver, nodes and recorder')
    play(key, seed, path, output / 'bags' / key, seconds, lambda said: say(began, said))
    say(began, 'replaying the bag')
    loaded = load(output / 'bags' / key).recordings[0]
    summary = f'Presses of seed {seed} on a twin, in a simple signal; calibrated on others.'
    dataset = evaluate(loaded, [pipeline], summary, key)
    command = f'tactile demo --sensor {key} --seed {seed}'
    title = f'A simulated {key} through the real graph'
    from tactile_ros.cli.models import sentences
    from tactile_ros.evaluation.report import write_report

    rate = f'The twin sends {demo_rate(key):g} frames a second.'
    learned = outcome(loaded, _new_class(key))
    notes = (*NOTES, rate, *learned, *sentences(pipeline.report))
    result = Result(title, command, environment(), (dataset,), notes)
    said = sys.stderr if as_json else sys.stdout
    print_result(result, as_json=as_json)
    print(f'  {key}: {NOTES[0]} {rate}', file=said)
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


def fit(key: str, seed: int, path: Path) -> Pipeline:
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


def play(
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
