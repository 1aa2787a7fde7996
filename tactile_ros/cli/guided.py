# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Guided calibration of `tactile calibrate --live`: targets on a page, presses, a fit, a report.

The folder beside the calibration holds every press as soon as it is over, so that the same command
goes on after a crash.
"""

from __future__ import annotations

import argparse
import csv
import json
import re
import shlex
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tactile_ros import errors
from tactile_ros.cli import interruptible
from tactile_ros.devices.transport import SerialPort
from tactile_ros.evaluation import fleet
from tactile_ros.evaluation.bag import write_recording
from tactile_ros.evaluation.guided import (
    FOLDS,
    UNKNOWN,
    HeldOut,
    Phase,
    PressGuide,
    Target,
    Truth,
    grid_of,
    held_out,
    joined,
    where_in_words,
)
from tactile_ros.evaluation.recording_files import LoadedRecording, load_recording, save_recording
from tactile_ros.evaluation.report import Result, for_drawing, provenance, write_report
from tactile_ros.files import temporary_folder, write_atomically
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import SensorSpec
from tactile_ros.types import Array, Frame, Layout, Recording, SensorConfig
from tactile_ros.view.page_server import PageServer

G = 9.80665  # m/s2
READ_S, SCALE_S, LOOK_S = 1.0, 0.5, 0.1
PRESSES, ROUND, LEAST = 24, 8, 6  # of a plan; between two looks at the error; for the first look
ROUNDS = 3  # in which places are pressed again
MOST_PRESSES, MOST_HOLD_S, MOST_BYTES = 10_000, 30.0, 10_000_000
NEWTONS = {'': 1e-3 * G, 'g': 1e-3 * G, 'kg': G, 'n': 1.0}
READING = re.compile(  # a number of another unit is none
    rb'([-+]?)\s*(\d+(?:\.\d+)?)\s*(?:(kg|g|N)\b|(?![\d.]|\s*[a-z]))', re.IGNORECASE
)
SESSION = 'session.json'
SOURCES = 'prompts, weights:50,100,200 (g), scale:PORT or topic:/NAME'


class Weights(Truth):
    """Weights that are laid on the target in turn."""

    def __init__(self, grams: str) -> None:
        try:
            masses = [float(word) for word in grams.split(',')]
        except ValueError:
            masses = []
        if not masses or not all(0 < mass < 1e5 for mass in masses):
            raise ValueError(f'weights must be grams with commas (50,100,200); received {grams!r}')
        self.loads = tuple(1e-3 * G * mass for mass in masses)


class Scale(Truth):
    """A scale below the sensor that prints its reading (g, kg or N) in lines."""

    columns = ('force',)

    def __init__(self, port: str) -> None:
        self._port, self._load, self._read_s = SerialPort(port, 9600), float('nan'), 0.0
        self._port.open()
        self._over = False
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _listen(self) -> None:
        rest = b''
        while not self._over:
            try:
                *lines, rest = (rest + self._port.read(READ_S)).split(b'\n')
            except errors.DeviceError:
                return  # `now` says that nothing comes
            rest = rest[-1000:]
            for found in filter(None, map(READING.search, lines)):
                sign, digits, unit = found.groups()
                self._load = float(sign + digits) * NEWTONS[(unit or b'').decode().lower()]
                self._read_s = time.monotonic()

    def now(self) -> tuple[Array, Array | None]:
        """Load along z; NaN where the scale has been silent."""
        fresh = time.monotonic() - self._read_s < SCALE_S
        return np.array([np.nan, np.nan, self._load if fresh else np.nan]), None

    def close(self) -> None:
        """Let the port go."""
        self._over = True
        self._thread.join()
        self._port.close()


class SimulatedPresses(Truth):
    """Presses of a simulated sensor, which follow the guide: each played up to its peak."""

    def __init__(self, recording: Recording) -> None:
        self._recording, press = recording, recording.truth['repetition']
        touched = recording.truth['in_contact'] == 1
        change = np.nan_to_num(recording.values - recording.values[0])
        size = np.where(touched, np.square(change).sum(axis=(1, 2)), -1.0)
        self.starts, self.peaks = [], []
        for one in np.unique(press[touched]).tolist():
            rows = np.flatnonzero(touched & (press == one))
            self.starts.append(int(rows[0]))
            self.peaks.append(int(rows[size[rows].argmax()]))
        self._pressed: tuple[int, float] | None = None
        self._row = 0

    @property
    def targets(self) -> list[Target]:
        """Places of the presses."""
        truth, nowhere = self._recording.truth, np.full((len(self._recording), 3), np.nan)
        return [Target(np.asarray(truth.get('position', nowhere)[row])) for row in self.peaks]

    def follow(self, phase: Phase, number: int | None) -> None:
        """Press in the phases of a press."""
        down = number is not None and phase in (Phase.PRESS, Phase.HOLD)
        if down and self._pressed is None and number is not None:
            self._pressed = (number, time.monotonic())
        elif not down:
            self._pressed = None

    def signal(self, _: float) -> Array:
        """Readings (t, c) now."""
        pressed, self._row = self._pressed, 0
        if pressed is not None:
            number, began = pressed
            steps = round((time.monotonic() - began) * (self._recording.layout.rate_hz or 100.0))
            self._row = min(self.starts[number] + steps, self.peaks[number])
        return np.asarray(self._recording.values[self._row])

    def now(self) -> tuple[Array, Array | None]:
        """Force of what is played."""
        force = self._recording.truth.get('force')
        return (UNKNOWN if force is None else force[self._row]), None


class Folder(NamedTuple):
    """Files of a session beside its calibration."""

    path: Path

    def begin(
        self, stated: dict[str, object], layout: Layout, *, overwrite: bool
    ) -> list[tuple[int, Recording]]:
        """Make the folder, or take the presses of a session that began with the same options.

        Raises RecordingError if it holds something else.
        """
        file = self.path / SESSION
        if self.path.exists() and any(self.path.iterdir()):
            found = self._stated()
            if found != stated and not (overwrite and file.is_file()):
                what = 'a session with other options' if found else 'something else'
                raise errors.RecordingError(f'{self.path} holds {what}; name another output')
            if found == stated:
                count = len(stated.get('targets', ()))  # type: ignore[arg-type]
                files = sorted(self.path.glob('press_*.npz'))[:MOST_PRESSES]
                return [self._press(one, layout, count) for one in files]
            for old in self.path.glob('press_*.npz'):  # --overwrite, of a session of ours
                old.unlink()
        self.path.mkdir(parents=True, exist_ok=True)
        write_atomically(file, json.dumps(stated, indent=1).encode())
        return []

    def _stated(self) -> object:
        file = self.path / SESSION
        if not file.is_file():
            return None
        try:
            with file.open('rb') as opened:
                return json.loads(opened.read(MOST_BYTES))
        except (ValueError, RecursionError) as error:
            raise errors.RecordingError(f'{file} is no session; name another output') from error

    @staticmethod
    def _press(file: Path, layout: Layout, count: int) -> tuple[int, Recording]:
        press = load_recording(file)
        number = press.truth.get('repetition', np.full(1, -1.0))[0]
        places = press.layout.positions
        same = press.layout.shape == layout.shape and np.allclose(places, layout.positions)
        if not (same and 0 <= number < count):
            raise errors.RecordingError(f'{file} is no press of this session; name another output')
        return int(number), press

    def write(self, count: int, press: Recording) -> None:
        """Write a press."""
        save_recording(press, self.path / f'press_{count:04d}.npz')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of a guided calibration."""
    live = parser.add_argument_group('guided (--live)', 'press where page and terminal say')
    live.add_argument('--live', action='store_true', help='read the sensor instead of recordings')
    live.add_argument('--sensor', dest='key', help='key of the sensor')
    live.add_argument('--port', help='its port or I2C bus; none: simulated presses')
    live.add_argument('--plan', type=Path, help='csv with the columns x, y (m), and load (N)')
    live.add_argument('--pose', default='', help='topic of the true position (PoseStamped)')
    live.add_argument('--presses', type=int, default=PRESSES, help=f'how many ({PRESSES})')
    live.add_argument('--hold', type=float, default=1.0, help='time to hold a press (s)')
    live.add_argument('--goal-mm', type=float, help='wanted error of position (mm)')
    live.add_argument('--goal-n', type=float, help='wanted error of force (N)')
    live.add_argument('--seed', type=int, default=0, help='seed of simulated presses')
    live.add_argument('--page', type=int, default=8765, help='port of the page (0: any)')


