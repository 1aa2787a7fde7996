# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The pipeline with a small estimation of its own: live and batch, baseline, fit, files."""

import os
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tactile_ros.calibration import Arrays, digest, flatten, read, write
from tactile_ros.errors import CalibrationError
from tactile_ros.estimators import regression
from tactile_ros.pipeline import Pipeline, add_patches, apply_contact
from tactile_ros.sensors import load_sensor
from tactile_ros.types import (
    STATE_FIELDS,
    Columns,
    ContactState,
    ContactStates,
    Estimation,
    Frame,
    FrameStatus,
    Layout,
    Recording,
    Report,
    Signals,
    TaxelStatus,
    field_shape,
)

CONTACT = np.array([1, 0, -1, -1, 0], np.int8)
GOOD = np.array([True, True, True, False, False])
FIELDS = [
    name
    for name in STATE_FIELDS
    if name not in ('valid', 'status', 'taxel_status', 'in_contact')
    and not name.startswith('contacts_')
]


def estimate(name: str) -> np.ndarray:
    shape = (len(CONTACT), *field_shape(name, 2))
    return np.full(shape, 3, STATE_FIELDS[name][1])


@pytest.mark.parametrize('name', FIELDS)
def test_the_untouched_and_the_unusable(name: str) -> None:
    known = {name: estimate(name)}
    apply_contact(known, CONTACT, GOOD)
    blank = STATE_FIELDS[name][2]
    free: float = blank
    if name in ('force', 'torque', 'taxel_force', 'deformation'):
        free = 0.0
    elif name in ('force_cov', 'torque_cov', 'stray_field', 'slip', 'slip_probability'):
        free = 3.0
    for row, wanted in enumerate([3.0, free, 3.0, blank, blank]):
        np.testing.assert_array_equal(known[name][row], np.full_like(known[name][row], wanted))


def signals_of(delta: np.ndarray, good: np.ndarray) -> Signals:
    rows = len(delta)
    contact = np.zeros(rows, np.int8)
    rest = np.zeros_like(delta)
    return Signals(delta, delta, rest, None, None, np.ones(rows, bool), contact, good)


def flagged(known: dict[str, np.ndarray], signals: Signals, bits: np.ndarray) -> None:
    """Add the flags of a calibrated pipeline with a baseline."""
    pipeline = toy()
    pipeline.estimation.weights_ = np.zeros((6, 3))
    pipeline._add_flags(known, signals, bits)


def test_an_estimation_may_say_itself_that_a_frame_is_not_to_be_used() -> None:
    delta = np.zeros((3, 2, 3))
    signals = signals_of(delta, np.ones(3, bool))
    known = {'valid': np.array([True, False, True])}
    bits = np.zeros((3, 2), np.uint8)
    bits[2] = TaxelStatus.STALE
    apply_contact(known, signals.in_contact, signals.good)
    flagged(known, signals, bits)
    assert known['valid'].tolist() == [True, False, False]


@pytest.mark.parametrize('flag', list(FrameStatus))
def test_each_flag(flag: FrameStatus) -> None:
    known: dict[str, np.ndarray] = {'status': np.array([int(flag)])}
    bits = np.zeros((1, 2), np.uint8)
    flagged(known, signals_of(np.zeros((1, 2, 3)), np.ones(1, bool)), bits)
    forbidding = {
        FrameStatus.NOT_CALIBRATED, FrameStatus.BAD_TAXELS, FrameStatus.SATURATED,
        FrameStatus.STALE,
    }  # fmt: skip
    assert bool(known['valid'][0]) == (flag not in forbidding)


def test_the_one_patch_is_where_the_contact_is() -> None:
    force, cov = np.arange(9.0).reshape(3, 3), np.arange(27.0).reshape(3, 3, 3)
    known = {'force': force, 'force_cov': cov}
    add_patches(known, np.array([0, -1, 1]))
    assert known['contacts_id'].tolist() == [[0], [-1], [1]]
    np.testing.assert_array_equal(known['contacts_force'][:, 0][[0, 2]], force[[0, 2]])
    np.testing.assert_array_equal(known['contacts_force_cov'][:, 0][[0, 2]], cov[[0, 2]])
    np.testing.assert_array_equal(known['contacts_normal'][2, 0], [0, 0, 1])
    for name in ('contacts_force', 'contacts_force_cov', 'contacts_normal'):
        assert np.isnan(known[name][1]).all()
    assert 'contacts_position' not in known
    own = {'contacts_id': np.array([[4, 5]]), 'force': np.zeros((1, 3))}
    add_patches(own, np.array([0]))
    assert own['contacts_id'].tolist() == [[4, 5]]


SENSOR = load_sensor('reskin_board')
HYPOTHESIS = {'suppress_health_check': [HealthCheck.function_scoped_fixture, HealthCheck.too_slow]}


