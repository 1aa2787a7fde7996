"""Calibration files of a real pipeline: mad ones are refused as well as damaged ones."""

from __future__ import annotations

import os
import time
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tactile_ros.calibration import flatten, read, write
from tactile_ros.errors import CalibrationError
from tactile_ros.sensors import load_sensor
from tactile_ros.stored import identity
from tactile_ros.types import Recording

if TYPE_CHECKING:
    from pathlib import Path

    from tactile_ros.calibration import Arrays
    from tactile_ros.pipeline import Pipeline

SENSOR = load_sensor('reskin_board')
HYPOTHESIS = {
    'suppress_health_check': [HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
}


@lru_cache
def pipeline_of(estimator: str) -> Pipeline:
    rng = np.random.default_rng(0)
    hidden = rng.uniform(-1, 1, (40, 3))
    delta = 1e-3 * np.tanh(hidden @ rng.normal(size=(3, 15))).reshape(40, 5, 3)
    delta[::10] = 0.0
    place = np.column_stack([0.01 * hidden[:, :2], np.full(40, np.nan)])
    config = SENSOR.config()
    recording = Recording.from_arrays(
        SENSOR.layout(config),
        5e-3 + delta,
        stamp_ns=np.arange(40) * 10_000_000,
        tare=np.arange(40) % 10 == 0,
        truth={'position': place, 'force': hidden},
    )
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
    assert pipeline.digest == identity(arrays)
    assert pipeline.calibrated


def test_every_member_is_needed(arrays: Arrays, tmp_path: Path) -> None:
    path = tmp_path / 'c.npz'
    names = sorted(arrays)
    for gone in names[:: max(len(names) // 12, 1)]:
        write(path, {name: array for name, array in arrays.items() if name != gone})
        with pytest.raises(CalibrationError):
            SENSOR.load(path)


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


def test_a_file_cut_anywhere_is_refused(arrays: Arrays, tmp_path: Path) -> None:
    path = tmp_path / 'c.npz'
    write(path, arrays)
    content = path.read_bytes()
    for length in np.linspace(0, len(content) - 1, 40).astype(int):
        path.write_bytes(content[:length])
        with pytest.raises(CalibrationError):
            SENSOR.load(path)


@settings(max_examples=20, **HYPOTHESIS)  # type: ignore[arg-type]
@given(st.lists(st.floats(0, 1, exclude_max=True), min_size=1, max_size=3), st.integers(0, 7))
def test_flipped_bits_are_refused_or_harmless(
    arrays: Arrays, tmp_path: Path, places: list[float], bit: int
) -> None:
    path = tmp_path / 'c.npz'
    write(path, arrays)
    content = bytearray(path.read_bytes())
    for place in places:
        content[int(place * len(content))] ^= 1 << bit
    path.write_bytes(bytes(content))
    try:
        assert SENSOR.load(path).digest == identity(arrays)
    except CalibrationError:
        return


@pytest.mark.parametrize(
    ('part', 'tree', 'match'),
    [
        ('sensor', 'gradiometer', "must be of reskin_board; it is of 'gradiometer'"),
        ('sensor', None, "it is of 'None'"),
        ('sensor', 3, "it is of '3'"),
        ('sensor', 'x' * 500, f"it is of '{'x' * 60}'"),
        ('layout', 'hello', 'lacks a layout'),
        ('layout', None, 'lacks a layout'),
        ('config', {'positions': 3}, 'lacks a layout'),
        ('estimation', (1, 2), 'lacks a layout'),
    ],
)
def test_parts_of_another_kind(tmp_path: Path, part: str, tree: object, match: str) -> None:
    whole = stored('grid_knn', os.fspath(tmp_path))
    rest = {k: v for k, v in whole.items() if k.split('.')[0].split('/')[0] != part}
    write(tmp_path / 'c.npz', {**rest, **flatten(tree, part)})
    with pytest.raises(CalibrationError, match=match):
        SENSOR.load(tmp_path / 'c.npz')


@pytest.mark.parametrize('tree', [None, 'hello', {'rows': 'many'}, [1.0], {'rows': {'a': 1.0}}])
def test_counts_of_another_kind(tmp_path: Path, tree: object) -> None:
    whole = stored('grid_knn', os.fspath(tmp_path))
    rest = {k: v for k, v in whole.items() if not k.startswith('left_out_')}
    write(tmp_path / 'c.npz', {**rest, **flatten(tree, 'left_out_')})
    with pytest.raises(CalibrationError, match='left out is no table of counts'):
        SENSOR.load(tmp_path / 'c.npz')


@pytest.mark.parametrize('name', ['baseline', 'noise', 'scale'])
def test_another_shape_is_refused_with_both_named(tmp_path: Path, name: str) -> None:
    whole = dict(stored('grid_knn', os.fspath(tmp_path)))
    whole[f'rest_/{name}.array'] = np.zeros((4, 3))
    write(tmp_path / 'c.npz', whole)
    with pytest.raises(CalibrationError, match=rf'{name} .*\(5, 3\); received \(4, 3\)'):
        SENSOR.load(tmp_path / 'c.npz')


def test_temperatures_of_another_shape_are_refused_with_both_named(tmp_path: Path) -> None:
    whole = dict(stored('grid_knn', os.fspath(tmp_path)))
    del whole['rest_/temperature_c.none']
    write(tmp_path / 'c.npz', {**whole, 'rest_/temperature_c.array': np.zeros(4)})
    with pytest.raises(CalibrationError, match=r'temperature_c .*\(5,\); received \(4,\)'):
        SENSOR.load(tmp_path / 'c.npz')


def test_the_tower_of_names_ends(tmp_path: Path) -> None:
    """A list inside a list inside a list, as deep as names allow, is no way to hang a reader."""
    whole = dict(stored('grid_knn', os.fspath(tmp_path)))
    name = 'estimation/heads_'
    while len(name) < 180:
        whole[f'{name}.tuple'] = np.array(10**18)
        name += '/0'
    write(tmp_path / 'c.npz', whole)
    begin = time.monotonic()
    with pytest.raises(CalibrationError):
        SENSOR.load(tmp_path / 'c.npz')
    assert time.monotonic() - begin < 5.0


def test_a_pipe_is_no_calibration(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / 'c.npz')
    with pytest.raises(CalibrationError, match='it is no file'):
        SENSOR.load(tmp_path / 'c.npz')


def test_saving_over_a_file_that_is_open_elsewhere_keeps_it_whole(tmp_path: Path) -> None:
    path = tmp_path / 'c.npz'
    pipeline_of('grid_knn').save(path)
    with path.open('rb') as old:
        pipeline_of('ridge').save(path)
        assert old.read()[:2] == b'PK'
    assert SENSOR.load(path).estimators['force'] == 'ridge'