def _refuse(options: argparse.Namespace) -> None:
    for name, low, high in (
        ('presses', 2, MOST_PRESSES), ('hold', 0.05, MOST_HOLD_S), ('page', 0, 65535),
        ('goal_mm', 1e-6, 1e6), ('goal_n', 1e-6, 1e6),
    ):  # fmt: skip
        value = getattr(options, name)
        if value is not None and not low <= value <= high:
            word = name.replace('_', '-')
            raise ValueError(f'--{word} must be {low:g} to {high:g}; received {value}')
    if options.output.suffix != '.npz':
        raise ValueError(f'-o must end in .npz; received {str(options.output)!r}')
    if not options.port and (options.truth or options.plan or options.pose):
        msg = '--truth, --plan and --pose need --port: a simulated sensor presses itself'
        raise ValueError(msg)


def truth_of(options: argparse.Namespace, simulated: SimulatedPresses | None) -> Truth:
    """Source of the truth that is named."""
    if simulated is not None:
        return simulated
    kind, _, name = (options.truth[0] if options.truth else 'prompts').partition(':')
    if kind == 'weights':
        return Weights(name)
    if kind == 'scale' and name:
        return Scale(name)
    if (kind == 'topic' and name) or options.pose:
        try:
            from tactile_ros.nodes.truth_node import TruthTopics
        except ImportError as error:
            msg = 'topics need ROS 2; use weights, a scale or prompts, or set up with make'
            raise errors.MissingPackageError(msg) from error
        heard: Truth = TruthTopics(name if kind == 'topic' else '', options.pose)
        return heard
    if kind != 'prompts' or name:
        raise ValueError(f'--truth of --live must be {SOURCES}; received {options.truth[0]!r}')
    return Truth()