@lru_cache
def pipeline_of(estimator: str) -> Pipeline:
    rng = np.random.default_rng(0)
    hidden = rng.uniform(-1, 1, (40, 3))
    delta = 1e-3 * np.tanh(hidden @ rng.normal(size=(3, 15))).reshape(40, 5, 3)
    delta[::10] = 0.0
    place = np.column_stack([0.01 * hidden[:, :2], np.full(40, np.nan)])
    config = SENSOR.config()
    recording = Recording.from_arrays(
        SENSOR.layout(config), 5e-3 + delta, stamp_ns=np.arange(40) * 10_000_000,
        tare=np.arange(40) % 10 == 0, truth={'position': place, 'force': hidden},
    )  # fmt: skip
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(regression, 'FEWEST_STEPS', 50)  # how well it estimates is not asked here
        return SENSOR.pipeline(config, estimator).fit(recording)


@lru_cache
def stored(estimator: str, folder: str) -> Arrays:
    path = f'{folder}/{estimator}.npz'
    pipeline_of(estimator).save(path)
    return read(path)


@pytest.fixture(scope='module', params=SENSOR.estimator_names)
def arrays(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Arrays:
    """Members of a calibration with each of the estimators."""
    return stored(request.param, os.fspath(tmp_path_factory.mktemp('stored')))


def refused_or_usable(path: Path) -> None:
    """A file may be refused; one that is loaded must be good for every frame."""
    try:
        pipeline = SENSOR.load(path)
    except CalibrationError:
        return
    rng = np.random.default_rng(1)
    values = 5e-3 + 1e-3 * rng.normal(size=(4, *pipeline.layout.shape))
    frames = Recording.from_arrays(pipeline.layout, values, stamp_ns=np.arange(4))
    pipeline.process_batch(frames).refuse_misfit(len(values[0]))
    for row in range(4):
        pipeline.process(frames.frame(row))


def test_it_goes_there_and_back(arrays: Arrays, tmp_path: Path) -> None:
    write(tmp_path / 'c.npz', arrays)
    pipeline = SENSOR.load(tmp_path / 'c.npz')
    assert pipeline.calibrated
    pipeline.save(tmp_path / 'again.npz')
    assert digest(read(tmp_path / 'again.npz')) == digest(arrays)


MAD = st.sampled_from([
    np.zeros(0), np.array(0), np.array(-1), np.array(10**15), np.array(np.nan), np.array(np.inf),
    np.zeros((2, 2)), np.zeros((5, 3)), np.zeros((1, 1, 1)), np.array('x'), np.array(['a', 'b']),
    np.array(True), np.full((5, 3), np.nan), np.array([3]), np.array('Pipeline'), np.array('\x7f'),
])  # fmt: skip
KINDS = st.sampled_from([None, 'array', 'scalar', 'none', 'tuple', 'list', 'dict', 'class'])


@settings(max_examples=25, **HYPOTHESIS)  # type: ignore[arg-type]
@given(st.lists(st.tuples(st.integers(0, 10**6), KINDS, MAD, st.integers(0, 5)), max_size=3))
def test_mad_members_are_refused_or_usable(
    arrays: Arrays, tmp_path: Path, hurts: list[tuple[int, str | None, np.ndarray, int]]
) -> None:
    names, hurt = sorted(arrays), dict(arrays)
    for number, kind, mad, way in hurts:
        name = names[number % len(names)]
        array = hurt.pop(name, None)
        if kind is not None:
            name = f'{name.rpartition(".")[0]}.{kind}'
        if array is not None and array.dtype.kind == 'f' and way < 3:
            hurt[name] = [array[..., None], array.ravel(), -array][way]
        else:
            hurt[name] = mad
    write(tmp_path / 'c.npz', hurt)
    with np.errstate(all='ignore'):
        refused_or_usable(tmp_path / 'c.npz')


def test_an_axis_too_many_is_refused_where_as_many_rows_would_fit_it(tmp_path: Path) -> None:
    name = 'estimation/heads_/0/covariance_/correlation_.array'
    arrays = stored('kernel_ridge', os.fspath(tmp_path))
    write(tmp_path / 'c.npz', {**arrays, name: arrays[name][..., None]})
    with pytest.raises(CalibrationError, match='does not work'):
        SENSOR.load(tmp_path / 'c.npz')


@pytest.mark.parametrize(
    ('part', 'tree', 'match'),
    [
        ('sensor', 'gradiometer', "must be of reskin_board; it is of 'gradiometer'"),
        ('sensor', None, "it is of 'None'"),
        ('sensor', 3, "it is of '3'"),
        ('sensor', 'x' * 500, f"it is of '{'x' * 60}'"),
        ('layout', 'hello', 'has no layout'),
        ('layout', None, 'has no layout'),
        ('config', {'positions': 3}, 'has no layout'),
        ('estimation', (1, 2), 'has no layout'),
        ('estimation', SENSOR.layout(SENSOR.config()), 'has no layout'),
        *[
            ('left_out_', tree, 'left out is no table of counts')
            for tree in (None, 'hello', {'rows': 'many'}, [1.0], {'rows': {'a': 1.0}})
        ],
    ],
)
def test_parts_of_another_kind(tmp_path: Path, part: str, tree: object, match: str) -> None:
    whole = stored('grid_knn', os.fspath(tmp_path))
    rest = {k: v for k, v in whole.items() if k.split('.')[0].split('/')[0] != part}
    write(tmp_path / 'c.npz', {**rest, **flatten(tree, part)})
    with pytest.raises(CalibrationError, match=match):
        SENSOR.load(tmp_path / 'c.npz')


@pytest.mark.parametrize('name', ['baseline', 'noise', 'scale', 'temperature_c'])
def test_another_shape_is_refused_with_both_named(tmp_path: Path, name: str) -> None:
    whole = dict(stored('grid_knn', os.fspath(tmp_path)))
    whole.pop(f'rest_/{name}.none', None)
    tail, wanted = ((), r'\(5,\)') if name == 'temperature_c' else ((3,), r'\(5, 3\)')
    whole[f'rest_/{name}.array'] = np.zeros((4, *tail))
    write(tmp_path / 'c.npz', whole)
    with pytest.raises(CalibrationError, match=rf'{name} .*{wanted}; received \(4,'):
        SENSOR.load(tmp_path / 'c.npz')


def test_the_tower_of_names_ends(tmp_path: Path) -> None:
    """A list inside a list inside a list, as deep as names allow, is no way to hang a reader."""
    whole = dict(stored('grid_knn', os.fspath(tmp_path)))
    name = 'estimation/heads_'
    while len(name) < 180:
        whole[f'{name}.tuple'] = np.array(10**18)
        name += '/0'
    write(tmp_path / 'c.npz', whole)
    with pytest.raises(CalibrationError):
        SENSOR.load(tmp_path / 'c.npz')


TAXELS, CHANNELS = 2, 3
SHAPE = (TAXELS, CHANNELS)
REST = np.arange(6.0).reshape(SHAPE)
NOISE = 0.01
SECOND_NS = 1_000_000_000


@dataclass(frozen=True)
class ToyConfig:
    """Just what every sensor's config has."""

    noise: float | np.ndarray | None = NOISE
    track_baseline: bool = True
    positions: np.ndarray = field(default_factory=lambda: np.zeros((TAXELS, 3)))


class ToyEstimation(Estimation):
    """Force is linear in the change; position is the mean change since the stream began."""

    def __init__(self) -> None:
        self.weights_: np.ndarray | None = None
        self.rows_ = 0

    @property
    def estimators(self) -> dict[str, str]:
        return {} if self.weights_ is None else {'force': 'linear', 'position': 'mean'}

    @property
    def report(self) -> Report:
        return {'force': {'rows': float(self.rows_)}}

    def fit(self, signals: Signals, truth: Columns, groups: Columns) -> None:
        assert set(groups) == {'group', 'session'}
        blank = np.full((len(signals.good), 3), np.nan)
        force = np.asarray(truth.get('force', blank), float)
        rows = signals.good & np.isfinite(force).all(axis=1)
        self.rows_ = int(rows.sum())
        if self.rows_:
            x = signals.delta[rows].reshape(self.rows_, -1)
            self.weights_ = np.linalg.lstsq(x, force[rows], rcond=None)[0]

    def start(self) -> dict[str, np.ndarray]:
        return {'sum': np.zeros(3), 'count': np.zeros(1)}

    def estimate(self, signals: Signals, memory: object) -> Columns:
        assert isinstance(memory, dict)
        if self.weights_ is None:
            return {}
        delta = signals.delta
        place = np.full((len(delta), 3), np.nan)
        for row in range(len(delta) if signals.stamp_ns is not None else 0):
            if signals.restart[row]:
                memory.update(self.start())
            memory['sum'] = memory['sum'] + np.nan_to_num(delta[row].mean(axis=0))
            memory['count'] = memory['count'] + 1
            place[row] = memory['sum'] / memory['count']
        return {
            'force': delta.reshape(-1, TAXELS * CHANNELS) @ self.weights_,
            'force_cov': np.tile(0.01 * np.eye(3), (len(delta), 1, 1)),
            'position': place,
        }


CLASSES = {'ToyConfig': ToyConfig, 'ToyEstimation': ToyEstimation}
LAYOUT = Layout(np.zeros((TAXELS, 3)), ('Bx', 'By', 'Bz'), 'T', saturation=np.full(3, 100.0))
TRUE_WEIGHTS = np.random.default_rng(9).normal(size=(6, 3))


def toy(config: ToyConfig | None = None, layout: Layout = LAYOUT) -> Pipeline:
    return Pipeline('toy', config or ToyConfig(), layout, ToyEstimation())


def lessons(samples: int = 200, seed: int = 1, **columns: object) -> Recording:
    """A tare row, then frames with forces."""
    rng = np.random.default_rng(seed)
    delta = rng.normal(size=(samples, *SHAPE))
    force = delta.reshape(samples, -1) @ TRUE_WEIGHTS
    delta[0], force[0] = 0.0, np.nan
    columns = {'tare': np.arange(samples) == 0, 'truth': {'force': force}, **columns}
    return Recording.from_arrays(LAYOUT, REST + delta, **columns)  # type: ignore[arg-type]


def fitted(config: ToyConfig | None = None) -> Pipeline:
    return toy(config).fit(lessons())


def frame(values: np.ndarray, stamp_ns: int | None = None, **columns: object) -> Frame:
    return Frame(stamp_ns, 0, values, **columns)  # type: ignore[arg-type]


def assert_same(
    live: ContactState | list[ContactState], batch: ContactState | ContactStates
) -> None:
    for name in STATE_FIELDS:
        one = np.array([getattr(x, name) for x in live] if isinstance(live, list) else
                       getattr(live, name), float)  # fmt: skip
        other = np.asarray(getattr(batch, name), float)
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-9, err_msg=name)


