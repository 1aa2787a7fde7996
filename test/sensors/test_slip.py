# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Slip of a real board through the public face: sequences held out, live as in a batch."""

import dataclasses
from functools import lru_cache
from pathlib import Path

import numpy as np

from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.types import ContactStates, Frame, Recording

SENSOR = load_sensor('reskin_board')
FOLDS, PULLS, LENGTH, TARE = 5, 90, 300, 10
ORDER = np.repeat(np.arange(PULLS), LENGTH)


@lru_cache
def pulls() -> Recording:
    return SENSOR.recordings()['slip']


def fold_of(pull: np.ndarray) -> np.ndarray:
    """Contiguous folds of sequences."""
    return pull * FOLDS // PULLS


@lru_cache
def fitted(fold: int) -> tuple[Pipeline, Recording, ContactStates]:
    """Pipeline of four contiguous folds, with the held-out one and its states."""
    recording = pulls()
    held = fold_of(ORDER) == fold
    config = dataclasses.replace(SENSOR.config(), positions=recording.layout.positions)
    pipeline = SENSOR.pipeline(config).fit(recording.select(~held))
    test = recording.select(held)
    return pipeline, test, pipeline.process_batch(test)


def by_pull(column: np.ndarray) -> np.ndarray:
    return column.reshape(-1, LENGTH)


def test_balanced_accuracy_of_held_out_sequences() -> None:
    said, told = [], []
    for fold in range(FOLDS):
        _, test, states = fitted(fold)
        said += (by_pull(states.slip) == 1).any(axis=1).tolist()
        told += (by_pull(test.truth['slip']) == 1).any(axis=1).tolist()
    yes, truth = np.array(said), np.array(told)
    assert len(yes) == PULLS
    assert 0.5 * (yes[truth].mean() + (~yes[~truth]).mean()) >= 0.985


def test_states_keep_the_public_face() -> None:
    pipeline, _, states = fitted(0)
    assert pipeline.estimators == {'slip': 'matched_subspace'}
    assert pipeline.report['slip']['held_out_balanced_accuracy'] > 0.9
    assert states.slip.dtype == np.int8
    assert set(np.unique(states.slip)) <= {-1, 0, 1}
    known = states.slip >= 0
    np.testing.assert_array_equal(states.slip[known] == 1, states.slip_probability[known] > 0.5)
    assert np.isnan(states.slip_probability[~known]).all()
    assert (by_pull(states.slip)[:, :TARE] != 1).all()


def test_live_is_batch_and_a_file_keeps_it(tmp_path: Path) -> None:
    pipeline, test, states = fitted(1)
    pipeline.save(tmp_path / 'slip.npz')
    live = SENSOR.load(tmp_path / 'slip.npz')
    frames = [
        Frame(int(test.stamp_ns[i]), i, test.values[i], None, np.zeros(10, np.uint8))
        for i in range(LENGTH)
    ]
    live.tare(frames[:TARE])
    found = [live.process(frame) for frame in frames[TARE:]]
    np.testing.assert_allclose(
        [one.slip_probability for one in found], states.slip_probability[TARE:LENGTH], atol=1e-9
    )
    assert [int(one.slip) for one in found] == states.slip[TARE:LENGTH].tolist()


def test_independent_frames_give_the_same_answers() -> None:
    pipeline, test, states = fitted(2)
    bare = Recording.from_arrays(test.layout, test.values, stream=test.stream, tare=test.tare)
    found = pipeline.process_batch(bare)
    far = np.abs(states.slip_probability - 0.5) > 0.05
    # tracking of the baseline at rest needs stamps
    agree = found.slip[far] == states.slip[far]
    assert agree.mean() > 0.99


def test_a_chip_that_fails_says_unknown() -> None:
    pipeline, test, _ = fitted(3)
    values = test.values.copy()
    values[100:120, 4] = np.nan
    hurt = Recording.from_arrays(
        test.layout, values, stamp_ns=test.stamp_ns, stream=test.stream, tare=test.tare
    )
    states = pipeline.process_batch(hurt)
    assert (states.slip[100:120] == -1).all()
    assert (states.slip[TARE:100] >= 0).all()


def test_too_few_sequences_teach_nothing() -> None:
    recording = pulls().select(ORDER < 20)  # all of them slip
    config = dataclasses.replace(SENSOR.config(), positions=recording.layout.positions)
    pipeline = SENSOR.pipeline(config).fit(recording)
    assert pipeline.estimators == {}
    assert 'usable rows with slip, which was not learned' in pipeline.report['left_out']
    assert (pipeline.process_batch(recording).slip == -1).all()