def targets_of(options: argparse.Namespace, spec: SensorSpec, config: SensorConfig,
               truth: Truth) -> list[Target]:  # fmt: skip
    """Targets of a plan: those of a file, of the simulated presses, or a grid."""
    if isinstance(truth, SimulatedPresses):
        return truth.targets[: options.presses]
    loads = truth.loads or (np.nan,)
    if options.plan is not None:
        asked = read_plan(options.plan)
    else:
        asked = [Target(place) for place in grid_of(spec.layout(config), options.presses)]
    return [
        one if np.isfinite(one.load) else Target(one.position, loads[i % len(loads)])
        for i, one in enumerate(asked)
    ]


def read_plan(path: Path) -> list[Target]:
    """Targets of a csv file; ValueError if it has no columns x and y of numbers."""
    try:
        with path.open(newline='', encoding='utf-8-sig') as file:  # tables begin with a mark
            rows = list(islice(csv.DictReader(file), MOST_PRESSES + 1))
        targets = [
            Target(
                np.array([float(row['x']), float(row['y']), float(row.get('z') or 0)]),
                float(row.get('load') or 'nan'),
            )
            for row in rows
        ]
    except (KeyError, TypeError, ValueError, csv.Error, UnicodeDecodeError) as error:
        raise ValueError(f'plan {path} must have columns x, y (m) of numbers: {error}') from error
    if not targets or not all(np.isfinite(one.position).all() for one in targets):
        raise ValueError(f'plan {path} must name places; received {len(targets)} rows')
    if len(targets) > MOST_PRESSES:
        raise ValueError(f'plan {path} must have at most {MOST_PRESSES} rows')
    if any(one.load <= 0 for one in targets):
        raise ValueError(f'plan {path} must have loads above zero (N), or none')
    return targets


class Judge:
    """Held-out errors, found in a thread while presses go on."""

    def __init__(self, make: Callable[[], Pipeline]) -> None:
        self._make, self._thread = make, threading.Thread()
        self.found: HeldOut | None = None
        self.first: Pipeline | None = None  # which did not see the first quarter of the places
        self.of = self.least = 0  # presses that it was found from; fewer are given up
        self.failure = ''  # why the last look found nothing
        self.fit_s = 0.0  # of one fit; 0: not known yet

    @property
    def busy(self) -> bool:
        """True while it looks."""
        return self._thread.is_alive()

    def begin(self, guide: PressGuide) -> None:
        """Judge the presses of a guide, unless it is still busy."""
        if not self.busy:
            what = list(guide.presses), list(guide.targets)
            self._thread = threading.Thread(target=self._work, args=what, daemon=True)
            self._thread.start()

    def _work(self, presses: Sequence[tuple[int, Recording]], targets: Sequence[Target]) -> None:
        begun: list[float] = []  # fits

        def pipeline() -> Pipeline:
            if len(presses) < self.least:
                raise errors.RecordingError('more presses came meanwhile')
            begun.append(time.monotonic())
            self.fit_s = begun[-1] - begun[-2] if len(begun) > 1 else self.fit_s
            made = self._make()
            self.first = made if len(begun) == 1 else self.first
            return made

        try:
            self.found, self.failure = held_out(pipeline, presses, targets), ''
        except (errors.TactileError, ValueError, ArithmeticError) as error:
            self.failure = str(error)
        finally:
            self.of = len(presses)