def bits_of(state: ContactState) -> FrameStatus:
    return FrameStatus(int(state.status))


# ---------------------------------------------------------------- before a fit


def test_a_tare_before_a_fit_tells_contact_by_the_stated_noise() -> None:
    pipeline = toy()
    pipeline.tare([frame(REST)])
    assert pipeline.process(frame(REST)).in_contact == 0
    assert pipeline.process(frame(REST + 6 * NOISE)).in_contact == 1
    assert bits_of(pipeline.process(frame(REST))) == FrameStatus.NOT_CALIBRATED
    unknown = toy(ToyConfig(noise=None))
    unknown.tare([frame(REST)])
    assert unknown.process(frame(REST + 100)).in_contact == -1


# ---------------------------------------------------------------- live and batch


def stream(seed: int, samples: int = 60, stamped: bool = True) -> Recording:
    """One stream with everything that happens: tares, drift, touches, faults, gaps."""
    rng = np.random.default_rng(seed)
    step = rng.integers(5_000_000, 800_000_000, samples)
    step[rng.random(samples) < 0.05] = 20 * SECOND_NS
    values = REST + np.cumsum(rng.normal(0, 0.2 * NOISE, (samples, *SHAPE)), axis=0)
    touched = np.cumsum(rng.random(samples) < 0.08) % 2 == 1
    values[touched] += rng.normal(size=(int(touched.sum()), *SHAPE))
    values[rng.random(values.shape) < 0.005] = rng.choice([np.nan, np.inf, 1e3])
    status = rng.choice([0, 1, 4], (samples, TAXELS), p=[0.96, 0.03, 0.01])
    return Recording.from_arrays(
        LAYOUT, values, stamp_ns=np.cumsum(step) if stamped else None,
        status=status if seed % 2 else None, tare=rng.random(samples) < 0.06 if seed % 3 else None,
    )  # fmt: skip


