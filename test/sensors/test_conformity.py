# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""What every sensor's pipeline must do, on toy data: a new sensor needs no new test."""

import dataclasses
from functools import lru_cache, partial
from itertools import pairwise
from pathlib import Path
from time import perf_counter_ns

import numpy as np
import pytest

from tactile_ros.errors import TactileError
from tactile_ros.estimators import regression
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import SensorSpec, list_sensors, load_sensor
from tactile_ros.sensors.gradiometer import estimation as inversion
from tactile_ros.types import (
    STATE_FIELDS,
    ContactState,
    ContactStates,
    Frame,
    FrameStatus,
    Layout,
    Recording,
    TaxelStatus,
)

pytestmark = pytest.mark.parametrize('key', list_sensors())
STREAMS, LENGTH = 8, 12
STEP_NS = 10_000_000
SECOND_NS = 1_000_000_000
# size of a signal and of a resting value for each unit
SIZES = {'T': (5e-4, 1e-3), '1': (0.3, 0.3)}
SEEN = ('force', 'torque', 'position', 'cell', 'label', 'yaw', 'taxel_force')
# the quickest to fit: what is asked here does not depend on how well it estimates
QUICK = ('grid_knn',)
# what the truth of each sensor tells
TOLD = {
    'reskin_board': ('force', 'position'), 'magnet_pad': ('force', 'position', 'cell'),
    'gradiometer': ('force', 'torque'), 'multipole_skin': ('label', 'position', 'yaw'),
    'taxel_array': ('taxel_force', 'position'), 'five_wire_skin': ('force', 'position'),
}  # fmt: skip


@pytest.fixture(autouse=True)
def hasty(monkeypatch: pytest.MonkeyPatch) -> None:
    """Perceptrons and inversions of few steps, which estimate badly."""
    monkeypatch.setattr(regression, 'FEWEST_STEPS', 50)
    monkeypatch.setattr(inversion, 'ROUNDS', 1)
    monkeypatch.setattr(inversion, 'calibrate', partial(inversion.calibrate, most_steps=8))


