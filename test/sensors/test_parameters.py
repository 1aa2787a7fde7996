# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Every config and connection as ROS parameters: declared, read back, the same."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from tactile_ros.sensors import list_sensors, load_sensor

pytest.importorskip('rcl_interfaces')
from tactile_ros.nodes.parameters import Schema


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
    pytest.importorskip('rclpy')
    node = pytest.importorskip('tactile_ros.nodes.sensor_node')
    spec = load_sensor(key)
    parts: list[Any] = [spec.config(), spec.connection(), node.SensorOptions()]
    names = [name for part in parts for name in Schema(part).entries]
    assert len(names) == len(set(names))