def run_live(pipeline: Pipeline, recording: Recording) -> tuple[list[int], list[ContactState]]:
    """What a node does: a tare where a run of tare rows ends, every other frame processed."""
    pipeline.reset()
    tare = np.zeros(len(recording), bool) if recording.tare is None else recording.tare
    rows, states, resting = [], [], []
    for row in range(len(recording)):
        if tare[row]:
            resting.append(recording.frame(row))
            continue
        if resting:
            try:
                pipeline.tare(resting)
            except ValueError:  # nothing was read: frames like any other
                for one in resting:
                    pipeline.process(one)
            resting = []
        rows.append(row)
        states.append(pipeline.process(recording.frame(row)))
    return rows, states


@pytest.mark.parametrize('dead', [False, True])
@given(st.integers(0, 10_000), st.booleans(), st.booleans())
@settings(max_examples=20)
def test_one_by_one_and_in_batch_are_the_same(
    dead: bool, seed: int, stamped: bool, tracked: bool
) -> None:
    config = ToyConfig(track_baseline=tracked)
    pipeline = fitted_with_a_dead_taxel(config) if dead else fitted(config)
    recording = stream(seed, stamped=stamped)
    batch = pipeline.process_batch(recording)
    batch.refuse_misfit(TAXELS)
    rows, states = run_live(pipeline, recording)
    for row, state in zip(rows, states, strict=True):
        assert_same(state, batch[row])


