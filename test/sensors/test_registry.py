# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The registry, configs with the numbers of the papers, and their fields as ROS parameters."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tactile_ros import sensors
from tactile_ros.errors import CalibrationError, TactileError
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import SensorSpec, list_sensors, load_sensor
from tactile_ros.sensors.taxel_array.config import grid_positions, sectors
from tactile_ros.types import Outline

FOLDER = Path(sensors.__file__).parent


def test_the_keys_are_the_folders() -> None:
    folders = sorted(path.name for path in FOLDER.iterdir() if (path / '__init__.py').exists())
    assert list_sensors() == folders
    assert 'reskin_board' in folders


@pytest.mark.parametrize('key', ['no_such_sensor', '', '..', 'registry', 'Reskin_Board', 'os'])
def test_an_unknown_key_is_told_those_there_are(key: str) -> None:
    with pytest.raises(ValueError, match=f"{', '.join(list_sensors())}; received '{key}'"):
        load_sensor(key)


@pytest.mark.parametrize('text', ['x = = 1', 'import nowhere_at_all', '1 / 0'])
def test_a_file_that_cannot_be_loaded_is_told_in_a_sentence(
    text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / 'torn_pad').mkdir()
    (tmp_path / 'torn_pad' / '__init__.py').write_text(text)
    monkeypatch.setattr(sensors, '__path__', [*sensors.__path__, str(tmp_path)])
    with pytest.raises(TactileError, match=r'sensor torn_pad cannot be loaded \('):
        load_sensor('torn_pad')


def test_a_folder_without_a_sensor_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('tactile_ros.sensors.registry.list_sensors', lambda: ['registry'])
    with pytest.raises(TactileError, match='must define SENSOR, a SensorSpec'):
        load_sensor('registry')


@pytest.mark.parametrize('key', list_sensors())
class TestSpec:
    def test_it_is_whole(self, key: str) -> None:
        spec = load_sensor(key)
        assert isinstance(spec, SensorSpec)
        assert load_sensor(key) is spec
        assert spec.key == key
        assert spec.paper
        assert spec.summary
        assert spec.transports

    @pytest.mark.parametrize('part', ['config', 'connection'])
    def test_its_dataclasses_are_frozen_and_described(self, key: str, part: str) -> None:
        thing = getattr(load_sensor(key), part)()
        assert dataclasses.is_dataclass(thing)
        for field in dataclasses.fields(thing):
            with pytest.raises(dataclasses.FrozenInstanceError):
                setattr(thing, field.name, None)
            assert field.metadata.get('help'), f'{field.name} of {key} has no help'
            low, high = field.metadata.get('range', (-np.inf, np.inf))
            value = getattr(thing, field.name)
            assert low < high
            if isinstance(value, (int, float, np.ndarray)) and 'range' in field.metadata:
                assert np.all((np.asarray(value) >= low) & (np.asarray(value) <= high)), field.name

    @pytest.mark.parametrize('saturation', [None, 1.0, np.inf, 'channels'])
    @pytest.mark.parametrize('taxels', ['default', 1, 7])
    def test_layouts_of_any_count_of_taxels(
        self, key: str, saturation: float | str | None, taxels: int | str
    ) -> None:
        spec = load_sensor(key)
        config = spec.config()
        channels = len(spec.layout(config).channels)
        limit = np.arange(1.0, channels + 1) if saturation == 'channels' else saturation
        config = dataclasses.replace(config, saturation=limit)  # type: ignore[type-var]
        if isinstance(taxels, int):
            config = dataclasses.replace(config, positions=np.zeros((taxels, 3)))  # type: ignore[type-var]
        layout = spec.layout(config)
        assert layout.sensor == key
        np.testing.assert_array_equal(layout.positions, config.positions)  # type: ignore[attr-defined]
        wanted = np.inf if limit is None else limit
        np.testing.assert_array_equal(layout.saturation, np.broadcast_to(wanted, channels))  # type: ignore[arg-type]

    def test_every_estimator_can_be_chosen_and_no_other(self, key: str) -> None:
        spec = load_sensor(key)
        for name in (None, *spec.estimator_names):
            assert isinstance(spec.pipeline(estimator=name), Pipeline)
        with pytest.raises(ValueError, match=r"must be one of .*; received 'oracle'"):
            spec.pipeline(estimator='oracle')


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

    def test_file_of_another_layout_than_its_config_is_refused(
        self, key: str, tmp_path: Path
    ) -> None:
        spec, path = load_sensor(key), tmp_path / 'c.npz'
        pipeline = spec.pipeline()
        pipeline.save(path)
        spec.load(path)
        pipeline.layout = dataclasses.replace(pipeline.layout, saturation=None, rate_hz=7.0)
        pipeline.save(path)  # signed, as a hostile writer would
        with pytest.raises(CalibrationError, match='another layout than its config'):
            spec.load(path)

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


def same(one: object, other: object) -> bool:
    """Whether two values of a field agree."""
    if isinstance(one, tuple) and one and dataclasses.is_dataclass(one[0]):
        return one is other
    if one is None or other is None:
        return one is other
    return bool(np.array_equal(np.asarray(one), np.asarray(other)))


@pytest.mark.parametrize('part', ['config', 'connection'])
@pytest.mark.parametrize('key', list_sensors())
def test_defaults_survive_the_way_through_ros(key: str, part: str) -> None:
    Schema = pytest.importorskip('tactile_ros.nodes.parameters').Schema
    defaults: Any = getattr(load_sensor(key), part)()
    schema = Schema(defaults)
    skipped = {f.name for f in dataclasses.fields(defaults)} - set(schema.entries)
    # only outlines are no parameters
    assert all('Outlines' in str(defaults.__dataclass_fields__[n].type) for n in skipped)
    values = {name: entry.ros_default for name, entry in schema.entries.items()}
    for entry in schema.entries.values():
        assert entry.descriptor().description
    again = schema.build(values)
    for field in dataclasses.fields(defaults):
        assert same(getattr(again, field.name), getattr(defaults, field.name)), field.name
        if '[str' in str(field.type):
            assert isinstance(values[field.name], list)


@pytest.mark.parametrize('key', list_sensors())
def test_no_name_is_declared_twice_on_a_node(key: str) -> None:
    Schema = pytest.importorskip('tactile_ros.nodes.parameters').Schema
    node = pytest.importorskip('tactile_ros.nodes.sensor_node')
    spec = load_sensor(key)
    parts: list[Any] = [spec.config(), spec.connection(), node.SensorOptions()]
    names = [name for part in parts for name in Schema(part).entries]
    assert len(names) == len(set(names))
