# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Dataclass fields as ROS parameters: values and sentences; fields themselves refuse values."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import pytest

from tactile_ros.nodes.parameters import NodeOptions, Schema, parameter
from tactile_ros.types import Array
from tactile_ros.types.config_fields import array, each_channel, maybe_array, number


@dataclass(frozen=True)
class Toy(NodeOptions):
    rate_hz: float = number(100.0, 'frames', 'Hz', 1, 1000)
    count: int = parameter(3, 'of it', range=(1, 9), live=True)
    name: str = parameter('a', 'which', choices=('a', 'b'), read_only=True)
    fingers: tuple[str, ...] = parameter((), 'some')
    noise: float | None = field(default=None, metadata={'range': (0, 1)})
    positions: Array = array(np.zeros((2, 3)), 'places', 'm', (-1, 3))
    rotations: Array | None = maybe_array('turns', '1', ('t', 3, 3))
    scale: float | Array | None = each_channel(1.0, 'scale', '1')


@pytest.fixture
def schema() -> Schema[Toy]:
    return Schema(Toy())


def test_defaults_go_out_and_come_back(schema: Schema[Toy]) -> None:
    sent = {name: entry.ros_default for name, entry in schema.entries.items()}
    assert math.isnan(sent['noise'])
    assert sent['rotations'] == sent['fingers'] == []
    assert sent['positions'] == [0.0] * 6
    got = schema.build({**sent, 'scale': [3.0]})
    assert (got.noise, got.rotations, got.scale) == (None, None, 3.0)
    np.testing.assert_array_equal(got.positions, np.zeros((2, 3)))
    assert (got.rate_hz, got.count, got.autostart, got.name) == (100.0, 3, True, 'a')


def test_values_take_the_shape_and_the_type_of_their_field(schema: Schema[Toy]) -> None:
    turns = np.eye(3).ravel().tolist() * 3
    got = schema.build({'positions': list(range(9)), 'rotations': turns, 'fingers': ['a', 'b']})
    assert got.positions.shape == (3, 3)
    np.testing.assert_array_equal(got.rotations, [np.eye(3)] * 3)
    assert got.fingers == ('a', 'b')
    assert schema.build({'rate_hz': 50, 'fingers': 'thumb'}).fingers == ('thumb',)


def test_descriptors_say_what_a_user_must_know(schema: Schema[Toy]) -> None:
    rate = schema.entries['rate_hz'].descriptor()
    assert rate.description == 'frames; unit Hz; read at configure'
    assert rate.floating_point_range[0].to_value == 1000.0
    assert schema.entries['count'].descriptor().description.endswith('may change any time')
    assert schema.entries['name'].descriptor().read_only
    assert 'one of a, b' in schema.entries['name'].descriptor().description
    # NaN stands for None and lies in no range, so that ROS itself must not check
    assert not schema.entries['noise'].descriptor().floating_point_range
