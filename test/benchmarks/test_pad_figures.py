"""Plots of a pad are drawings that a reader of XML accepts, and small."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np

from benchmarks.harness.plots import drawings


def test_every_plot_is_an_svg() -> None:
    rng = np.random.default_rng(0)
    cells = 1e-3 * np.array([[x, y, 5.0] for y in (-5, 5) for x in (-8, 0, 8)])
    true = rng.integers(0, 6, 300)
    places = cells[true] + 1e-3 * rng.normal(size=(300, 3))
    named = {'neighbours': np.where(rng.uniform(size=300) < 0.2, 0, true), 'ours': true}
    costs = {'neighbours': (20.0, 3.5), 'ours': (50.0, 0.3)}
    found = drawings(cells, places, places + 3e-4 * rng.normal(size=(300, 3)), named, true, costs)
    assert {'cells_ours', 'confusion_neighbours', 'errors', 'speed'} <= set(found)
    for name, text in found.items():
        assert ElementTree.fromstring(text).tag.endswith('svg'), name
        assert len(text) < 100_000
    assert '100' in found['cells_ours']