def test_a_batch_leaves_the_live_stream_alone() -> None:
    one, other = fitted(), fitted()
    recording = stream(1)
    recording = recording.select(~recording.tare)  # type: ignore[operator]
    for row in range(len(recording)):
        if row == 30:
            one.process_batch(stream(2))
        assert_same(one.process(recording.frame(row)), other.process(recording.frame(row)))


@pytest.mark.parametrize('back_ns', [0, 1, 3600 * SECOND_NS])
def test_a_clock_that_goes_back_begins_a_new_stream(back_ns: int) -> None:
    recording = stream(6)
    stepped, again = fitted(), fitted()
    begin = 10_000 * SECOND_NS
    for row in range(60):
        first = replace(recording.frame(row), stamp_ns=begin + int(recording.stamp_ns[row]))
        stepped.process(first)
    shift = first.stamp_ns - back_ns - int(recording.stamp_ns[0])
    for row in range(60):
        late = replace(recording.frame(row), stamp_ns=shift + int(recording.stamp_ns[row]))
        assert_same(stepped.process(late), again.process(late))


def test_frames_without_stamps_pass_memory_by() -> None:
    one, other = fitted(), fitted()
    recording = stream(2).select(~stream(2).tare)  # type: ignore[operator]
    loose = replace(recording.frame(0), stamp_ns=None)
    for row in range(len(recording)):
        one.process(loose)
        assert_same(one.process(recording.frame(row)), other.process(recording.frame(row)))


# ---------------------------------------------------------------- baseline


def test_else_from_rows_that_truth_calls_untouched() -> None:
    recording = lessons()
    contact = np.r_[0, 0, np.ones(198, np.int8)]
    truth = {**recording.truth, 'in_contact': contact.astype(np.int8)}
    pipeline = toy().fit(Recording.from_arrays(LAYOUT, recording.values, truth=truth))
    np.testing.assert_allclose(pipeline.baseline, recording.values[:2].mean(axis=0))


def test_a_tare_leaves_out_what_was_not_read() -> None:
    pipeline = fitted()
    hurt = REST + 9.0
    hurt[0, 0] = np.nan
    clipped = np.full(SHAPE, 200.0)
    stuck = frame(REST + 50, status=np.array([0, TaxelStatus.STUCK]))
    pipeline.tare([frame(hurt), frame(clipped), stuck, frame(REST + 1)])
    wanted = np.stack([np.full(3, 0.0), np.full(3, 0.0)]) + REST
    wanted[0] += (50 + 1) / 2
    wanted[1] += (9 + 1) / 2
    np.testing.assert_allclose(pipeline.baseline, wanted)


def test_a_taxel_that_no_tare_frame_read_has_no_baseline() -> None:
    pipeline = fitted()
    hurt = REST.copy()
    hurt[1, 2] = np.nan
    pipeline.tare([frame(hurt)])
    assert np.isnan(pipeline.baseline).any(axis=1).tolist() == [False, True]
    state = pipeline.process(frame(REST, 0))
    assert FrameStatus.NO_BASELINE in bits_of(state)
    assert not state.valid
    assert state.in_contact == -1
    assert state.contacts == []
    # in a batch only the rows that it serves
    values = np.stack([hurt, REST, REST, REST])
    recording = Recording.from_arrays(
        LAYOUT, values, stream=[0, 0, 1, 1], tare=[True, False, True, False]
    )
    states = fitted().process_batch(recording)
    assert states.valid.tolist() == [False, False, True, True]
    blind = (states.status & FrameStatus.NO_BASELINE) > 0
    assert blind.tolist() == [True, True, False, False]


@pytest.mark.parametrize('track', [True, False])
def test_a_tare_that_read_nothing_leaves_the_baseline_as_it_was(track: bool) -> None:
    pipeline = fitted(ToyConfig(track_baseline=track))
    lost = np.full(SHAPE, np.nan)
    stuck = frame(REST, status=np.array([TaxelStatus.STUCK, TaxelStatus.DEAD]))
    pipeline.process(frame(REST + 1, 0))
    for unread in ([frame(lost)], [stuck], [frame(lost), stuck]):
        with pytest.raises(ValueError, match=r'usable reading; taxels \[0, 1\] .* in each of the'):
            pipeline.tare(unread)
        np.testing.assert_array_equal(pipeline.baseline, REST)
    # and the touch, known before it, goes on
    assert int(pipeline.process(frame(lost, 1)).contacts_id[0]) == 0
    # in a batch likewise: the tare before it holds on, else that of the fit
    recording = Recording.from_arrays(
        LAYOUT, np.stack([REST + 5, lost, REST + 5, lost, lost, REST]), stamp_ns=np.arange(6),
        stream=[0, 0, 0, 0, 1, 1], tare=[True, False, False, True, True, False],
    )  # fmt: skip
    assert fitted().process_batch(recording).in_contact.tolist() == [0, -1, 0, -1, -1, 0]


