"""Dataclass fields as ROS parameters: values, ranges, sentences."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import pytest

from tactile_ros.nodes.parameters import Schema


@dataclass(frozen=True)
class Toy:
    rate_hz: float = field(
        default=100.0, metadata={'help': 'frames', 'unit': 'Hz', 'range': (1, 1000)}
    )
    count: int = field(default=3, metadata={'range': (1, 9), 'live': True})
    on: bool = True
    name: str = field(default='a', metadata={'choices': ('a', 'b'), 'read_only': True})
    noise: float | None = field(default=None, metadata={'range': (0, 1)})
    positions: np.ndarray = field(default_factory=lambda: np.zeros((2, 3)))
    rotations: np.ndarray | None = None
    scale: float | Array = field(  # noqa: F821
        default_factory=lambda: np.array([1.0, 2.0]), metadata={'range': (0, 5)}
    )

    def __post_init__(self) -> None:
        if len(self.positions) > 3:
            msg = 'positions of Toy must be at most 3'
            raise ValueError(msg)


# as a module with postponed annotations gives them
Toy.__dataclass_fields__['positions'].type = 'Array'
Toy.__dataclass_fields__['rotations'].type = 'Array | None'


@pytest.fixture
def schema() -> Schema[Toy]:
    return Schema(Toy())


def test_defaults_go_out_and_come_back(schema: Schema[Toy]) -> None:
    sent = {name: entry.ros_default for name, entry in schema.entries.items()}
    assert math.isnan(sent['noise'])
    assert sent['rotations'] == []
    assert sent['positions'] == [0.0] * 6
    got = schema.build(sent)
    assert got.noise is None
    assert got.rotations is None
    np.testing.assert_array_equal(got.positions, np.zeros((2, 3)))
    np.testing.assert_array_equal(got.scale, [1.0, 2.0])
    assert (got.rate_hz, got.count, got.on, got.name) == (100.0, 3, True, 'a')


def test_arrays_take_their_shape(schema: Schema[Toy]) -> None:
    got = schema.build({'positions': list(range(9)), 'rotations': np.eye(3).ravel().tolist()})
    assert got.positions.shape == (3, 3)
    np.testing.assert_array_equal(got.rotations, np.eye(3)[None])


@pytest.mark.parametrize(
    ('name', 'value', 'sentence'),
    [
        ('rate_hz', 0.5, 'rate_hz must lie in 1 to 1000 Hz; received 0.5'),
        ('rate_hz', True, 'rate_hz must be a number; received True'),
        ('rate_hz', 'fast', "rate_hz must be a number; received 'fast'"),
        ('rate_hz', float('nan'), 'rate_hz must lie in 1 to 1000 Hz; received nan'),
        ('count', 10, 'count must lie in 1 to 9; received 10'),
        ('count', True, 'count must be a whole number; received True'),
        ('count', 2.5, 'count must be a whole number; received 2.5'),
        ('on', 1, 'on must be true or false; received 1'),
        ('name', 'c', "name must be one of a, b; received 'c'"),
        ('noise', 2.0, 'noise must lie in 0 to 1; received 2.0'),
        ('positions', [1.0, 2.0], r'positions must be a multiple of 3 numbers; received \[1.0'),
        ('positions', [0.0] * 12, 'positions of Toy must be at most 3'),
        ('scale', [1.0, 6.0], 'scale must lie in 0 to 5'),
    ],
)
def test_what_cannot_be_is_one_sentence(
    schema: Schema[Toy], name: str, value: object, sentence: str
) -> None:
    with pytest.raises(ValueError, match=sentence):
        schema.build({name: value})


def test_whole_numbers_are_numbers(schema: Schema[Toy]) -> None:
    assert schema.build({'rate_hz': 50}).rate_hz == 50.0


def test_descriptors_say_what_a_user_must_know(schema: Schema[Toy]) -> None:
    rate = schema.entries['rate_hz'].descriptor()
    assert rate.description == 'frames; unit Hz; read at configure'
    assert rate.floating_point_range[0].to_value == 1000.0
    assert schema.entries['count'].descriptor().description.endswith('may change any time')
    assert schema.entries['name'].descriptor().read_only
    assert 'one of a, b' in schema.entries['name'].descriptor().description
    # NaN stands for None and lies in no range, so that ROS itself must not check
    assert not schema.entries['noise'].descriptor().floating_point_range