class Session:
    """One guided calibration: what is read goes to guide, page, folder and terminal."""

    def __init__(
        self, guide: PressGuide, truth: Truth, folder: Folder, page: PageServer, judge: Judge,
        nominal: Pipeline,
    ) -> None:  # fmt: skip
        self.guide, self.truth, self.folder, self.page = guide, truth, folder, page
        self.judge, self.nominal, self._last_line = judge, nominal, ''

    def follow(self, read: Callable[[], Frame], options: argparse.Namespace) -> None:
        """Guide until every press is done and the error is as wanted, or no round is left."""
        for again in range(ROUNDS + 1):
            while self.guide.phase is not Phase.DONE:
                self.step(read)
            found = self.judged()
            self.log(f'error on places held out: {found}')
            worst = found.worst(options.goal_mm and 1e-3 * options.goal_mm, options.goal_n)
            if not worst or again == ROUNDS or (again and not (options.goal_mm or options.goal_n)):
                return
            numbers = sorted({self.guide.presses[i][0] for i in worst})
            places = np.array([self.guide.targets[i].position for i in numbers])
            every = np.array([one.position for one in self.guide.targets])
            self.log(f'{len(numbers)} more presses {where_in_words(places, every)}')
            self.guide.repeat(numbers)

    def judged(self) -> HeldOut:
        """Errors of all presses, waited for."""
        judge, count = self.judge, len(self.guide.presses)
        judge.least = count
        while judge.busy or judge.of < count:
            judge.begin(self.guide)
            self.wait('judging on places held out', FOLDS * judge.fit_s)
            time.sleep(LOOK_S)
        if judge.found is None or judge.failure:
            raise errors.RecordingError(f'nothing can be fitted: {judge.failure}')
        return judge.found

    def wait(self, what: str, seconds: float) -> None:
        """Tell page and terminal what is computed, and how long it takes once that is known."""
        text = f'{what}, about {seconds:.0f} s' if seconds else what
        self.page.guide({**self.as_json(), 'text': text})
        self.log(text)

    def step(self, read: Callable[[], Frame]) -> None:
        """Take the next frame."""
        try:
            frame = read()
        except errors.DeviceTimeout as error:
            self.log(str(error))
            return
        guide, judge = self.guide, self.judge
        before = guide.preflight
        self.truth.follow(guide.phase, guide.number)
        press = guide.step(frame, *self.truth.now())
        if guide.preflight is not before and guide.preflight is not None:
            for problem in guide.preflight.problems:
                self.log(problem)
        if press is not None:
            self.folder.write(len(guide.presses), press)
            if self.truth.silent(press):
                self.log('no truth came for this press: look at its source')
            if judge.failure:
                self.log(f'no error is known yet: {judge.failure}')
            if len(guide.presses) >= LEAST and len(guide.presses) % ROUND == 0:
                judge.begin(guide)
        self.log(self.instruction())
        self.page.guide(self.as_json())  # first: a nominal model may have to be made
        self.page.show('', guide.layout, frame, self.nominal.process(frame))

    def instruction(self) -> str:
        """Sentence on what to do now."""
        guide, number = self.guide, self.guide.number
        if number is None or guide.phase in (Phase.CHECK, Phase.DONE):
            return guide.phase.value
        target = guide.targets[number]
        x, y = 1e3 * target.position[:2]
        place = f' at x {x:.1f}, y {y:.1f} mm' if np.isfinite(x) else ''
        load = f' with {1e3 * target.load / G:.0f} g' if np.isfinite(target.load) else ''
        text = {
            Phase.PRESS: f'press{place}{load}', Phase.HOLD: f'hold{load}',
        }.get(guide.phase, guide.remark or guide.phase.value)  # fmt: skip
        return f'{len(guide.presses) + 1} of {guide.wanted.sum()}: {text}'

    def as_json(self) -> dict[str, object]:
        """State of the guide for the page."""
        guide, judge = self.guide, self.judge
        checked = guide.preflight.problems if guide.preflight else ()
        error = f'held out: {judge.found}' if judge.found else judge.failure or '; '.join(checked)
        return {
            'targets': [
                [*np.nan_to_num(one.position[:2]).tolist(), int(count)]
                for one, count in zip(guide.targets, guide.counts, strict=True)
            ],
            'next': guide.number, 'phase': guide.phase.name.lower(),
            'text': self.instruction(), 'error': error,
        }  # fmt: skip

    def log(self, text: str) -> None:
        """Print a line on stderr, once."""
        if text != self._last_line:
            self._last_line = text
            print(text, file=sys.stderr, flush=True)