def test_a_fit_without_rest_uses_readings_as_they_are() -> None:
    recording = lessons(tare=None)
    pipeline = toy().fit(recording)
    states = pipeline.process_batch(stream(3))
    assert (states.in_contact == -1).all()
    assert ((states.status & FrameStatus.NO_BASELINE) > 0).all()
    assert states.valid.any()
    live = [pipeline.process(stream(3).frame(row)) for row in range(60)]
    for row, state in enumerate(live):
        assert_same(state, states[row])
    with pytest.raises(ValueError, match='must follow a fit with tare rows or in_contact 0'):
        pipeline.tare([frame(REST)])
    # and nothing is followed, however quiet it is
    for i in range(9):
        pipeline.process(frame(np.full(SHAPE, 0.5 * NOISE), i * SECOND_NS))
    assert not pipeline.baseline.any()


# ---------------------------------------------------------------- untouched, faults


def test_a_tare_ends_the_touch() -> None:
    pipeline = fitted()
    assert int(pipeline.process(frame(REST + 1, 0)).contacts_id[0]) == 0
    pipeline.tare([frame(REST)])
    assert int(pipeline.process(frame(np.full(SHAPE, np.nan), 1)).contacts_id[0]) == -1
    assert int(pipeline.process(frame(REST + 1, 2)).contacts_id[0]) == 1


# ---------------------------------------------------------------- fit


def test_fit_takes_what_a_touch_leaves_until_the_next_tare_for_rest() -> None:
    touched = np.arange(60) % 2 > 0
    level = 0.45 * np.repeat(np.arange(30), 2) + touched
    place = np.where(touched[:, None], 0.0, np.full((60, 3), np.nan))
    values, truth = REST + level[:, None, None], {'position': place}
    pipeline = toy().fit(Recording.from_arrays(LAYOUT, values, tare=~touched, truth=truth))
    pipeline.tare([frame(REST)])
    assert pipeline.process(frame(REST + 0.44)).in_contact == 0
    assert pipeline.process(frame(REST + 1.0)).in_contact == 1


def test_fit_returns_itself_and_learns() -> None:
    pipeline = toy()
    assert pipeline.fit(lessons()) is pipeline
    assert pipeline.calibrated
    assert pipeline.estimators == {'force': 'linear', 'position': 'mean'}
    assert pipeline.report == {'force': {'rows': 199.0}}
    test = lessons(50, seed=2)
    found = pipeline.process_batch(test).force[1:]
    np.testing.assert_allclose(found, test.truth['force'][1:], atol=1e-9)
    with pytest.raises(ValueError, match='at least one Recording'):
        toy().fit()


def test_fit_leaves_out_bad_and_blind_rows() -> None:
    recording = lessons()
    values = recording.values.copy()
    values[5] = np.nan
    status = np.zeros((200, TAXELS), np.uint8)
    status[7, 1] = TaxelStatus.WRAPPED
    # the second stream's tare row was not read: its rows have no baseline
    stream_of = np.arange(200) // 190
    values[190, 0] = np.nan
    spoilt = Recording.from_arrays(
        LAYOUT, values, status=status, stream=stream_of, tare=np.isin(np.arange(200), [0, 190]),
        truth=recording.truth,
    )  # fmt: skip
    report = toy().fit(spoilt).report
    assert report['force']['rows'] == 189 - 2
    assert report['left_out'] == {'rows with a faulty taxel': 3.0, 'rows without a baseline': 9.0}


def without_taxel(recording: Recording, taxel: int, reading: float) -> Recording:
    values = recording.values.copy()
    values[:, taxel] = reading
    return replace(recording, values=values)


def fitted_with_a_dead_taxel(config: ToyConfig | None = None, reading: float = np.nan) -> Pipeline:
    recording = lessons()
    force = (recording.values - REST)[:, 0] @ TRUE_WEIGHTS[:3]
    force[0] = np.nan
    return toy(config).fit(without_taxel(replace(recording, truth={'force': force}), 1, reading))


