# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The registry: folders are keys, specs are whole, unknown names are told what there is."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from tactile_ros import sensors
from tactile_ros.errors import TactileError
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import SensorSpec, list_sensors, load_sensor

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