def run(options: argparse.Namespace, spec: SensorSpec, config: SensorConfig) -> Pipeline:
    """Guide through the presses, fit, write calibration, bag and report."""
    _refuse(options)
    folder = Folder(options.output.with_suffix(''))
    recording = None if options.port else spec.presses(config, options.seed, noise=0.0)
    simulated = None if recording is None else SimulatedPresses(recording)
    with ExitStack() as held:
        truth = held.enter_context(truth_of(options, simulated))
        targets = targets_of(options, spec, config, truth)
        stated = {
            'sensor': spec.key, 'truth': options.truth, 'hold_s': options.hold,
            'targets': [[*map(float, one.position), one.load] for one in targets],
        }  # fmt: skip
        stated = json.loads(json.dumps(stated).replace('NaN', 'null'))
        layout = spec.layout(config)
        presses = folder.begin(stated, layout, overwrite=options.overwrite)
        guide = PressGuide(layout, targets, truth.steady, options.hold, presses)
        page = held.enter_context(PageServer(options.page, option='--page'))
        print(f'showing {page.address} ; Ctrl-C stops, the same command goes on', file=sys.stderr)
        if presses:
            print(f'going on after {len(presses)} presses', file=sys.stderr)
        connection = spec.connection()
        if simulated is None:
            connection = connection.at(options.port)
            device = held.enter_context(spec.open(config, connection, time.time_ns))
        else:
            twin = spec.simulate(config, connection, simulated.signal, options.seed)
            device = held.enter_context(held.enter_context(twin).device(time.time_ns))
        judge = Judge(lambda: spec.pipeline(config, options.estimator))
        session = Session(guide, truth, folder, page, judge, spec.pipeline(config))
        with interruptible():
            session.follow(lambda: device.read(READ_S), options)
        return finish(options, spec, config, session)


def finish(
    options: argparse.Namespace, spec: SensorSpec, config: SensorConfig, session: Session
) -> Pipeline:
    """Fit on all presses; write calibration, bag and a report on places held out."""
    folder, fit_s = session.folder.path, session.judge.fit_s
    whole = joined(session.guide.presses, session.guide.targets)
    pipeline = spec.pipeline(config, options.estimator)
    session.wait(f'fitting {spec.key}', fit_s * FOLDS / (FOLDS - 1))
    pipeline.fit(whole)
    if not pipeline.estimators:
        names = ', '.join(sorted(whole.truth))
        raise errors.RecordingError(f'nothing can be learned from {folder}: truth has {names}')
    pipeline.save(options.output)
    save_recording(whole, folder / 'presses.npz')
    place = folder / f'bag_{pipeline.digest[:8]}'  # one for each fit: none is replaced
    if not place.exists():
        with temporary_folder(place) as bag:
            write_recording(whole, bag)
    apart, others = np.isin(whole.truth['repetition'] % FOLDS, 0), session.judge.first
    if others is None:
        print('all presses are at one place: no report on others', file=sys.stderr)
        return pipeline
    session.wait('drawing the report', 0.0)
    loaded = LoadedRecording('every fourth place, held out', whole.select(apart))
    found = fleet.evaluate(loaded, {'calibration on the other places': others})
    command = shlex.join(['tactile', *sys.argv[1:]])
    facts = provenance([str(folder / 'presses.npz')], {options.output.name: pipeline})
    result = Result('Guided calibration', command, facts, (for_drawing(found),))
    write_report(folder / 'report.html', result)
    print(f'presses, bag and report of every fourth place in {folder}', file=sys.stderr)
    print('held out in the table: frames, in folds of the fit itself', file=sys.stderr)
    return pipeline