@pytest.mark.parametrize('reading', [np.nan, 0.0])
def test_a_taxel_that_was_dead_throughout_is_left_out(tmp_path: Path, reading: float) -> None:
    pipeline = fitted_with_a_dead_taxel(reading=reading)
    assert pipeline.report == {
        'force': {'rows': 199.0},
        'left_out': {'taxels faulty in every row': 1.0},
    }
    assert np.isnan(pipeline.baseline).any(axis=1).tolist() == [False, True]
    pipeline.save(tmp_path / 'c.npz')
    again = Pipeline.load(tmp_path / 'c.npz', 'toy', CLASSES)
    assert again.report == pipeline.report
    touch = REST + np.array([[1.0, 2.0, 3.0], [0.0, 0.0, 0.0]])
    mad = touch + np.array([[0.0], [50.0]])
    lost = np.where(np.arange(TAXELS)[:, None] == 1, np.nan, touch)
    for values in (touch, mad, lost):
        state = again.process(frame(values, status=np.array([0, TaxelStatus.STUCK])))
        assert bits_of(state) == FrameStatus(0)
        assert state.valid
        assert state.in_contact == 1
        assert state.taxel_status.tolist() == [0, TaxelStatus.DEAD]
        np.testing.assert_allclose(state.force, [1.0, 2.0, 3.0] @ TRUE_WEIGHTS[:3], atol=1e-9)
    assert again.process(frame(REST + np.array([[0.0], [9.0]]))).in_contact == 0
    # one that lived in the fit is missed
    state = again.process(frame(np.where(np.arange(TAXELS)[:, None] == 0, np.nan, touch)))
    assert bits_of(state) == FrameStatus.BAD_TAXELS
    assert np.isnan(state.force).all()
    again.tare([frame(np.where(np.arange(TAXELS)[:, None] == 1, np.nan, REST + 1))])
    np.testing.assert_allclose(again.baseline[0], REST[0] + 1)
    assert again.process(frame(lost)).in_contact == 1
    with pytest.raises(ValueError, match='usable reading'):
        again.tare([frame(np.where(np.arange(TAXELS)[:, None] == 0, np.nan, REST))])


def test_a_chip_that_dies_in_use_reads_0_and_is_called_dead() -> None:
    pipeline = fitted()
    values = np.tile(REST + 1, (3, 1, 1))
    values[1, 0] = 0.0
    batch = pipeline.process_batch(Recording.from_arrays(LAYOUT, values))
    for state in (batch[1], pipeline.process(frame(values[1]))):
        assert state.taxel_status.tolist() == [TaxelStatus.DEAD, 0]
        assert bits_of(state) == FrameStatus.BAD_TAXELS
        assert not state.valid
        assert np.isnan(state.force).all()
        assert state.in_contact == -1
    assert batch.valid.tolist() == [True, False, True]


def test_a_fit_on_nothing_but_faults_says_so() -> None:
    lost = replace(lessons(), values=np.full((200, *SHAPE), np.nan))
    pipeline = toy().fit(lost)
    assert not pipeline.calibrated
    assert pipeline.report['left_out'] == {
        'rows with a faulty taxel': 200.0,
        'usable rows with force, which was not learned': 0.0,
    }
    pipeline.fit(lessons())
    assert 'left_out' not in pipeline.report


def test_stamps_that_are_of_no_use_are_counted() -> None:
    stamped = lessons(seed=1, stamp_ns=np.arange(200))
    pipeline = toy().fit(stamped, lessons(seed=2), stamped)
    assert pipeline.report['left_out'] == {'stamps, since a recording has none': 400.0}
    assert 'left_out' not in toy().fit(stamped, stamped).report


@pytest.mark.parametrize('change', [{'unit': 'mT'}, {'channels': ('Bz', 'By', 'Bx')}])
def test_other_units_and_channels_are_refused(change: dict[str, object]) -> None:
    other = replace(lessons(), layout=replace(LAYOUT, **change))  # type: ignore[arg-type]
    pipeline = fitted()
    for use in (lambda: pipeline.fit(lessons(), other), lambda: pipeline.process_batch(other)):
        with pytest.raises(ValueError, match='toy must have channels Bx, By, Bz in T; received B'):
            use()


@pytest.mark.parametrize('drift', [0.0, 2.0])
def test_drift_between_touches_with_forces_alone_hides_no_touch(drift: float) -> None:
    rng = np.random.default_rng(2)
    level = np.cumsum(drift * rng.normal(size=(200, 1, *SHAPE)), axis=0)
    load = rng.uniform(0.5, 5.0, (200, 1)) * (np.arange(3) > 0)
    values = level + load[..., None, None] * TRUE_WEIGHTS[:, 2].reshape(SHAPE)
    values += NOISE * rng.normal(size=values.shape)
    force = np.where(np.arange(3) == 2, load.reshape(600, 1), 0.0)
    recording = Recording.from_arrays(
        LAYOUT, values.reshape(600, *SHAPE), stream=np.repeat(np.arange(200), 3),
        tare=(load == 0).ravel(), truth={'force': force},
    )  # fmt: skip
    states = toy(ToyConfig(noise=None)).fit(recording).process_batch(recording)
    assert (states.in_contact[load.ravel() > 0] == 1).mean() > 0.93
    np.testing.assert_array_equal(states.in_contact[load.ravel() == 0], 0)


def test_a_second_fit_forgets_the_first() -> None:
    pipeline = toy().fit(lessons(tare=None))
    pipeline.fit(lessons())
    assert pipeline.digest == fitted().digest


