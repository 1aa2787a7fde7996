# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Configs: the papers' numbers as defaults, doors that refuse."""

import dataclasses

import numpy as np
import pytest

from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.taxel_array.config import grid_positions, sectors
from tactile_ros.types import Outline

# sensor: taxels, channels, unit, and the numbers of its paper (SI)
PAPERS = {
    'reskin_board': (5, ('Bx', 'By', 'Bz'), 'T', {}),
    'multipole_skin': (20, ('Bx', 'By', 'Bz'), 'T', {
        'sheet_size': (75e-3, 75e-3), 'sheet_thickness': 2e-3, 'layer_thickness': 2e-3,
        'rate_hz': 80.0, 'magnetisation': 'M4', 'window': 10, 'gap': 3.5e-3,
        'pole_pitch': 9.375e-3, 'youngs_modulus': 69e3, 'poisson_ratio': 0.49, 'remanence': 0.1,
    }),
    'magnet_pad': (2, ('Bx', 'By', 'Bz'), 'T', {
        'positions': [[-10e-3, 0, 0], [10e-3, 0, 0]], 'radius': 10e-3, 'length': 40e-3,
        'magnet_positions': [[-10e-3, 0, 6.4e-3], [0, 0, 6.4e-3], [10e-3, 0, 6.4e-3]],
        'magnet_axes': [[0, 0, 1]] * 3, 'magnet_size': (2e-3, 2e-3, 1e-3), 'remanence': 1.4,
        'shear_modulus': 0.245e6, 'rate_hz': 100.0,
    }),
    'gradiometer': (4, ('Bx', 'Bz'), 'T', {
        'gap': 2.5e-3, 'disc_diameter': 2e-3, 'disc_height': 1e-3, 'remanence': 1.4,
        'sensitivity': (1, -0.005, 0), 'full_scale': 3.5, 'rate_hz': 1000.0,
        'saturation': (70e-3, 70e-3),
    }),
    'taxel_array': (16, ('output',), '1', {
        'areas': [110e-6] * 16, 'force_range': (0, 40), 'rate_hz': 100.0, 'saturation': 1.0,
        'taxel_outlines': None, 'objects': (),
    }),
    'five_wire_skin': (1, ('u_AC', 'u_BD', 'divider'), '1', {
        'size': (0.1, 0.1), 'touch_size': 15e-3, 'sheet_resistance': 100.0,
        'border_ratio': 24_000.0, 'supply_voltage': 5.0, 'reference_resistance': 1000.0,
    }),
}  # fmt: skip


@pytest.mark.parametrize('key', PAPERS)
class TestConfig:
    def test_defaults_are_the_papers_numbers(self, key: str) -> None:
        config = load_sensor(key).config()
        for name, wanted in PAPERS[key][3].items():
            found = getattr(config, name)
            if isinstance(wanted, (str, type(None))):
                assert found == wanted
            else:
                np.testing.assert_allclose(found, wanted, rtol=1e-12, err_msg=name)

    def test_layout_is_that_of_the_public_face(self, key: str) -> None:
        spec = load_sensor(key)
        taxels, channels, unit, _ = PAPERS[key]
        layout = spec.layout(spec.config())
        assert layout.shape == (taxels, len(channels))
        assert layout.channels == channels
        assert layout.unit == unit
        assert layout.rate_hz == spec.config().rate_hz  # type: ignore[attr-defined]
        assert layout.rotations is None
        turn = np.array([[[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]] * taxels)
        turned = dataclasses.replace(spec.config(), rotations=turn)  # type: ignore[type-var]
        np.testing.assert_array_equal(spec.layout(turned).rotations, turn)


def test_chips_of_the_multipole_skin_are_five_clusters_of_four() -> None:
    config = load_sensor('multipole_skin').config()
    clusters = config.positions.reshape(5, 4, 3)  # type: ignore[attr-defined]
    middles = clusters.mean(axis=1)
    np.testing.assert_allclose(middles[0, :2], 0, atol=1e-12)
    assert len(np.unique(np.round(middles, 6), axis=0)) == 5
    assert np.ptp(clusters, axis=1).max() < 10e-3
    surface = config.positions[:, 2] + config.gap  # type: ignore[attr-defined]
    np.testing.assert_allclose(surface, config.layer_thickness)  # type: ignore[attr-defined]


def test_magnets_need_an_axis_each() -> None:
    config = load_sensor('magnet_pad').config()
    for axes in (np.array([[0, 0, 1.0]]), np.zeros((3, 3))):
        with pytest.raises(ValueError, match='magnet_axes of MagnetPadConfig must be one direct'):
            dataclasses.replace(config, magnet_axes=axes)  # type: ignore[type-var]


def test_sectors_have_their_areas() -> None:
    config = load_sensor('taxel_array').config()
    loops = [outline.loops[0] for outline in sectors()]
    areas = [
        0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) for x, y in map(np.transpose, loops)
    ]
    np.testing.assert_allclose(areas, config.areas, rtol=0.01)  # type: ignore[attr-defined]
    middles = np.array([loop.mean(axis=0) for loop in loops])
    angles = np.arctan2(*config.positions[:, 1::-1].T) - np.arctan2(*middles[:, ::-1].T)  # type: ignore[attr-defined]
    np.testing.assert_allclose(angles, 0, atol=1e-9)


def test_areas_follow_the_count_of_taxels_where_they_are_alike() -> None:
    config = load_sensor('taxel_array').config()
    grid = grid_positions(4, 3, 1e-3)
    assert dataclasses.replace(config, positions=grid).areas.shape == (12,)  # type: ignore[type-var,attr-defined]
    one = dataclasses.replace(config, positions=grid, areas=[1e-6])  # type: ignore[type-var]
    np.testing.assert_array_equal(one.areas, np.full(12, 1e-6))  # type: ignore[attr-defined]
    unlike = np.linspace(1e-6, 2e-6, 16)
    kept = dataclasses.replace(config, areas=unlike)  # type: ignore[type-var]
    np.testing.assert_array_equal(kept.areas, unlike)  # type: ignore[attr-defined]
    with pytest.raises(ValueError, match=r'areas of TaxelArrayConfig must have shape \(12,\)'):
        dataclasses.replace(kept, positions=grid)  # type: ignore[type-var]


def test_outlines_of_taxels_are_one_each() -> None:
    config = load_sensor('taxel_array').config()
    assert len(dataclasses.replace(config, taxel_outlines=sectors()).taxel_outlines) == 16  # type: ignore[type-var,attr-defined,arg-type]
    with pytest.raises(ValueError, match='taxel_outlines of TaxelArrayConfig must be 16, one for'):
        dataclasses.replace(config, taxel_outlines=(Outline('a', ()),))  # type: ignore[type-var]
    with pytest.raises(ValueError, match='force_range of TaxelArrayConfig must grow'):
        dataclasses.replace(config, force_range=(5.0, 5.0))  # type: ignore[type-var]