class Toy:
    """A sensor of one kind whose readings depend smoothly on a hidden touch."""

    def __init__(self, key: str) -> None:
        self.spec: SensorSpec = load_sensor(key)
        self.config = dataclasses.replace(  # type: ignore[type-var]
            self.spec.config(), noise=None, rotations=None
        )
        self.layout: Layout = self.spec.layout(self.config)  # type: ignore[arg-type]
        taxels, channels = self.layout.shape
        self.signal, level = SIZES[self.layout.unit]
        self.noise = 1e-3 * self.signal
        self.rest = np.full((taxels, channels), level)
        self.mix = np.random.default_rng(1).normal(size=(4, taxels * channels))
        self.window = int(getattr(self.config, 'window', 1))
        self.length = self.window if self.window > 1 else LENGTH

    def frames(self, samples: int, seed: int) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Readings of touched frames, and their truth."""
        rng = np.random.default_rng(seed)
        touches = -(-samples // self.window)
        hidden = np.column_stack([rng.uniform(-1, 1, (touches, 2)), rng.uniform(0.3, 1, touches)])
        hidden = np.repeat(hidden, self.window, axis=0)[:samples]
        mixed = np.column_stack([hidden, hidden[:, 0] * hidden[:, 2]]) @ self.mix
        shape = (samples, *self.layout.shape)
        delta = self.signal * np.tanh(0.3 * mixed).reshape(shape) * hidden[:, 2:, None]
        values = self.rest + delta + self.noise * rng.normal(size=shape)
        blank = np.full(samples, np.nan)
        truth = {
            'force': np.column_stack([0.1 * hidden[:, :2], hidden[:, 2]]),
            'torque': np.column_stack([0.01 * hidden[:, :2], blank]),
            'position': np.column_stack([0.01 * hidden[:, :2], blank]),
            'cell': (hidden[:, 0] > 0).astype(int), 'label': (hidden[:, 1] > 0).astype(int),
            'yaw': hidden[:, 0], 'taxel_force': np.abs(delta).sum(axis=2) / self.signal,
            'session': np.arange(samples) // (samples // 2 + 1),
        }  # fmt: skip
        return values, truth

    def independent(self, samples: int = 60, seed: int = 2) -> Recording:
        """Frames without stamps, some of them untouched."""
        values, truth = self.frames(samples, seed)
        contact = (np.arange(samples) % 4 > 0).astype(np.int8)
        rng = np.random.default_rng(seed + 100)
        rest = self.rest + self.noise * rng.normal(size=values.shape)
        values = np.where(contact[:, None, None] == 0, rest, values)
        truth = {
            name: np.where(
                contact.reshape((-1,) + (1,) * (column.ndim - 1)) == 0,
                -1 if column.dtype.kind == 'i' else np.nan,
                column,
            )
            for name, column in truth.items()
            if name != 'session'
        }
        return Recording.from_arrays(self.layout, values, truth={**truth, 'in_contact': contact})

    def streams(self, streams: int = STREAMS, seed: int = 3) -> Recording:
        """Streams of a tare row and touched frames each."""
        samples = streams * self.length
        values, truth = self.frames(samples, seed)
        first = np.arange(0, samples, self.length)
        rows = samples + streams
        known = {
            name: np.insert(column, first, -1 if column.dtype.kind == 'i' else np.nan, axis=0)
            for name, column in truth.items()
        }
        return Recording.from_arrays(
            self.layout, np.insert(values, first, self.rest, axis=0),
            stamp_ns=STEP_NS * np.arange(rows),
            stream=np.repeat(np.arange(streams), self.length + 1),
            tare=np.insert(np.zeros(samples, bool), first, values=True), truth=known,
        )  # fmt: skip

    def pipeline(self, estimator: str | None = None, **changes: object) -> Pipeline:
        """Not fitted yet; with the quickest estimator."""
        quick = next((n for n in QUICK if n in self.spec.estimator_names), None)
        config = dataclasses.replace(self.config, **changes)  # type: ignore[type-var]
        return self.spec.pipeline(config, estimator or quick)  # type: ignore[arg-type]

    def frame(self, values: np.ndarray, stamp_ns: int | None = None, **more: object) -> Frame:
        return Frame(stamp_ns, 0, values, **more)  # type: ignore[arg-type]


@lru_cache
def toy_of(key: str) -> Toy:
    return Toy(key)


@lru_cache
def fitted_on_streams(key: str, track: bool) -> Pipeline:
    toy = toy_of(key)
    one = toy.pipeline(track_baseline=track)
    assert one.fit(toy.streams()) is one
    return one


def fitted(key: str, track: bool = True) -> Pipeline:
    """Fitted once for all; tared and reset for every test."""
    known = fitted_on_streams(key, track)
    known.tare([Frame(0, 0, toy_of(key).rest)])
    known.reset()
    return known


@pytest.fixture
def toy(key: str) -> Toy:
    return toy_of(key)


@pytest.fixture
def pipeline(key: str) -> Pipeline:
    return fitted(key)


def differences(one: object, other: object, atol: float, names: set[str]) -> list[str]:
    """Names of the attributes in which two states differ."""
    found = []
    for name in sorted(names):
        a, b = np.asarray(getattr(one, name), float), np.asarray(getattr(other, name), float)
        if a.shape != b.shape or not np.allclose(a, b, rtol=0, atol=atol, equal_nan=True):
            found.append(name)
    return found


ALL = set(STATE_FIELDS)


def unknown(states: ContactStates | ContactState, name: str, row: object = slice(None)) -> bool:
    """Whether nothing is said about an attribute."""
    value = np.asarray(getattr(states, name))
    value = value[row] if value.ndim else value  # type: ignore[index]
    return bool((value == -1).all() if value.dtype.kind == 'i' else np.isnan(value).all())


# ---------------------------------------------------------------- fit, save, load


def test_fit_returns_itself_and_estimates_what_truth_told(toy: Toy, pipeline: Pipeline) -> None:
    one, recording = pipeline, toy.streams()
    assert one.calibrated
    assert set(one.report)
    states = one.process_batch(recording)
    states.refuse_misfit(toy.layout.shape[0])
    asked = states.valid & (states.in_contact == 1) & ~recording.tare
    assert asked.mean() > 0.5
    if toy.window > 1:  # answers stand on the last frame of a window
        asked &= np.append(recording.stream[1:] != recording.stream[:-1], True)
    for name in set(one.estimators) & set(SEEN):
        told = np.asarray(recording.truth[name], float)[asked]
        found = np.asarray(getattr(states, name), float)[asked]
        known = np.isfinite(told).any(axis=0)
        assert np.isfinite(found[..., known]).mean() > 0.5, name
        # a component that truth never told is not invented
        assert np.isnan(found[..., ~known]).all(), name


def test_an_unfitted_pipeline_runs_and_says_so(toy: Toy) -> None:
    one = toy.pipeline()
    recording = toy.streams(2)
    states = one.process_batch(recording)
    states.refuse_misfit(toy.layout.shape[0])
    live = one.process(recording.frame(1))
    if not one.calibrated:
        for found in (states, live):
            assert np.all(np.asarray(found.status) & FrameStatus.NOT_CALIBRATED)
            assert not np.any(found.valid)
            assert all(unknown(found, name) for name in SEEN if name != 'taxel_force')
    assert np.isnan(one.baseline).all()


@pytest.mark.parametrize('estimator', ['default', 'each'])
def test_saved_and_loaded_it_says_the_same(toy: Toy, tmp_path: Path, estimator: str) -> None:
    names = toy.spec.estimator_names if estimator == 'each' else (None,)
    few = toy.independent(32)
    told = {name: few.truth[name] for name in ('in_contact', 'position', 'cell', 'taxel_force')}
    few = Recording.from_arrays(toy.layout, few.values, truth=told)
    for name in names:
        one = toy.spec.pipeline(toy.config, name).fit(few)  # type: ignore[arg-type]
        if name is not None and one.estimators:
            assert set(one.estimators.values()) == {name}
        one.save(tmp_path / 'c.npz')
        again = toy.spec.load(tmp_path / 'c.npz')
        assert again.digest == one.digest
        assert again.estimators == one.estimators
        assert again.report == one.report
        batch = one.process_batch(few)
        assert differences(batch, again.process_batch(few), 0.0, ALL) == []
        for row in range(0, len(few), 5):
            live = again.process(few.frame(row))
            assert differences(live, batch[row], 1e-9, ALL) == [], (name, row)


def test_the_order_of_independent_frames_does_not_matter(toy: Toy) -> None:
    if toy.window > 1:
        pytest.skip('a sensor of windows has no independent frames')
    frames = toy.independent()
    order = np.random.default_rng(0).permutation(len(frames))
    one, other = toy.pipeline().fit(frames), toy.pipeline().fit(frames.select(order))
    fresh = toy.independent(40, seed=9)
    shuffle = np.random.default_rng(1).permutation(40)
    a = one.process_batch(fresh)
    assert differences(a, other.process_batch(fresh), 1e-9, ALL) == []
    b = one.process_batch(fresh.select(shuffle))
    for row, state in zip(shuffle, b, strict=True):
        assert differences(a[int(row)], state, 1e-12, ALL) == []


# ---------------------------------------------------------------- live and batch


def eventful(toy: Toy, seed: int) -> Recording:
    """One stream with rests that drift, touches, runs of tare rows, gaps and lost readings."""
    rng = np.random.default_rng(seed)
    samples = 90
    values, _ = toy.frames(samples, seed)
    drift = np.cumsum(0.2 * toy.noise * rng.normal(size=values.shape), axis=0)
    noise = 0.5 * toy.noise * rng.normal(size=values.shape)
    touched = np.arange(samples) % 30 >= 18
    values = np.where(touched[:, None, None], values, toy.rest + noise) + drift
    tare = np.isin(np.arange(samples), [0, 1, 2, 30, 60, 61])
    values[[25, 50]] = np.nan
    values[70, 0, 0] = np.nan
    step = rng.integers(STEP_NS, 40 * STEP_NS, samples)
    step[[40, 75]] = 20 * SECOND_NS
    return Recording.from_arrays(
        toy.layout, values, stamp_ns=SECOND_NS + np.cumsum(step), tare=tare
    )


def run_live(pipeline: Pipeline, recording: Recording) -> dict[int, ContactState]:
    """What a hand does: it tares with the resting frames, and asks about all others."""
    pipeline.reset()
    states, resting = {}, []
    for row in range(len(recording)):
        frame = recording.frame(row)
        if recording.tare[row]:
            resting.append(frame)
            continue
        if resting:
            pipeline.tare(resting)
            resting = []
        states[row] = pipeline.process(frame)
    return states


@pytest.mark.parametrize('track', [True, False])
def test_live_is_batch_and_so_are_pieces_of_a_stream(toy: Toy, key: str, track: bool) -> None:
    one, recording = fitted(key, track), eventful(toy, 5)
    batch = one.process_batch(recording)
    batch.refuse_misfit(toy.layout.shape[0])
    live = run_live(one, recording)
    assert len(live) == 84
    for row, state in live.items():
        assert differences(state, batch[row], 1e-9, ALL) == [], row
    # and something happened
    assert set(batch.in_contact.tolist()) == {-1, 0, 1}
    stream = dataclasses.replace(recording, tare=None, stream=None)
    whole = one.process_batch(stream)
    one.reset()
    for a, b in pairwise([0, 1, 2, 17, 40, 41, 68, len(stream)]):
        piece = one.process_next(stream.select(slice(a, b)))
        for i in range(b - a):
            assert differences(piece[i], whole[a + i], 1e-12, ALL) == [], (a, i)


def test_streams_do_not_know_of_each_other(toy: Toy, pipeline: Pipeline) -> None:
    recording = toy.streams(3, seed=8)
    together = pipeline.process_batch(recording)
    for number in range(3):
        rows = np.flatnonzero(recording.stream == number)
        alone = pipeline.process_batch(recording.select(rows))
        live = run_live(pipeline, recording.select(rows))
        for i, row in enumerate(rows):
            assert differences(alone[i], together[int(row)], 1e-9, ALL) == []
        for i, state in live.items():
            assert differences(state, alone[i], 1e-9, ALL) == []


def test_a_frame_takes_little_time(toy: Toy, pipeline: Pipeline) -> None:
    frame = toy.streams(1).frame(3)
    spent = []
    for i in range(200):
        one = dataclasses.replace(frame, stamp_ns=i * STEP_NS)
        begin = perf_counter_ns()
        pipeline.process(one)
        spent.append(perf_counter_ns() - begin)
    # far above the aims of the benches: a frame that fits, decomposes or sorts all is seen
    assert min(spent) < 10_000_000


# ---------------------------------------------------------------- faults and shapes


def test_a_lost_taxel_is_tolerated_and_marked(toy: Toy) -> None:
    recording = toy.streams()
    values = recording.values.copy()
    values[5, 0] = np.nan
    values[40] = np.inf
    hurt = dataclasses.replace(recording, values=values)
    one = toy.pipeline().fit(hurt)
    states = one.process_batch(hurt)
    assert not states.valid[[5, 40]].any()
    # an array of many taxels goes on without one
    clean = np.zeros((1, one.layout.shape[0]), np.uint8)
    blank = [5, 40] if one.estimation.estimable_rows(clean) is None else [40]
    assert (states.in_contact[blank] == -1).all()
    assert (states.taxel_status[5] & TaxelStatus.ERROR).astype(bool).tolist() == [True] + [
        False
    ] * (toy.layout.shape[0] - 1)
    for name in one.estimators:
        assert unknown(states, name, blank), name
    assert states.valid[~np.isin(np.arange(len(values)), [5, 40])].mean() > 0.9


@pytest.mark.parametrize(
    ('bits', 'flag', 'usable'),
    [
        (TaxelStatus.STALE, FrameStatus.STALE, True),
        (TaxelStatus.SATURATED, FrameStatus.SATURATED | FrameStatus.BAD_TAXELS, False),
        (TaxelStatus.STUCK, FrameStatus.BAD_TAXELS, False),
        (TaxelStatus.WRAPPED, FrameStatus.BAD_TAXELS, False),
        (TaxelStatus.DEAD, FrameStatus.BAD_TAXELS, False),
    ],
)
def test_bits_of_the_sensor(
    toy: Toy, pipeline: Pipeline, bits: TaxelStatus, flag: FrameStatus, usable: bool
) -> None:
    taxels = toy.layout.shape[0]
    frame = toy.streams(1).frame(5)
    state = pipeline.process(
        dataclasses.replace(frame, status=np.full(taxels, int(bits), np.uint8))
    )
    assert int(state.status) & flag == flag
    assert not state.valid
    assert (state.in_contact != -1) == usable
    assert (state.taxel_status & bits).all()


@pytest.mark.parametrize('limit', [10.0, None, np.inf])
def test_a_channel_is_saturated_at_its_limit(toy: Toy, limit: float | None) -> None:
    one = toy.pipeline(saturation=limit)
    values = toy.rest.copy()
    values[-1, -1] = -10.0
    state = one.process(toy.frame(values))
    assert bool(int(state.status) & FrameStatus.SATURATED) == (limit == 10.0)
    assert bool(int(state.taxel_status[-1]) & TaxelStatus.SATURATED) == (limit == 10.0)
    assert not (state.valid and limit == 10.0)


def test_another_shape_is_refused_with_both_named(toy: Toy, pipeline: Pipeline) -> None:
    taxels, channels = toy.layout.shape
    other = Layout(
        np.zeros((taxels + 2, 3)), tuple(f'c{i}' for i in range(channels)), toy.layout.unit
    )
    foreign = Recording.from_arrays(other, np.zeros((3, *other.shape)))
    both = rf'\({taxels}, {channels}\).*received \({taxels + 2}, {channels}\)'
    with pytest.raises(ValueError, match=both):
        pipeline.process(toy.frame(np.zeros(other.shape)))
    with pytest.raises(ValueError, match=both):
        pipeline.process_batch(foreign)
    with pytest.raises(ValueError, match=both):
        pipeline.tare([toy.frame(np.zeros(other.shape))])
    with pytest.raises(ValueError, match=both):
        toy.pipeline().fit(foreign)


# ---------------------------------------------------------------- baseline


def test_tare_reset_and_load(toy: Toy, key: str, tmp_path: Path) -> None:
    unfitted, one = toy.pipeline(), fitted(key, track=False)
    # never from the first frames
    for i in range(20):
        unfitted.process(toy.frame(toy.rest, i * STEP_NS))
    assert np.isnan(unfitted.baseline).all()
    np.testing.assert_allclose(one.baseline, toy.rest, rtol=1e-12)
    one.save(tmp_path / 'c.npz')
    digest = one.digest
    level = toy.rest + 0.5 * toy.signal
    one.tare([toy.frame(level - toy.noise), toy.frame(level + toy.noise)])
    for forget in (one.reset, lambda: one.process_batch(toy.streams(2))):
        forget()
        np.testing.assert_allclose(one.baseline, level, rtol=1e-12)
        assert one.process(toy.frame(level)).in_contact in (0, -1)
    assert one.digest == digest
    again = toy.spec.load(tmp_path / 'c.npz')
    np.testing.assert_allclose(again.baseline, toy.rest, rtol=1e-12)
    again.tare([toy.frame(level)])
    touch = toy.streams(1).frame(4)
    moved = dataclasses.replace(touch, values=touch.values + 0.5 * toy.signal)
    one.tare([toy.frame(toy.rest)])
    # a rest that was never seen may widen a covariance
    names = {name for name in ALL if not name.endswith('_cov')}
    assert differences(again.process(moved), one.process(touch), 1e-6, names) == []
    with pytest.raises(ValueError, match='at least one'):
        one.tare([])


def test_tracking_at_rest_works_on_stamped_frames_and_freezes_in_contact(toy: Toy) -> None:
    one = toy.pipeline(noise=toy.noise).fit(toy.streams())
    creep = np.arange(160)[:, None, None] * 0.05 * toy.noise
    for values in toy.rest + creep[:40]:
        one.process(toy.frame(values))
    np.testing.assert_allclose(one.baseline, toy.rest, rtol=1e-12)
    for i, values in enumerate(toy.rest + creep):
        one.process(toy.frame(values, i * SECOND_NS // 2))
    followed = one.baseline.copy()
    assert (followed > toy.rest + 2 * toy.noise).all()
    for i in range(160, 320):
        one.process(toy.frame(toy.rest + toy.signal, i * SECOND_NS // 2))
    assert np.abs(one.baseline - followed).max() < 10 * toy.noise


# ---------------------------------------------------------------- truth


@pytest.mark.parametrize('known', ['half', 'one component', 'few', 'rest'])
def test_partial_truth(toy: Toy, known: str) -> None:
    recording = toy.streams()
    truth = {name: column.copy() for name, column in recording.truth.items()}
    values = recording.values
    if known == 'one component':
        truth['force'][:, :2] = np.nan
    elif known == 'rest':
        truth = {'in_contact': np.zeros(len(recording), np.int8)}
        rng = np.random.default_rng(3)
        values = toy.rest + toy.noise * rng.normal(size=values.shape)
    else:
        for column in truth.values():
            column[slice(None, None, 2) if known == 'half' else slice(3, None)] = nothing(column)
    one = toy.pipeline().fit(dataclasses.replace(recording, values=values, truth=truth))
    states = one.process_batch(recording)
    states.refuse_misfit(toy.layout.shape[0])
    if known == 'one component' and 'force' in one.estimators:
        touched = states.valid & (states.in_contact == 1)
        assert np.isnan(states.force[:, :2]).all()
        assert np.isfinite(states.force[touched, 2]).mean() > 0.5
    if known == 'rest' and not toy.pipeline().calibrated:
        assert not one.calibrated
        assert (states.status & FrameStatus.NOT_CALIBRATED).all()
        np.testing.assert_allclose(one.baseline, toy.rest, atol=3 * toy.noise)


def nothing(column: np.ndarray) -> float:
    """Value of a column where nothing was measured."""
    return -1 if column.dtype.kind == 'i' else np.nan


@pytest.mark.parametrize('kind', ['frames', 'streams'])
def test_every_subset_of_truth_ends_in_a_fit_or_in_one_sentence(
    toy: Toy, key: str, kind: str
) -> None:
    recording = toy.streams(6) if kind == 'streams' else toy.independent(48)
    own = {name: recording.truth[name] for name in TOLD.get(key, ('force', 'position'))}
    blank = {name: np.full_like(column, nothing(column)) for name, column in own.items()}
    single = [{name: column} for name, column in own.items()]
    for truth in (own, {}) if kind == 'frames' else (blank, *single):
        pipeline = toy.spec.pipeline(toy.config)  # type: ignore[arg-type]
        try:
            pipeline.fit(dataclasses.replace(recording, truth=truth))
        except (ValueError, TactileError) as error:
            sentence = str(error)
            assert len(sentence) > 20, set(truth)
            continue
        pipeline.process_batch(recording).refuse_misfit(toy.layout.shape[0])


def test_recordings_of_many_kinds_are_learned_together(toy: Toy) -> None:
    kinds = [
        toy.streams(4, seed=20), toy.independent(24, seed=21),
        Recording.from_arrays(toy.layout, toy.streams(2, seed=22).values),
        toy.streams(1).select(slice(0, 1)), toy.streams(1).select(slice(0, 0)),
    ]  # fmt: skip
    one = toy.pipeline().fit(*kinds)
    assert one.calibrated
    one.process_batch(kinds[0]).refuse_misfit(toy.layout.shape[0])


@pytest.mark.parametrize('samples', [0, 1])
def test_short_recordings(toy: Toy, pipeline: Pipeline, samples: int) -> None:
    short = toy.streams(1).select(slice(0, samples))
    for one in (pipeline, toy.pipeline(), toy.pipeline().fit(short)):
        for recording in (short, dataclasses.replace(short, stamp_ns=None)):
            states = one.process_batch(recording)
            states.refuse_misfit(toy.layout.shape[0])
            assert len(states) == samples


def test_untouched_rows(toy: Toy, pipeline: Pipeline) -> None:
    rng = np.random.default_rng(6)
    values = toy.rest + 0.3 * toy.noise * rng.normal(size=(30, *toy.layout.shape))
    for stamp_ns in (None, STEP_NS * np.arange(30)):
        states = pipeline.process_batch(Recording.from_arrays(toy.layout, values, stamp_ns))
        untouched = states.in_contact == 0
        if not untouched.any():
            pytest.skip('this sensor cannot tell contact')
        assert untouched.all()
        for name in ('force', 'torque'):
            if name in pipeline.estimators:
                found = getattr(states, name)
                assert ((found == 0) | np.isnan(found)).all()
                assert (found == 0).any()
                assert np.isfinite(getattr(states, f'{name}_cov')).any()
        for name in ('position', 'cell', 'label', 'yaw', 'object_pose', 'contacts_id'):
            assert unknown(states, name), name


def test_tare_rows_are_untouched_and_get_states(toy: Toy, pipeline: Pipeline) -> None:
    recording = toy.streams(2)
    states = pipeline.process_batch(recording)
    assert (states.in_contact[recording.tare] == 0).all()
    assert states.valid[recording.tare].all()
