# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The shipped networks of [1]: hard case 14, and what they know."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.worlds import multipole_trials as trials
from tactile_ros.sensors.multipole_skin import recogniser

pytest.importorskip('onnxruntime')


@pytest.mark.parametrize('what', recogniser.TRAINED)
def test_a_window_says_the_same_alone_and_among_others(what: str) -> None:
    # batch norm in training mode would let queries into the features of others
    rng = np.random.default_rng(0)
    windows = 1e-4 * rng.normal(size=(7, 10, 60))
    net = recogniser.pronet(what)
    together = net.features(windows)
    assert together.shape == (7, 320)
    alone = np.concatenate([net.features(one[None]) for one in windows])
    np.testing.assert_allclose(alone, together, rtol=1e-4, atol=1e-5)


def test_how_deep_a_press_is_hardly_matters_and_noise_alone_is_not_blown_up() -> None:
    # hard case 18: a deep press is no other shape
    rng = np.random.default_rng(1)
    windows = 1e-4 * rng.normal(size=(3, 10, 60))
    net = recogniser.pronet('shapes')
    one, deep, faint = (net.features(scale * windows) for scale in (1.0, 3.0, 3e-4))
    np.testing.assert_allclose(deep, one, rtol=1e-2, atol=2e-3 * np.abs(one).max())
    nothing = net.features(0 * windows)
    assert np.linalg.norm(faint - nothing) < 0.2 * np.linalg.norm(one - nothing)


def test_networks_say_what_made_them_and_are_small() -> None:
    for what in recogniser.TRAINED:
        made = recogniser.pronet(what).session.get_modelmeta().custom_metadata_map
        assert made['made by'].startswith('training/pronet.py --seed 1')
        places = [int(place) for place in made['places learned from'].split()]
        learned = trials.split_places(1)[0] if what == 'shapes' else np.arange(25)
        np.testing.assert_array_equal(places, learned)
    folder = Path(recogniser.__file__).parent
    assert sum(path.stat().st_size for path in folder.glob('*.onnx')) < 1_000_000
    with pytest.raises(ValueError, match='shapes, postures'):
        recogniser.pronet('mugs')
