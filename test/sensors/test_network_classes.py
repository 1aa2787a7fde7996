# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The network of [1] as a road of a fit, beside templates and neighbours."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from reference.skin_collection import TARE, WINDOW, collected
from tactile_ros.errors import MissingPackageError
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.multipole_skin.config import nine_heads
from tactile_ros.sensors.multipole_skin.recogniser import NETWORKS
from tactile_ros.sensors.multipole_skin.specimen import Specimen
from tactile_ros.types import Recording

pytest.importorskip('onnxruntime')
SPEC = load_sensor('multipole_skin')
CONFIG = SPEC.config(objects=())
HEADS = nine_heads()[2::3]
PLACES = 11e-3 * np.array([[-1, -1], [1, -1], [1, 1.0]])
ROWS = TARE + WINDOW


@pytest.fixture(scope='module')
def skin() -> Specimen:
    return Specimen(CONFIG, seed=4)  # type: ignore[arg-type]


@pytest.fixture(scope='module')
def taught(skin: Specimen) -> Recording:
    return collected(skin, HEADS, PLACES, 1, samples=5)


@pytest.fixture(scope='module')
def asked(skin: Specimen) -> Recording:
    return collected(skin, HEADS, PLACES, 2, samples=4)


@pytest.mark.parametrize('name', NETWORKS)
def test_it_may_be_asked_for_and_names_presses_and_no_more(
    name: str, taught: Recording, asked: Recording, tmp_path: Path
) -> None:
    pipeline = SPEC.pipeline(CONFIG, estimator=name).fit(taught)
    assert pipeline.estimators == {'label': name}
    states, last = pipeline.process_batch(asked), np.arange(ROWS - 1, len(asked), ROWS)
    right = states.label[last] == asked.truth['label'][last]
    assert right.mean() > (0.9 if name == 'pronet_shapes' else 0.6)
    assert np.nanmin(states.label_probability[last]) > 0.3
    assert np.isnan(states.position).all()
    pipeline.save(tmp_path / 'c.npz')
    again = SPEC.load(tmp_path / 'c.npz').process_batch(asked)
    np.testing.assert_array_equal(again.label, states.label)
    np.testing.assert_array_equal(again.label_probability, states.label_probability)
    # faint presses, and those that lack frames
    spoilt = replace(asked, values=asked.values.copy())
    spoilt.values[ROWS - 3, 4] = np.nan
    rest, part = asked.values[ROWS : ROWS + TARE].mean(axis=0), slice(ROWS + TARE, 2 * ROWS)
    spoilt.values[part] = rest + 0.003 * (asked.values[part] - rest)
    label = pipeline.process_batch(spoilt).label
    assert label[ROWS - 1] == label[2 * ROWS - 1] == -1


def test_without_onnxruntime_it_is_refused_in_a_sentence(
    taught: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, 'onnxruntime', None)
    with pytest.raises(MissingPackageError, match='pip install onnxruntime'):
        SPEC.pipeline(CONFIG, estimator=NETWORKS[0]).fit(taught)
