# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Every subset of truth keys, absent or without a value, ends in a fit or in one sentence."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tactile_ros.errors import TactileError
from tactile_ros.sensors import list_sensors, load_sensor
from tactile_ros.types import Layout, Recording

if TYPE_CHECKING:
    from tactile_ros.sensors import SensorSpec

STREAMS, LENGTH = 6, 8
KEYS = {
    'reskin_board': ('force', 'position'),
    'magnet_pad': ('force', 'position', 'cell'),
    'gradiometer': ('force', 'torque'),
    'multipole_skin': ('label', 'position', 'yaw'),
    'taxel_array': ('taxel_force', 'position'),
    'five_wire_skin': ('force', 'position'),
}


@lru_cache
def touches(key: str) -> tuple[SensorSpec, Layout, np.ndarray, dict[str, np.ndarray]]:
    """Smooth readings (s, t, c) of hidden touches after a tare in each stream, with truth."""
    spec = load_sensor(key)
    layout = spec.layout(spec.config())
    (taxels, channels), rng = layout.shape, np.random.default_rng(0)
    touch = np.column_stack([rng.uniform(-1, 1, (STREAMS, 2)), rng.uniform(0.3, 1, STREAMS)])
    touch = np.repeat(touch, LENGTH, axis=0)
    touch[:, 2] *= rng.uniform(0.5, 1, len(touch))
    tare = np.arange(len(touch)) % LENGTH < 2
    size = 5e-4 if layout.unit == 'T' else 0.3
    change = np.tanh(0.5 * touch @ rng.normal(size=(3, taxels * channels)))
    values = size * (1.0 + np.where(tare[:, None], 0.0, change)).reshape(-1, taxels, channels)
    values += 1e-3 * size * rng.normal(size=values.shape)
    values = values if layout.unit == 'T' else np.clip(values, 0.01, 0.95)
    force = np.where(tare[:, None], 0.0, 5 * touch[:, 2:]) * [0.1, 0.1, 1.0]
    place = 0.01 * touch[:, :2] + (0.05 if key == 'five_wire_skin' else 0.0)
    place = np.column_stack([np.where(tare[:, None], np.nan, place), np.zeros(len(place))])
    truth = {
        'force': force,
        'torque': 0.01 * force,
        'position': place,
        'cell': np.where(tare, -1, (touch[:, 0] > 0).astype(int)),
        'label': np.where(tare, -1, (touch[:, 1] > 0).astype(int)),
        'yaw': np.where(tare, np.nan, touch[:, 0]),
        'taxel_force': np.where(tare[:, None], 0.0, 2 * values[..., 0]),
    }
    return spec, layout, values, {name: truth[name] for name in KEYS[key]}


def subsets(names: list[str]) -> list[dict[str, str]]:
    """Kinds of every truth key: absent where it is not named, `valued` or `blank`."""
    alone = [{name: 'valued'} for name in names]
    return [dict.fromkeys(names, 'valued'), {}, dict.fromkeys(names, 'blank'), *alone]


@pytest.mark.parametrize('kind', ['frames', 'sessions'])
@pytest.mark.parametrize('key', list_sensors())
def test_every_subset_of_truth_ends_in_a_fit_or_in_one_sentence(key: str, kind: str) -> None:
    spec, layout, values, truth = touches(key)
    rows = np.arange(len(values))
    columns: dict[str, np.ndarray] = {}
    if kind == 'sessions':
        columns = {'stamp_ns': 10**7 * rows, 'stream': rows // LENGTH, 'tare': rows % LENGTH < 2}
    for subset in subsets([*truth])[kind == 'frames' :]:
        given = {
            name: truth[name] if how == 'valued' else blank(truth[name])
            for name, how in subset.items()
        }
        if kind == 'sessions':
            given['session'] = rows * 2 // len(rows)
        recording = Recording.from_arrays(layout, values, truth=given, **columns)
        pipeline = spec.pipeline()
        try:
            pipeline.fit(recording)
        except (ValueError, TactileError) as error:
            sentence = str(error)
            assert len(sentence) > 20, subset
            continue
        pipeline.process_batch(recording).refuse_misfit(layout.shape[0])


def blank(column: np.ndarray) -> np.ndarray:
    """Values of a column that was not measured."""
    return np.full_like(column, -1 if column.dtype.kind == 'i' else np.nan)