def test_fit_sees_the_baseline_move_as_it_will_in_use() -> None:
    """Forces of a drifting sensor are learned exactly where the tracked baseline is learned."""
    rng = np.random.default_rng(5)
    samples = 2000
    drift = np.linspace(0, 40 * NOISE, samples)[:, None, None] * np.ones(SHAPE)
    touched = np.arange(samples) % 100 >= 80
    delta = np.where(touched[:, None, None], rng.normal(size=(samples, *SHAPE)), 0.0)
    force = delta.reshape(samples, -1) @ TRUE_WEIGHTS
    recording = Recording.from_arrays(
        LAYOUT, REST + drift + delta, stamp_ns=np.arange(samples) * SECOND_NS // 10,
        tare=np.arange(samples) == 0, truth={'force': np.where(touched[:, None], force, np.nan)},
    )  # fmt: skip
    pipeline = toy().fit(recording)
    weights = pipeline.estimation.weights_  # type: ignore[attr-defined]
    # 0.1 with the baseline of the tare throughout
    assert np.abs(weights - TRUE_WEIGHTS).max() < 0.01


def test_sensors_without_classes_say_so() -> None:
    with pytest.raises(ValueError, match="toy recognises no classes; received 'mug'"):
        fitted().enrol(lessons(), 'mug')
    with pytest.raises(ValueError, match='label of forget must be one of'):
        fitted().forget('mug')


# ---------------------------------------------------------------- files


@pytest.mark.parametrize('value', [np.nan, np.inf, 0.0, 1e308, 'double'])
def test_load_refuses_arrays_that_change_its_answers(tmp_path: Path, value: float | str) -> None:
    """Each array of numbers is replaced, and the file signed again as a hostile writer would."""
    fitted().save(tmp_path / 'c.npz')
    good = Pipeline.load(tmp_path / 'c.npz', 'toy', CLASSES).process_batch(stream(7))
    members = read(tmp_path / 'c.npz')
    refused = 0
    for name, array in members.items():
        if array.dtype.kind != 'f' or not array.size or name.startswith('answers/'):
            continue
        changed = 2 * array if value == 'double' else np.full_like(array, value)
        write(tmp_path / 'd.npz', {**members, name: changed})
        try:
            states = Pipeline.load(tmp_path / 'd.npz', 'toy', CLASSES).process_batch(stream(7))
        except CalibrationError:
            refused += 1
            continue
        np.testing.assert_array_equal(states.force, good.force)
        np.testing.assert_array_equal(states.in_contact, good.in_contact)
    assert refused >= 3


def test_load_refuses_any_number_that_is_not_what_was_learned(tmp_path: Path) -> None:
    fitted().save(tmp_path / 'c.npz')
    members = read(tmp_path / 'c.npz')
    for name, array in members.items():
        if array.dtype.kind == 'f' and array.size and not name.startswith('answers'):
            changed = array.copy()
            changed.flat[-1] = 1.001 * np.nan_to_num(changed.flat[-1]) + 1e-6
            write(tmp_path / 'd.npz', {**members, name: changed})
            with pytest.raises(CalibrationError):
                Pipeline.load(tmp_path / 'd.npz', 'toy', CLASSES)


def test_the_digest_is_of_what_was_learned() -> None:
    assert fitted().digest == fitted().digest
    assert fitted().digest != toy().digest
    assert fitted().digest != toy().fit(lessons(seed=2)).digest
    assert fitted(ToyConfig(track_baseline=False)).digest != fitted().digest


def test_a_sensor_may_say_itself_what_touches() -> None:
    class Divider(ToyEstimation):
        def contact_from_sensor(self, signals: Signals) -> np.ndarray:
            return (signals.values[:, 0, 0] > 0).astype(np.int8)

    pipeline = Pipeline('toy', ToyConfig(), LAYOUT, Divider())
    delta = np.zeros((2, TAXELS, CHANNELS))
    delta[0, 0, 0], delta[1, 0, 1:] = 1e-9, 9.0
    states = pipeline.process_batch(Recording.from_arrays(LAYOUT, delta))
    assert states.in_contact.tolist() == [1, 0]


def test_bits_and_temperatures_of_a_frame_are_one_per_taxel_and_copied() -> None:
    pipeline, status = toy(), np.zeros(TAXELS, np.uint8)
    state = pipeline.process(Frame(0, 0, np.ones((TAXELS, CHANNELS)), status=status))
    status[:] = 8
    assert not state.taxel_status.any()
    for name in ('status', 'temperature_c'):
        frame = Frame(0, 0, np.zeros((TAXELS, CHANNELS)), **{name: np.zeros(9)})
        with pytest.raises(ValueError, match=rf'{name} of Frame must have shape'):
            pipeline.process(frame)
